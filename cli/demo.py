"""`vfplan demo`: the whole pipeline on the shipped sample, no network, no screen."""

from __future__ import annotations

import importlib
import json
import tempfile
from importlib.resources import as_file, files
from pathlib import Path
from types import ModuleType
from typing import Any

import click
from vfplan.cli.options import OVERWRITE, option, taking
from vfplan.cli.outputs import outputs, refuse_folder
from vfplan.cli.run import Report, command
from vfplan.cli.values import FILE, mm

from vfplan.io.disk import jsonable, write_whole

# Left behind in the folder by the pipeline, in the order of the story.
FILES = ("mask.png", "overlay.png", "fixture.h5", "result.h5", "force.png", "scene.png")


@command("demo")
@click.argument(
    "what", type=click.Choice(["pipeline", "paper", "experiments", "panda"]), default="pipeline"
)
@taking(
    option("-o", "--output", type=FILE, default="vfplan-demo", metavar="DIR",
           help="The folder to fill; made when it is not there."),
    OVERWRITE,
)  # fmt: skip
def command(what: str, output: Path) -> Report:
    """Plan a fixture on a drawn elbow slice, replay a probing session against it, draw both.

    \b
    WHAT is one of
      pipeline     (without WHAT) the pen's mask, the overlay, the fixture bundle, the replay's
                   result, force and penetration over time, and a picture of cloud and paths
      paper        the paper's Figs. 2, 4, 5 and 6 drawn anew, each with its numbers as JSON
      experiments  the paper's two experiments with a scripted hand, felt and seen
      panda        the same on a simulated Panda (extra [arm]): force against depth, arm, torques
    """
    names = FILES if what == "pipeline" else _sample(what).FILES
    make = {
        "pipeline": pipeline,
        "paper": papers_figures,
        "experiments": experiments,
        "panda": panda,
    }[what]
    targets = [output / name for name in names]
    if output.exists():
        refuse_folder(output, *names)
    with outputs(*targets) as temporary:
        data, text = make(*temporary)
    left = f"Left in {output}: {', '.join(names)}"
    return Report({**data, "files": list(names)}, f"{text}\n{left}")


def pipeline(*places: Path) -> tuple[dict[str, Any], str]:
    """The whole pipeline into `FILES`: its numbers, and its story."""
    with as_file(files("vfplan.samples")) as sample:
        planned, metrics = run_sample(sample, *places)
    return {**planned, "replay": metrics}, story(planned, metrics)


def papers_figures(*places: Path) -> tuple[dict[str, Any], str]:
    """The paper's figures: their numbers, and a line for each."""
    found = _drawn(_sample("paper"), places)
    lines = [f"{figure}: {json.dumps(jsonable(numbers))}" for figure, numbers in found.items()]
    return {"figures": found}, "\n".join(lines)


def experiments(*places: Path) -> tuple[dict[str, Any], str]:
    """The paper's experiments: their numbers, and a line for each."""
    found = _drawn(_sample("experiments"), places)
    lines = [
        f"{name}: {m['points']} points, {m['ticks']} ticks, {m['contacts']} contacts, "
        f"{m['force_max_n']:.2f} N, {m['penetration_max_mm']:.2f} mm, "
        f"clearance {m['clearance_min_um']:.2f} um"
        for name, m in found.items()
    ]
    return {"experiments": found}, "\n".join(lines)


def panda(*places: Path) -> tuple[dict[str, Any], str]:
    """The experiments on a simulated Panda: their numbers, and the report of each."""
    from vfplan.cli.rehearse import rehearsed_text

    found = _drawn(_sample("panda"), places)
    lines = [
        f"{name}: {m['points']} points, {m['slope_n_per_m']:.1f} N/m felt\n{rehearsed_text(m)}"
        for name, m in found.items()
    ]
    return {"experiments": found}, "\n".join(lines)


def _drawn(module: ModuleType, places: tuple[Path, ...]) -> dict[str, Any]:
    """Let a sample draw into a folder of its own, then put each file in its place."""
    with tempfile.TemporaryDirectory(prefix="vfplan-") as folder:
        found = module.draw(Path(folder))
        for name, place in zip(module.FILES, places, strict=True):
            write_whole(place, [Path(folder, name).read_bytes()], overwrite=True)
    return found


def _sample(name: str) -> ModuleType:
    return importlib.import_module(f"vfplan.samples.{name}")


def run_sample(
    sample: Path, mask: Path, overlay: Path, fixture: Path, result: Path, force: Path, scene: Path
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The pipeline on the sample's files; the reports of planning and of replaying."""
    from vfplan.bundle import write_fixture
    from vfplan.figures import replay as figures
    from vfplan.figures.slice import draw_mask, draw_overlay
    from vfplan.figures.style import save_png
    from vfplan.planning import ExtractSettings, plan
    from vfplan.replaying import replay
    from vfplan.session import read_session, write_result

    made = plan(
        sample / "elbow.png",
        sample / "elbow_markers_image.csv",
        sample / "elbow_markers_robot.csv",
        extraction=ExtractSettings(pixel_spacing_mm=(0.5, 0.5)),
    )
    write_fixture(made.fixture, fixture)
    replayed = replay(made.fixture, read_session(sample / "elbow_session.csv"))
    write_result(replayed, result)
    seen = made.extracted
    draw_mask(seen.extraction, mask)
    draw_overlay(seen.image, seen.extraction, overlay, markers=made.fixture.registration)
    save_png(figures.timeline(replayed), force)
    save_png(figures.scene(replayed), scene)
    return made.report, replayed.metrics


def story(planned: dict[str, Any], metrics: dict[str, Any]) -> str:
    """What the demo did, with the numbers it found."""
    image, stroke = planned["extract"]["image"], planned["extract"]["strokes"][0]
    register = planned["register"]
    worst = max(r["residual_m"] for r in register["residuals"])
    clearance_um = round(1e6 * metrics["clearance_min_m"], 1) + 0.0

    lines = [
        f"A red curve stands on an elbow slice of {image['width_px']} x {image['height_px']} px.",
        f"  The pen covers {planned['extract']['mask_pixels']} pixels; its centre line is "
        f"{stroke['length_px']:.1f} px ({stroke['length_mm']:.1f} mm) long.",
        f"{register['markers']} markers tie the slice to the robot ({register['model']}).",
        f"  FRE {mm(register['fre_rms_m'])} rms, worst marker {mm(worst)}; "
        f"predicted TRE of the curve {mm(register['tre_rms_m'])} rms.",
        f"The fixture has {register['pieces']['lines_and_arcs']} lines and arcs.",
        f"  The curve lies at most {register['pieces']['error_m'] * 1e6:.1f} um beside them.",
        f"A hand probed it from both sides for {metrics['duration_s']:.1f} s.",
        f"  {len(metrics['episodes'])} contacts in {metrics['ticks']} ticks; it went up to "
        f"{mm(metrics['penetration_max_m'])} past the proxy and was pushed back with up to "
        f"{metrics['force_max_n']:.2f} N.",
        f"  The proxy never came nearer to them than R {clearance_um:+.1f} "
        f"um; the force changed by at most {metrics['force_step_max_n']:.3f} N a tick.",
    ]
    return "\n".join(lines)
