"""`vfplan demo`: the whole pipeline on the shipped sample, no network, no screen."""

from __future__ import annotations

import importlib
import json
import tempfile
from pathlib import Path
from typing import Any

import click
from vfplan.cli.options import OVERWRITE, option, taking
from vfplan.cli.outputs import outputs, refuse_folder
from vfplan.cli.run import Report, command
from vfplan.cli.telling import told
from vfplan.cli.values import FILE

from vfplan.display import length
from vfplan.io.json_types import to_json_types
from vfplan.io.staging import write_whole

STORY = (
    "A red curve stands on an elbow slice of {image[width_px]} x {image[height_px]} px.\n"
    "  The pen covers {mask_pixels} pixels; its centre line is {strokes[0][length_px]:.1f} px "
    "({strokes[0][length_mm]:.1f} mm) long.\n"
    "{markers} markers tie the slice to the robot ({model}).\n"
    "  FRE {fre_rms_m:mm} rms, worst marker {worst_m:mm}; predicted TRE of the curve "
    "{tre_rms_m:mm} rms.\n"
    "The fixture has {pieces[lines_and_arcs]} lines and arcs.\n"
    "  The curve lies at most {pieces[error_m]:um.1} beside them.\n"
    "A hand probed it from both sides for {duration_s:.1f} s.\n"
    "  {contacts} contacts in {ticks} ticks; it went up to {penetration_max_m:mm} past the proxy "
    "and was pushed back with up to {force_max_n:.2f} N.\n"
    "  The proxy kept its radius from them to {clearance}; the force changed by at most "
    "{force_step_max_n:.3f} N a tick."
)
EXPERIMENT = (
    "{points} points, {ticks} ticks, {contacts} contacts, {force_max_n:.2f} N, "
    "{penetration_max_mm:.2f} mm, clearance {clearance_min_um:.2f} um"
)


@command("demo")
@click.argument(
    "what", type=click.Choice(["pipeline", "paper", "experiments", "panda"]), default="pipeline"
)
@taking(
    option("-o", "--output", type=FILE, default="vfplan-demo", metavar="DIR",
           help="The folder to fill; made when it is not there."),
    OVERWRITE,
)  # fmt: skip
def command(what, output) -> Report:
    """Plan a fixture on a drawn elbow slice, replay a probing session against it, draw both.

    \b
    WHAT is one of
      pipeline     (without WHAT) the pen's mask, the overlay, the fixture bundle, the replay's
                   result, force and penetration over time, and a picture of cloud and paths
      paper        the paper's Figs. 2, 4, 5 and 6 drawn anew, each with its numbers as JSON
      experiments  the paper's two experiments with a scripted hand, felt and seen
      panda        the same on a simulated Panda (extra [arm]): force against depth, arm, torques
    """
    sample = importlib.import_module(f"vfplan.samples.{what}")
    if output.exists():
        refuse_folder(output, *sample.FILES)
    targets = [output / name for name in sample.FILES]
    with outputs(*targets) as places, tempfile.TemporaryDirectory(prefix="vfplan-") as folder:
        data, text = STORIES[what](sample.draw(Path(folder)))
        for name, place in zip(sample.FILES, places, strict=True):
            write_whole(place, [Path(folder, name).read_bytes()], overwrite=True)
    left = f"Left in {output}: {', '.join(sample.FILES)}"
    return Report(
        {**data, "files": list(sample.FILES)},
        f"{text}\n{left}",
        verdict=f"done: {len(sample.FILES)} files written",
        next_step=f"look at the pictures in {output}; docs/tutorial.md tells the steps one by one",
    )


def _pipeline(found: dict[str, Any]) -> tuple[dict[str, Any], str]:
    replayed = found["replay"]
    more = {
        "worst_m": max(r["residual_m"] for r in found["register"]["residuals"]),
        "contacts": len(replayed["episodes"]),
        "clearance": length(max(0.0, -replayed["clearance_min_m"])),
    }
    return found, told(found["extract"] | found["register"] | replayed | more, STORY)


def _paper(found: dict[str, Any]) -> tuple[dict[str, Any], str]:
    lines = [f"{figure}: {json.dumps(to_json_types(numbers))}" for figure, numbers in found.items()]
    return {"figures": found}, "\n".join(lines)


def _experiments(found: dict[str, Any]) -> tuple[dict[str, Any], str]:
    lines = [f"{name}: {told(numbers, EXPERIMENT)}" for name, numbers in found.items()]
    return {"experiments": found}, "\n".join(lines)


def _panda(found: dict[str, Any]) -> tuple[dict[str, Any], str]:
    from vfplan.arm.command import rehearsed_text

    lines = [
        f"{name}: {m['points']} points, {m['slope_n_per_m']:.1f} N/m felt\n{rehearsed_text(m)}"
        for name, m in found.items()
    ]
    return {"experiments": found}, "\n".join(lines)


# What a sample has found -> the report, and its story
STORIES = {
    "pipeline": _pipeline,
    "paper": _paper,
    "experiments": _experiments,
    "panda": _panda,
}
