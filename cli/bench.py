"""`vfplan bench`: error against run time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource
from vfplan.cli.options import OVERWRITE, option, taking
from vfplan.cli.outputs import outputs, refuse_folder
from vfplan.cli.run import Report, command, progress
from vfplan.cli.telling import told
from vfplan.cli.values import FILE, MM

from vfplan.errors import InputError

STAGES = ("extract", "sample", "register", "proxy", "feel", "plan")
FELT = (
    "jumps {force_jumps}, above 2 N {force_jumps_large}, worst {force_step_max_n:.2f} N, LIMIT "
    "{limit_share:.2%}, band {band_m:um.3g}"
)


@command("bench")
@click.argument("stage", type=click.Choice([*STAGES, "all"]), default="all")
@taking(
    option("-o", "--output", type=FILE, metavar="DIR",
           help="Folder for bench.json, bench.csv and one diagram a stage."),
    OVERWRITE,
    option("--quick", is_flag=True, help="Under a minute, instead of under ten."),
    option("--peer", "peers", multiple=True, metavar="CMD",
           help="An outside program to run beside the engines: CMD FOLDER reads points.csv, "
           "path.csv and settings.csv there and writes proxies.csv."),
    option("--surface", type=FILE, metavar="MESH",
           help="A bone's surface (STL, PLY; mm) as one more scene of proxy."),
    option("--tolerance", "tolerance_m", type=MM, default="0.01",
           help="What the chosen settings are to keep."),
    option("--from", "source", type=FILE, metavar="JSON",
           help="Measure nothing: draw again what a bench.json holds."),
)  # fmt: skip
def command(stage, output, source, peers, **given) -> Report:
    """Measure STAGE (all of them by default) against known truth, and draw error over time."""
    from vfplan.study.bench import Peer, bench, read_document

    stages = STAGES if stage == "all" else (stage,)
    _refuse_idle(stages, source)
    document = None if source is None else read_document(source)
    if document is not None:
        held = {r["stage"] for r in document["results"]}
        stages = tuple(s for s in stages if s in held)
        if not stages:
            raise InputError(f"holds no results of stage {stage}", where=str(source))
    names = ["bench.json", "bench.csv", *(f"bench_{stage}.png" for stage in stages)]
    refuse_folder(output, *names)
    if document is None:
        document = bench(stages, peers=[Peer(p) for p in peers], progress=progress, **given)
    if output is not None:
        _write(document, stages, [output / name for name in names])
    text = "\n".join(_text(document, stages))
    absent = [p["message"] for p in document["peers"] if not p["ran"]]
    return Report(document, text + (f"\nwrote {output}/" if output else ""), warnings=absent)


def _refuse_idle(stages: tuple[str, ...], source: Path | None) -> None:
    """Options that would have no effect are not taken in silence."""
    context = click.get_current_context()
    given = [
        param.opts[0]
        for param in context.command.params
        if param.name in ("quick", "peers", "surface", "tolerance_m")
        and context.get_parameter_source(param.name) is ParameterSource.COMMANDLINE
    ]
    if source is not None and given:
        raise click.UsageError(f"--from measures nothing: {', '.join(given)} would have no effect")
    idle = ", ".join(flag for flag in given if flag in ("--peer", "--surface"))
    if idle and "proxy" not in stages:
        raise click.UsageError(f"{idle} would have no effect: only stage proxy uses that")


def _write(document: dict[str, Any], stages: tuple[str, ...], files: list[Path]) -> None:
    from vfplan.study.bench import write_csv, write_json
    from vfplan.study.bench_figures import draw_stage

    with outputs(*files) as (table, rows, *pictures):
        write_json(document, table)
        write_csv(document, rows)
        for stage, picture in zip(stages, pictures, strict=True):
            draw_stage(document, stage, picture)


def _text(document: dict[str, Any], stages: tuple[str, ...]) -> Iterator[str]:
    """The front of every scene, cheapest first, and what the tolerance chose."""
    for stage in stages:
        own = [r for r in document["results"] if r["stage"] == stage]
        for scene in dict.fromkeys(r["scene"] for r in own):
            yield f"{stage}: {scene}"
            here = [
                r
                for r in own
                if r["scene"] == scene and (r["pareto"] or r.get("chosen") or stage == "feel")
            ]
            for r in sorted(here, key=lambda r: r["time_us_median"]):
                yield "  " + _line(r)
    for r in document.get("refused", ()):
        if r["stage"] in stages:
            yield f"refused: {r['scene']}: {r['method']} {_pairs(r['settings'])}: {r['message']}"
    yield f"{document['elapsed_s']:.0f} s on {document['machine']['processor']}"


def _line(result: dict[str, Any]) -> str:
    scale, unit = (1e6, "um") if result["unit"] == "m" else (1.0, "px")
    marks = ("*" if result["pareto"] else " ") + ("<" if result.get("chosen") else " ")
    return (
        f"{marks} {result['time_us_median']:10.1f} us  {scale * result['error_rms']:10.4g} {unit}"
        f"  {result['method']}  {_pairs(result['settings'])}{told(result, FELT)}"
    )


def _pairs(settings: dict[str, Any]) -> str:
    return " ".join(
        f"{k}={v:.4g}" if isinstance(v, float) else f"{k}={v}" for k, v in settings.items()
    )
