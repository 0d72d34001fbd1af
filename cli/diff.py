"""`vfplan diff`: what differs between two bundles."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import click
from vfplan.cli.run import CommandResult, command
from vfplan.cli.units import count, millimetres
from vfplan.cli.values import FILE


@command("diff")
@click.argument("a", type=FILE, metavar="A.h5")
@click.argument("b", type=FILE, metavar="B.h5")
@click.argument("session", type=FILE, required=False)
def vfplan_diff(a, b, session) -> CommandResult:
    """List what differs between A.h5 and B.h5 (exit 1 if anything does).

    With a SESSION the command replays both and names the first tick in which proxy or force differ.
    The exit code is also 1 if the session touches neither fixture, because that tests nothing.
    """
    from vfplan.bundle import diff

    # What the files hold.
    differences = diff(a, b)
    data: dict[str, Any] = {"differences": differences}
    lines = [difference_line(difference) for difference in differences]
    failed = []
    if differences:
        failed.append(f"{count(len(differences), 'difference')} between {a} and {b}")
    else:
        lines.append("the contents are the same")

    # What they render.
    touched = True
    if session is not None:
        comparison, touched = compare_replays(a, b, session)
        data |= comparison
        tick = comparison["first_tick"]
        if tick is not None:
            failed.append(f"the first tick that differs is {tick}")
            lines.append(
                f"first tick that differs: {tick}, t = {comparison['first_tick_time_s']:.6g} s; "
                f"at most {comparison['proxy_max_m']:.3g} m and "
                f"{comparison['force_max_n']:.3g} N apart"
            )
        elif touched:
            lines.append("both render the session alike")
        if not touched:
            failed.append("not tested: the session touches neither fixture")
            lines.insert(0, "NOT TESTED: the session touches neither fixture")
            clearance = comparison.get("clearance_min_m")
            if clearance is not None:
                lines.append(f"nearest: {millimetres(clearance, 1)}")

    verdict = "pass"
    next_step = "nothing: either bundle may stand for the other"
    if not touched:
        verdict = "not-tested"
        next_step = "give a session that touches the fixtures"
    elif failed:
        verdict = "fail"
        next_step = "; ".join(shlex.join(["vfplan", "info", "--all", str(path)]) for path in (a, b))
        if session is not None:
            command_a = shlex.join(["vfplan", "replay", str(a), str(session)])
            command_b = shlex.join(["vfplan", "replay", str(b), str(session)])
            next_step = f"{command_a}; {command_b}"
    return CommandResult(
        data, "\n".join(lines), failed=", ".join(failed), verdict=verdict, next_step=next_step
    )


def difference_line(difference: dict[str, Any]) -> str:
    """A difference: the place in the file, what differs there, and the values."""
    values = [
        f"{name} {value}" for name, value in difference.items() if name not in ("path", "what")
    ]
    line = f"{difference['path']}: {difference['what']}"
    if values:
        line += f" ({', '.join(values)})"
    return line


def compare_replays(a: Path, b: Path, session: Path) -> tuple[dict[str, Any], bool]:
    """Where the two replays of a session differ, and whether the tool touched a fixture."""
    from vfplan.replaying import replay
    from vfplan.replaying.compare import Comparison
    from vfplan.replaying.verdict import has_touched
    from vfplan.session import read_session

    recorded = read_session(session)
    first = replay(a, recorded)
    second = replay(b, recorded)
    comparison = Comparison()
    comparison.update(first.trace, second.trace)
    report = comparison.report()
    tick = report.get("first_difference_tick")
    data = {
        "first_tick": tick,
        "proxy_max_m": report["proxy_max_m"],
        "force_max_n": report["force_max_n"],
        "ticks": len(recorded.time),
    }
    if tick is not None:
        data["first_tick_time_s"] = float(recorded.time[tick])
    clearances = []
    for replayed in (first, second):
        if "clearance_min_m" in replayed.metrics:
            clearances.append(replayed.metrics["clearance_min_m"])
    if clearances:
        data["clearance_min_m"] = min(clearances)
    touched = has_touched(first.metrics) or has_touched(second.metrics)
    return data, touched
