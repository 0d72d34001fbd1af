"""`vfplan demo`: the whole pipeline on the shipped sample, no network, no screen."""

from __future__ import annotations

import importlib
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from vfplan.cli.options import FILE, OVERWRITE, option, options_in_order
from vfplan.cli.outputs import outputs, refuse_folder
from vfplan.cli.run import CommandResult, announce_if_slow, command

from vfplan.display import length, micrometres, millimetres
from vfplan.io.files import to_json_types
from vfplan.io.writing import write_whole


@command("demo")
@click.argument(
    "what", type=click.Choice(["pipeline", "paper", "experiments", "panda"]), default="pipeline"
)
@options_in_order(
    option("-o", "--output", type=FILE, default="vfplan-demo", metavar="DIR",
           help="Write the files into this folder. It is made if it does not exist."),
    option("--page", type=FILE, metavar="OUT.html",
           help="Write one page instead, which needs no network: the paper's four simulations, "
                "felt with the mouse."),
    OVERWRITE,
)  # fmt: skip
def vfplan_demo(what, output, page) -> CommandResult:
    """Plan a fixture on the shipped slice, replay the shipped session, and draw both.

    \b
    The demonstrations are
      pipeline     the default: mask, overlay, fixture bundle, result of the replay, force and
                   penetration over time, and a picture of cloud and paths
      paper        the paper's Figs. 2, 4, 5 and 6, each with its numbers as JSON
      experiments  the paper's two experiments with a scripted hand
      panda        the same on a simulated Panda (extra [arm]): force over depth, arm, torques
    """
    if page is not None:
        return write_page(page)
    sample = importlib.import_module(f"vfplan.samples.{what}")
    if output.exists():
        refuse_folder(output, *sample.FILES)
    targets = [output / name for name in sample.FILES]
    with (
        outputs(*targets) as places,
        tempfile.TemporaryDirectory(prefix="vfplan-") as folder,
        announce_if_slow(f"drawing the {what}"),
    ):
        report = sample.draw(Path(folder))
        for name, place in zip(sample.FILES, places, strict=True):
            write_whole(place, [Path(folder, name).read_bytes()], overwrite=True)
    key, tell = TELLERS[what]
    data = {key: report} if key else dict(report)
    data["files"] = list(sample.FILES)
    return CommandResult(
        data,
        f"{tell(report)}\nwrote into {output}: {', '.join(sample.FILES)}",
        verdict=f"done: {len(sample.FILES)} files written",
        next_step=f"look at the pictures in {output}; docs/tutorial.md tells the steps one by one",
    )


def write_page(page: Path) -> CommandResult:
    """Write the four simulations as a page."""
    from vfplan.samples.paper import simulations_page

    with outputs(page) as (place,):
        write_whole(place, [simulations_page().encode()], overwrite=True)
    return CommandResult(
        {"files": [page.name]},
        f"wrote {page}: one file, which a browser opens without a network",
        verdict="done: 1 file written",
        next_step=f"open {page} in a browser and move the mouse over the picture",
    )


def pipeline_text(report: dict[str, Any]) -> str:
    """The story of the pipeline on the sample."""
    extract = report["extract"]
    register = report["register"]
    replayed = report["replay"]
    image = extract["image"]
    stroke = extract["strokes"][0]
    pieces = register["pieces"]
    worst_m = max(marker["residual_m"] for marker in register["residuals"])
    clearance = length(max(0.0, -replayed["clearance_min_m"]))
    return (
        f"A red curve stands on an elbow slice of {image['width_px']} x {image['height_px']} px.\n"
        f"  The pen covers {extract['mask_pixels']} pixels; its centre line is "
        f"{stroke['length_px']:.1f} px ({stroke['length_mm']:.1f} mm) long.\n"
        f"{register['markers']} markers tie the slice to the robot ({register['model']}).\n"
        f"  FRE {millimetres(register['fre_rms_m'])} rms, worst marker {millimetres(worst_m)}; "
        f"predicted TRE of the curve {millimetres(register['tre_rms_m'])} rms.\n"
        f"The fixture has {pieces['lines_and_arcs']} lines and arcs.\n"
        f"  The curve lies at most {micrometres(pieces['error_m'], 1)} beside them.\n"
        f"A hand probed it from both sides for {replayed['duration_s']:.1f} s.\n"
        f"  {len(replayed['episodes'])} contacts in {replayed['ticks']} ticks; it went up to "
        f"{millimetres(replayed['penetration_max_m'])} past the proxy and was pushed back with up "
        f"to {replayed['force_max_n']:.2f} N.\n"
        f"  The proxy kept its radius from them to {clearance}; the force changed by at most "
        f"{replayed['force_step_max_n']:.3f} N a tick."
    )


def paper_text(report: dict[str, Any]) -> str:
    """The numbers of each of the paper's figures."""
    return "\n".join(
        f"{figure}: {json.dumps(to_json_types(numbers))}" for figure, numbers in report.items()
    )


def experiments_text(report: dict[str, Any]) -> str:
    """A line for each of the paper's experiments."""
    return "\n".join(
        "{name}: {points} points, {ticks} ticks, {contacts} contacts, {force_max_n:.2f} N, "
        "{penetration_max_mm:.2f} mm, clearance {clearance_min_um:.2f} µm".format(
            name=name, **numbers
        )
        for name, numbers in report.items()
    )


def panda_text(report: dict[str, Any]) -> str:
    """The rehearsal of each of the paper's experiments."""
    from vfplan.arm.command import rehearsed_text

    lines = []
    for name, metrics in report.items():
        lines.append(f"{name}: {metrics['points']} points, {metrics['slope_n_per_m']:.1f} N/m felt")
        lines.append(rehearsed_text(metrics))
    return "\n".join(lines)


# What is drawn -> its key in JSON (of the pipeline every number has its own), and its text.
TELLERS: dict[str, tuple[str, Callable[[dict[str, Any]], str]]] = {
    "pipeline": ("", pipeline_text),
    "paper": ("figures", paper_text),
    "experiments": ("experiments", experiments_text),
    "panda": ("experiments", panda_text),
}
