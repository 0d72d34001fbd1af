"""The whole pipeline on the drawn elbow slice: `vfplan demo -o DIR`."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any

FILES = (
    "mask.png",
    "overlay.png",
    "fixture.h5",
    "fixture-sheet.png",
    "result.h5",
    "force.png",
    "scene.png",
)
"""The files that `draw` writes, in the order of the pipeline."""


def draw(folder: Path) -> dict[str, Any]:
    """Plan a fixture, replay a session against it and draw both, as `FILES`.

    Returns the reports of all steps.
    """
    from vfplan.bundle.write import write_fixture
    from vfplan.figures import replay as figures
    from vfplan.figures.slice import draw_mask, draw_overlay
    from vfplan.figures.style import save_png
    from vfplan.planning.plan import plan
    from vfplan.planning.settings import ExtractSettings
    from vfplan.replaying.replay import replay
    from vfplan.review.plan import Plan
    from vfplan.review.sheet import write_sheet
    from vfplan.session.read import read_session
    from vfplan.session.result import write_result

    sample = files("vfplan.samples")
    result = plan(
        sample / "elbow.png",
        sample / "elbow_markers_image.csv",
        sample / "elbow_markers_robot.csv",
        extraction=ExtractSettings(pixel_spacing_mm=(0.5, 0.5)),
    )
    fixture = result.fixture
    write_fixture(fixture, folder / "fixture.h5")
    shown = Plan.of(fixture, "fixture.h5", result.extracted.image)
    write_sheet(shown, folder / "fixture-sheet.png")

    replayed = replay(fixture, read_session(str(sample / "elbow_session.csv")))
    write_result(replayed, folder / "result.h5")

    extraction = result.extracted.extraction
    draw_mask(extraction, folder / "mask.png")
    draw_overlay(
        result.extracted.image,
        extraction,
        folder / "overlay.png",
        markers=fixture.registration,
        findings=fixture.findings,
    )
    save_png(figures.timeline(replayed), folder / "force.png")
    save_png(figures.scene(replayed), folder / "scene.png")
    return {**result.report, "replay": replayed.metrics}
