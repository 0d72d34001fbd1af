"""`vfplan bench`: error against run time; `conformance`: files that test a reader of bundles.

`vfplan demo`: the whole pipeline on the shipped sample, no network, no screen.
"""

from __future__ import annotations

import importlib
import json
import tempfile
from contextlib import ExitStack
from pathlib import Path

import click
from vfplan.cli.options import FILE, OVERWRITE, option, options_in_order
from vfplan.cli.outputs import outputs, refuse_folder
from vfplan.cli.run import CommandResult, announce_if_slow, command, progress, statistics

from vfplan.display import Report, quoted, wrote
from vfplan.errors import SettingError
from vfplan.io.files import to_json_types
from vfplan.io.writing import write_whole

STAGES = ("extract", "sample", "register", "proxy", "plan")


@command("bench", first_screen="-o --quick --peer --json")
@click.argument("stage", type=click.Choice([*STAGES, "all", "summary"]), default="all")
@options_in_order(
    option("-o", "--output", type=FILE, metavar="DIR",
           help="Write bench.json and a diagram of each step into this folder."),
    OVERWRITE,
    option("--quick", is_flag=True,
           help="Measure fewer cases, in about a minute instead of ten."),
    option("--peer", "peers", multiple=True, metavar="CMD",
           help="Compare the engines with this program. CMD FOLDER reads points.csv, path.csv and "
           "settings.csv there and writes proxies.csv.  [default: the shipped program with "
           "nanoflann, if it compiles]"),
)  # fmt: skip
def vfplan_bench(stage, output, peers, quick) -> CommandResult:
    """Measure error and run time of a step, by default of every step, against a known truth.

    For each scene the table has every method with its error and its time, which is that of one
    call or of one tick. The last sentences compare the default settings with others.
    `summary` measures the engines, and prints the last sentence alone.
    """
    from vfplan.bench.record import table_lines

    stages = {"all": list(STAGES), "summary": ["proxy"]}.get(stage, [stage])
    drawn = list(stages)
    if "proxy" in stages:
        drawn.append("summary")
    elif peers:
        raise click.UsageError("--peer runs in stage proxy only. Leave it out")
    names = ["bench.json", *(f"bench_{name}.png" for name in drawn)]
    refuse_folder(output, *names)
    document = measure(stages, peers, quick)
    if output is not None:
        from vfplan.bench.figures import draw_stage, draw_summary

        with outputs(*(output / name for name in names)) as (json_path, *pictures):
            text = json.dumps(to_json_types(document), indent=1) + "\n"
            write_whole(json_path, [text.encode()], overwrite=True)
            for name, picture in zip(drawn, pictures, strict=True):
                if name == "summary":
                    draw_summary(document, picture)
                else:
                    draw_stage(document, name, picture)

    # The table, the machine, and a sentence a stage; the last sentence is the verdict.
    sentences = document["summary"]
    if stage == "summary":
        # The sentence stands alone, for pages that quote it.
        return CommandResult(document, sentences["proxy"], verdict="", next_step="")
    *others, last = sentences
    lines = [
        *table_lines(document), "",
        f"measured in {document['elapsed_s']:.0f} s on {document['machine']['processor']}",
        *(f"{name}: {sentences[name]}" for name in others),
    ]  # fmt: skip
    next_step = "docs/accuracy.md explains every stage; -o DIR draws error against time"
    if output is not None:
        lines.append(wrote(f"{output}/"))
        next_step = f"look at {quoted(output / f'bench_{drawn[-1]}.png')}"
    warnings = [peer["message"] for peer in document["peers"] if not peer["ran"]]
    return CommandResult(
        document, "\n".join(lines), warnings=warnings, verdict=sentences[last], next_step=next_step
    )


def measure(stages: list[str], commands: tuple[str, ...], quick: bool) -> Report:
    """The document of a bench of now, beside the peers named or the shipped one."""
    from vfplan.bench.peers import Peer, build_nanoflann, mesh_peers
    from vfplan.bench.pipeline import bench

    peers = [Peer(words) for words in commands]
    absent = []
    with ExitStack() as folders:
        if "proxy" in stages and not peers:
            folder = folders.enter_context(tempfile.TemporaryDirectory(prefix="vfplan-peer-"))
            try:
                with announce_if_slow("compiling the nanoflann peer"):
                    program = build_nanoflann(Path(folder))
                peers += [program, Peer(f"{program.command} penalty", "nearest-point penalty")]
            except SettingError as error:
                absent.append({"name": "nanoflann_peer", "ran": False, "message": error.message})
            peers += mesh_peers()
        document = bench(stages, quick=quick, peers=peers, progress=progress)
    document["peers"] += absent
    return document


@command("conformance")
@option("--write", "folder", required=True, type=click.Path(file_okay=False, path_type=Path),
        metavar="DIR", help="Write the kit into this folder. Files of an older kit are replaced.",
)  # fmt: skip
def vfplan_conformance(folder) -> CommandResult:
    """Write the conformance kit: sound bundles, broken bundles, and rendered paths.

    `python -m vfplan.conformance --kit DIR CMD` runs a reader on each of its files.
    """
    from vfplan.conformance.kit import write_kit

    count = write_kit(folder)
    return CommandResult(
        {"folder": str(folder), "files": count},
        f"wrote {count} files into {quoted(folder)}",
        verdict="the kit is complete",
        next_step="run your reader CMD on each file: python -m vfplan.conformance --kit "
        f"{quoted(folder)} CMD",
    )


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
        from vfplan.samples.paper import simulations_page

        with outputs(page) as (place,):
            write_whole(place, [simulations_page().encode()], overwrite=True)
        return CommandResult(
            {"files": [page.name]},
            f"{wrote(page)}: one file, which a browser opens without a network",
            verdict="done: 1 file written",
            next_step=f"open {quoted(page)} in a browser and move the mouse over the picture",
        )
    sample = importlib.import_module(f"vfplan.samples.{what}")
    if output.exists():
        refuse_folder(output, *sample.FILES)
    with (
        outputs(*(output / name for name in sample.FILES)) as places,
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
        from vfplan.cli.extract import extracted_text
        from vfplan.cli.register import registered_text
        from vfplan.cli.replay import replay_text

        steps = (extracted_text, "extract"), (registered_text, "register"), (replay_text, "replay")
        lines = [tell(report[step]) for tell, step in steps]
    text = "\n".join([*lines, f"wrote into {quoted(output)}: {', '.join(sample.FILES)}"])
    data["files"] = list(sample.FILES)
    return CommandResult(
        data,
        text,
        verdict=f"done: {len(sample.FILES)} files written",
        next_step=f"look at the pictures in {quoted(output)}; docs/tutorial.md tells the steps one "
        "by one",
    )
