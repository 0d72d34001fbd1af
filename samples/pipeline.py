"""The whole pipeline on the drawn elbow slice: `vfplan demo -o DIR`."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any

# In the order of the story.
FILES = (
    "mask.png", "overlay.png", "fixture.h5", "fixture-sheet.png", "result.h5", "force.png",
    "scene.png",
)  # fmt: skip


def draw(folder: Path) -> dict[str, Any]:
    """Plan, replay and draw, leave `FILES` in `folder`; the reports of each step."""
    from vfplan.bundle import write_fixture
    from vfplan.figures import replay as figures
    from vfplan.figures.slice import draw_mask, draw_overlay
    from vfplan.figures.style import save_png
    from vfplan.planning import ExtractSettings, plan
    from vfplan.replaying import replay
    from vfplan.review.sheet import write_sheet
    from vfplan.review.sheet_input import of_plan
    from vfplan.session import read_session, write_result

    sample = files("vfplan.samples")
    made = plan(
        sample / "elbow.png",
        sample / "elbow_markers_image.csv",
        sample / "elbow_markers_robot.csv",
        extraction=ExtractSettings(pixel_spacing_mm=(0.5, 0.5)),
    )
    write_fixture(made.fixture, folder / "fixture.h5")
    write_sheet(of_plan(made, "fixture.h5"), folder / "fixture-sheet.png")
    replayed = replay(made.fixture, read_session(str(sample / "elbow_session.csv")))
    write_result(replayed, folder / "result.h5")
    image, extraction = made.extracted.image, made.extracted.extraction
    draw_mask(extraction, folder / "mask.png")
    markers, findings = made.fixture.registration, made.fixture.findings
    draw_overlay(image, extraction, folder / "overlay.png", markers=markers, findings=findings)
    save_png(figures.timeline(replayed), folder / "force.png")
    save_png(figures.scene(replayed), folder / "scene.png")
    return {**made.report, "replay": replayed.metrics}
