"""`vfplan view`: a fixture and a replay in three dimensions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from vfplan.cli.options import FIXTURE, OVERWRITE, option, taking
from vfplan.cli.outputs import outputs
from vfplan.cli.run import Report, command, patience
from vfplan.cli.values import FILE, PNG, Number


@command("view")
@FIXTURE
@click.argument("result", type=FILE, required=False, metavar="[RESULT.h5]")
@taking(
    option("--screenshot", type=PNG, metavar="PNG", help="Write one view; needs no screen."),
    option("--at", "at_s", type=Number("S", positive=False),
           help="The time shown by --screenshot.  [default: the deepest tick]"),
    OVERWRITE,
)  # fmt: skip
def command(fixture, result, screenshot, at_s) -> Report:
    """Show FIXTURE.h5, and with RESULT.h5 (of `replay -o`) HIP, proxy, contact sphere and force.

    Opens a window with a time slider, unless --screenshot is given: that needs no screen, only an
    OpenGL library (Debian: libosmesa6).
    """
    if at_s is not None and (screenshot is None or result is None):
        raise click.UsageError("--at needs --screenshot and RESULT.h5")
    cloud, ticks = _read(fixture, result)
    from vfplan import view3d
    from vfplan.view3d import opengl

    with patience("trying how pictures can be drawn here"):
        opengl.ready_pyvista(screen=screenshot is None)
    data: dict[str, Any] = {"points": len(cloud.points), "files": []}
    if ticks is not None:
        data["ticks"] = len(ticks)
    if screenshot is None:
        view3d.show(cloud, ticks)
        return Report(data)
    with outputs(screenshot) as (picture,):
        view3d.draw_view(cloud, picture, ticks=ticks, at_s=at_s)
    data["files"] = [str(screenshot)]
    return Report(data, f"wrote {screenshot}")


def _read(fixture: Path, result: Path | None) -> tuple[Any, Any]:
    """The fixture, and the ticks of a result that was made with it."""
    from vfplan.bundle import read_sealed
    from vfplan.session import read_result, require_fixture

    planned, seal = read_sealed(fixture)
    if result is None:
        return planned, None
    ticks, attrs = read_result(result)
    require_fixture(attrs, seal.sha256.hex(), result.name)
    return planned, ticks
