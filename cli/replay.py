"""`vfplan replay`: what a controller would have rendered over a recorded session."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click
from vfplan.cli import options
from vfplan.cli.run import Report, outputs, progress, refuse_existing
from vfplan.cli.run import command as vfplan_command


@vfplan_command("replay", short_help="Replay a session against a fixture.")
@click.argument("fixture", type=options.FILE)
@click.argument("session", type=options.FILE)
@options.output("Per-tick result, HDF5.", required=False)
@click.option("--csv", "csv_out", type=options.FILE, help="Per-tick result as CSV.")
@click.option(
    "--rule",
    type=click.Choice(["robust", "paper", "both"]),
    default="robust",
    show_default=True,
    help="How the proxy moves; `both` replays the two side by side.",
)
@click.option(
    "--engine",
    type=click.Choice(["native", "reference"]),
    default="native",
    show_default=True,
    help="The controller's own core, or the paper's algorithms in NumPy (rule `paper` only).",
)
@click.option(
    "--units",
    type=click.Choice(["m", "mm"]),
    default="m",
    show_default=True,
    help="Unit of the session's positions.",
)
@click.option(
    "--frame", default="robot_base", show_default=True, help="Frame of the session's positions."
)
def command(
    fixture: Path,
    session: Path,
    output: Path | None,
    csv_out: Path | None,
    overwrite: bool,
    rule: str,
    engine: str,
    units: str,
    frame: str,
) -> Report:
    """Replay SESSION (a recording of HIP positions) against FIXTURE, tick by tick.

    Reports contact episodes, forces, penetration, energy and timing; every number is defined in
    docs/replay.md.
    """
    from vfplan.replay import replay
    from vfplan.session import open_session

    refuse_existing(output, csv_out, overwrite=overwrite)
    source = open_session(session, units=units, frame=frame)
    with (
        outputs(output, csv_out) as (result_path, csv_path),
        progress("replay", source.ticks or 0) as done,
        ExitStack() as files,
    ):
        sinks = [lambda rule, block: done(len(block))]
        sinks += _files(files, result_path, csv_path, rule)
        replayed = replay(fixture, source, rule=rule, engine=engine, keep=0, sinks=sinks)
    return Report(replayed.metrics, replay_text(replayed.metrics))


def _files(files: ExitStack, result: Path | None, table: Path | None, rule: str) -> list[Any]:
    """Sinks that write the result and the CSV; closed with `files`."""
    from vfplan.session import CsvWriter, ResultWriter

    sinks: list[Any] = []
    if result is not None:
        groups = ("", "paper") if rule == "both" else ("",)
        writer = files.enter_context(ResultWriter(result, {"rule": rule}, groups=groups))
        second = {"paper": "paper"} if rule == "both" else {}
        sinks.append(lambda name, block: writer.append(block, second.get(name, "")))
    if table is not None:
        lines = files.enter_context(CsvWriter(table))
        first = "robust" if rule == "both" else rule
        sinks.append(lambda name, block: lines.append(block) if name == first else None)
    return sinks


def replay_text(found: dict[str, Any]) -> str:
    """The short report a person reads."""
    lines = [
        f"rule {found['rule']}: {found['ticks']} ticks, {found['duration_s']:.3f} s, "
        f"{found['contact_ticks']} in contact, {len(found['episodes'])} episodes",
        f"penetration  max {1e3 * found['penetration_max_m']:.3f} mm, "
        f"rms {1e3 * found['penetration_rms_m']:.3f} mm; "
        f"overlap max {1e3 * found['overlap_max_m']:.3f} mm",
        f"force        max {found['force_max_n']:.3f} N, rms {found['force_rms_n']:.3f} N, "
        f"step max {found['force_step_max_n']:.3f} N",
        f"clearance    min {1e3 * found['clearance_min_m']:.4f} mm; "
        f"{found['entrenched_ticks']} ticks entrenched",
        f"energy       {found['energy_j']:.6f} J to the hand, "
        f"{found['energy_hold_j']:.6f} J of it from sampling",
        "time a tick  {median:.2f} µs median, {p999:.2f} µs p99.9, {max:.2f} µs max".format(
            **found["step_us"]
        ),
    ]
    for episode in found["episodes"][:20]:
        lines.append(
            f"  episode {episode['index']}: {episode['start_s']:.3f}-{episode['end_s']:.3f} s, "
            f"{1e3 * episode['penetration_max_m']:.3f} mm deep, {episode['force_max_n']:.3f} N"
        )
    if len(found["episodes"]) > 20:
        lines.append(f"  and {len(found['episodes']) - 20} more (--json has all)")
    lines += [f"{f['severity']}: {f['code']}: {f['message']}" for f in found["findings"]]
    return "\n".join(lines)
