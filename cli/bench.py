"""`vfplan bench`: error against run time."""

from __future__ import annotations

import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource
from vfplan.cli.options import OVERWRITE, option, taking
from vfplan.cli.outputs import outputs, refuse_folder
from vfplan.cli.run import Report, command, patience, progress
from vfplan.cli.values import FILE, MM

from vfplan.errors import InputError, SettingError

STAGES = ("extract", "sample", "register", "proxy", "plan")
KEY = (
    "* on the front: nothing on this scene is both faster and nearer to the truth",
    "> the setting that is chosen: a plan's own, or what --tolerance leads to",
    "Of each method the setting with the least error is shown; -v shows all, --json has more.",
)


@command("bench", first_screen="-o --quick --peer --tolerance --from --json")
@click.argument("stage", type=click.Choice([*STAGES, "all"]), default="all")
@taking(
    option("-o", "--output", type=FILE, metavar="DIR",
           help="Folder for bench.json, bench.csv and one diagram a stage."),
    OVERWRITE,
    option("--quick", is_flag=True, help="Under a minute, instead of under ten."),
    option("--peer", "peers", multiple=True, metavar="CMD",
           help="An outside program to run beside the engines: CMD FOLDER reads points.csv, "
           "path.csv and settings.csv there and writes proxies.csv.  [default: the shipped one on "
           "nanoflann, where it compiles]"),
    option("--tolerance", "tolerance_m", type=MM, default="0.01",
           help="What the chosen settings are to keep."),
    option("--from", "source", type=FILE, metavar="JSON",
           help="Measure nothing: draw again what a bench.json holds."),
)  # fmt: skip
def command(stage, output, source, peers, quick, tolerance_m) -> Report:
    """Measure STAGE (all of them by default) against known truth, and draw error over time.

    For each scene the table names every method with its time (of one tick of the controller, or of
    one call) and its error. The last sentences compare the chosen setting with what a user could
    take instead.
    """
    from vfplan.bench import read_document

    stages = STAGES if stage == "all" else (stage,)
    _refuse_idle_options(stages, source)
    document = None
    if source is not None:
        document = read_document(source)
        held = {r["stage"] for r in document["results"]}
        stages = tuple(s for s in stages if s in held)
        if not stages:
            raise InputError(f"holds no results of stage {stage}", where=str(source))
    names = ["bench.json", "bench.csv", *(f"bench_{stage}.png" for stage in stages)]
    refuse_folder(output, *names)
    if document is None:
        document = _measured(stages, peers, quick, tolerance_m)
    if output is not None:
        _write(document, stages, [output / name for name in names])
    verbose = click.get_current_context().params.get("verbose", 0) > 0
    *before, last = [text for name, text in _summaries(document).items() if name in stages]
    machine = f"measured in {document['elapsed_s']:.0f} s on {document['machine']['processor']}"
    lines = [*_tables(document, stages, verbose), "", machine, *before]
    next_step = "docs/accuracy.md explains every stage; -o DIR draws error against time"
    if output is not None:
        lines.append(f"wrote {output}/")
        next_step = f"look at {output}/{names[2]}"
    absent = [p["message"] for p in document["peers"] if not p["ran"]]
    return Report(document, "\n".join(lines), warnings=absent, verdict=last, next_step=next_step)


def _measured(
    stages: tuple[str, ...], commands: tuple[str, ...], quick: bool, tolerance_m: float
) -> dict[str, Any]:
    """A bench of now, beside the peers given or the shipped one."""
    from vfplan.bench import Peer, bench, build_nanoflann

    peers = [Peer(words) for words in commands]
    absent: list[dict[str, Any]] = []
    with ExitStack() as folders:
        if "proxy" in stages and not peers:
            folder = folders.enter_context(tempfile.TemporaryDirectory(prefix="vfplan-peer-"))
            try:
                with patience("compiling the nanoflann peer"):
                    peers.append(build_nanoflann(Path(folder)))
            except SettingError as error:
                absent.append({"name": "nanoflann_peer", "ran": False, "message": error.message})
        document = bench(
            stages, quick=quick, tolerance_m=tolerance_m, peers=peers, progress=progress
        )
    document["peers"] += absent
    return document


def _refuse_idle_options(stages: tuple[str, ...], source: Path | None) -> None:
    """Options that would have no effect are not taken in silence."""
    context = click.get_current_context()
    given = [
        param.opts[0]
        for param in context.command.params
        if param.name in ("quick", "peers", "tolerance_m")
        and context.get_parameter_source(param.name) is ParameterSource.COMMANDLINE
    ]
    if source is not None and given:
        raise click.UsageError(f"--from measures nothing: {', '.join(given)} would have no effect")
    if "--peer" in given and "proxy" not in stages:
        raise click.UsageError("--peer would have no effect: only stage proxy uses that")


def _write(document: dict[str, Any], stages: tuple[str, ...], files: list[Path]) -> None:
    from vfplan.bench import write_csv, write_json
    from vfplan.bench.figures import draw_stage

    with outputs(*files) as (table, rows, *pictures):
        write_json(document, table)
        write_csv(document, rows)
        for stage, picture in zip(stages, pictures, strict=True):
            draw_stage(document, stage, picture)


def _summaries(document: dict[str, Any]) -> dict[str, str]:
    from vfplan.bench import summaries

    return summaries(document)


def _tables(document: dict[str, Any], stages: tuple[str, ...], verbose: bool) -> list[str]:
    """A table a scene, cheapest first, under one header a stage, and the key."""
    lines = []
    for stage in stages:
        own = [r for r in document["results"] if r["stage"] == stage]
        timed = "tick" if stage in ("sample", "proxy") else "call"
        head = ("median a " + timed, "p99.9", "error RMS", "at most", "method", "settings")
        lines.append(f"{stage}: " + _row("", *head).strip())
        for scene in dict.fromkeys(r["scene"] for r in own):
            lines.append(f"  {scene}")
            here = [r for r in own if r["scene"] == scene]
            if not verbose:
                here = _best_of_each_method(here)
            for result in sorted(here, key=lambda r: r["time_us_median"]):
                lines.append(_line(result))
    for r in document.get("refused", ()):
        if r["stage"] in stages:
            settings = _pairs(r["settings"])
            lines.append(f"refused: {r['scene']}: {r['method']} {settings}: {r['message']}")
    return [*lines, "", *KEY]


def _best_of_each_method(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Of each method the setting that errs least, and every chosen one."""
    best: dict[str, dict[str, Any]] = {}
    for result in results:
        name = result["method"]
        if name not in best or result["error_rms"] < best[name]["error_rms"]:
            best[name] = result
    return [r for r in results if r.get("chosen") or best[r["method"]] is r]


def _line(result: dict[str, Any]) -> str:
    from vfplan.bench.summary import error_text, time_text

    marks = ("*" if result["pareto"] else " ") + (">" if result.get("chosen") else " ")
    return _row(
        marks,
        time_text(result["time_us_median"]),
        time_text(result["time_us_p999"]),
        error_text(result),
        error_text(result, "error_max"),
        result["method"],
        _pairs(result["settings"]),
    )


def _row(marks: str, *cells: str) -> str:
    """A line of the table: four columns of numbers, then the method and its settings."""
    numbers = "".join(f"{cell:>14}" for cell in cells[:4])
    return f"  {marks:<2}{numbers}  {cells[4]:<26}{cells[5]}".rstrip()


def _pairs(settings: dict[str, Any]) -> str:
    """Settings as a person reads them: lengths with their unit, the rest as name=value."""
    from vfplan.display import length

    words = []
    for name, value in settings.items():
        if name.endswith("_m"):
            words.append(f"{name.removesuffix('_m')} {length(value)}")
        elif isinstance(value, float):
            words.append(f"{name}={value:.4g}")
        else:
            words.append(f"{name}={value}")
    return ", ".join(words)
