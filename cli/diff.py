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
    """
    from vfplan.bundle import diff

    differences = diff(a, b)
    data: dict[str, Any] = {"differences": differences}
    lines = [_line(difference) for difference in differences] or ["the contents are the same"]
    if session is not None:
        data |= _replayed(a, b, session)
        tick = data["first_tick"]
        lines.append(
            "both render the session alike"
            if tick is None
            else f"first tick that differs: {tick}, t = {data['first_tick_time_s']:.6g} s; at most"
            f" {data['proxy_max_m']:.3g} m and {data['force_max_n']:.3g} N apart"
        )
    count, tick = len(differences), data.get("first_tick")
    failed = [f"{count} difference{'s' * (count > 1)} between {a} and {b}"] if count else []
    failed += [] if tick is None else [f"the first tick that differs is {tick}"]
    return Report(data, "\n".join(lines), failed=", ".join(failed))


def _line(difference: dict[str, Any]) -> str:
    rest = ", ".join(f"{k} {v}" for k, v in difference.items() if k not in ("path", "what"))
    return f"{difference['path']}: {difference['what']}" + (f" ({rest})" if rest else "")


def _replayed(a: Path, b: Path, session: Path) -> dict[str, Any]:
    from vfplan.replaying import replay
    from vfplan.replaying.apart import Apart
    from vfplan.session import read_session

    recorded, apart = read_session(session), Apart()
    apart.update(*(replay(path, recorded).trace for path in (a, b)))
    found = apart.report()
    tick = found.get("first_difference_tick")
    data = {"first_tick": tick, **{name: found[name] for name in ("proxy_max_m", "force_max_n")}}
    data["ticks"] = len(recorded.time)
    return data if tick is None else data | {"first_tick_time_s": float(recorded.time[tick])}
