"""`vfplan info`: a page about a bundle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from vfplan.cli.options import FILE
from vfplan.cli.run import Report
from vfplan.cli.run import command as vfplan_command


@vfplan_command("info", short_help="What a bundle holds.")
@click.argument("fixture", type=FILE, metavar="FIXTURE.h5")
@click.option("--values", is_flag=True, help="In --json, the per-point tables in full too.")
def command(fixture: Path, values: bool) -> Report:
    """Show what FIXTURE.h5 holds: frame, points, rendering, registration and provenance."""
    from vfplan.bundle import describe

    data = describe(fixture, values=values)
    return Report(data, _page(data))


def _page(data: dict[str, Any]) -> str:
    lines = [f"{data['format']} {data['version']}, frame {data['frame']}, {data['points']} points"]
    lines += [f"  {path} = {_short(value)}" for path, value in data.items() if path[0] == "/"]
    return "\n".join(lines)


def _short(value: Any) -> str:
    if isinstance(value, dict):
        shape = " x ".join(map(str, value["shape"]))
        return f"{shape}, from {value['min']:.6g} to {value['max']:.6g}"
    return str(value.tolist() if hasattr(value, "tolist") else value)
