"""`vfplan demo`: the whole pipeline on the shipped sample, no network, no screen."""

from __future__ import annotations

import importlib
import tempfile
from pathlib import Path

import click
from vfplan.cli.extract import extracted_text
from vfplan.cli.options import FILE, OVERWRITE, option, options_in_order
from vfplan.cli.outputs import outputs, refuse_folder
from vfplan.cli.register import registered_text
from vfplan.cli.run import CommandResult, announce_if_slow, command, statistics

from vfplan.io.files import to_json_types
from vfplan.io.writing import write_whole

# Where the report of what is drawn stands in JSON.
KEYS = {"paper": "figures", "experiments": "experiments", "panda": "experiments"}


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
    # Of the pipeline each step has its own numbers.
    data = {KEYS[what]: report} if what in KEYS else dict(report)
    lines = statistics(to_json_types(data))
    if what == "pipeline":
        from vfplan.cli.replay import replay_text

        steps = (extracted_text, "extract"), (registered_text, "register"), (replay_text, "replay")
        lines = [tell(report[step]) for tell, step in steps]
    text = "\n".join([*lines, f"wrote into {output}: {', '.join(sample.FILES)}"])
    data["files"] = list(sample.FILES)
    return CommandResult(
        data,
        text,
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
