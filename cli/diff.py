"""`vfplan diff`: what differs between two bundles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from vfplan.cli.run import Report, command
from vfplan.cli.values import FILE


@command("diff")
@click.argument("a", type=FILE, metavar="A.h5")
@click.argument("b", type=FILE, metavar="B.h5")
@click.argument("session", type=FILE, required=False)
def command(a, b, session) -> Report:
    """List what differs between A.h5 and B.h5; exit 1 if anything does.

    With a SESSION both are replayed, and the first tick at which proxy or force differ is named.
    A session that touches neither of them tests nothing: exit 1 too.
    """
    from vfplan.bundle import diff

    differences = diff(a, b)
    data: dict[str, Any] = {"differences": differences}
    lines = [_line(difference) for difference in differences] or ["the contents are the same"]
    failed = []
    if differences:
        plural = "s" * (len(differences) > 1)
        failed.append(f"{len(differences)} difference{plural} between {a} and {b}")
    touched = True
    if session is not None:
        found, touched = _replayed(a, b, session)
        data |= found
        lines.append(_session_line(found, touched))
        if found["first_tick"] is not None:
            failed.append(f"the first tick that differs is {found['first_tick']}")
        if not touched:
            lines.insert(0, "NOT TESTED: the session touches neither fixture")
            failed.append("not tested: the session touches neither fixture")
    if not touched:
        verdict, next_step = "not-tested", "give a session that touches the fixtures"
    elif failed:
        verdict, next_step = "fail", "vfplan replay FIXTURE.h5 SESSION shows what each renders"
    else:
        verdict, next_step = "pass", "nothing: either bundle may stand for the other"
    return Report(
        data, "\n".join(lines), failed=", ".join(failed), verdict=verdict, next_step=next_step
    )


def _line(difference: dict[str, Any]) -> str:
    rest = ", ".join(f"{k} {v}" for k, v in difference.items() if k not in ("path", "what"))
    return f"{difference['path']}: {difference['what']}" + (f" ({rest})" if rest else "")


def _session_line(found: dict[str, Any], touched: bool) -> str:
    tick = found["first_tick"]
    if tick is not None:
        return (
            f"first tick that differs: {tick}, t = {found['first_tick_time_s']:.6g} s; at most "
            f"{found['proxy_max_m']:.3g} m and {found['force_max_n']:.3g} N apart"
        )
    if touched:
        return "both render the session alike"
    return f"nearest: {1e3 * found['clearance_min_m']:.1f} mm"


def _replayed(a: Path, b: Path, session: Path) -> tuple[dict[str, Any], bool]:
    """Where the two replays of a session differ, and whether the tool touched a fixture."""
    from vfplan.replaying import replay
    from vfplan.replaying.compare import Comparison
    from vfplan.replaying.limits import has_touched
    from vfplan.session import read_session

    recorded = read_session(session)
    replays = [replay(path, recorded) for path in (a, b)]
    apart = Comparison()
    apart.update(*(replayed.trace for replayed in replays))
    found = apart.report()
    tick = found.get("first_difference_tick")
    data = {"first_tick": tick, **{name: found[name] for name in ("proxy_max_m", "force_max_n")}}
    data["ticks"] = len(recorded.time)
    if tick is not None:
        data["first_tick_time_s"] = float(recorded.time[tick])
    clearances = [r.metrics["clearance_min_m"] for r in replays if "clearance_min_m" in r.metrics]
    if clearances:
        data["clearance_min_m"] = min(clearances)
    touched = any(has_touched(replayed.metrics) for replayed in replays)
    return data, touched
