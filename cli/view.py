"""`vfplan view`: a fixture and a replay in three dimensions."""

from __future__ import annotations

from typing import Any

import click
from vfplan.cli.options import FILE, FIXTURE, OVERWRITE, PNG, option, options_in_order
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, announce_if_slow, command

from vfplan.display import command_of


@command("view")
@FIXTURE
@click.argument("result", type=FILE, required=False, metavar="[RESULT.h5]")
@options_in_order(
    option("--screenshot", type=PNG, metavar="PNG",
           help="Write one view to this picture. It needs no screen."),
    option("--slice", "slice_path", type=FILE, metavar="IMAGE",
           help="Show this slice, on which the curve was drawn (checked by its SHA-256).  "
                "[default: its border only]"),
    OVERWRITE,
)  # fmt: skip
def vfplan_view(fixture, result, screenshot, slice_path) -> CommandResult:
    """Show FIXTURE.h5 in three dimensions.

    With RESULT.h5 (from `vfplan replay -o`) it also shows HIP, proxy, contact sphere and force. The
    window has a time slider. --screenshot needs an OpenGL library (Debian: libosmesa6).
    """
    from vfplan.bundle.read import read_sealed
    from vfplan.images.read import read_slice_of
    from vfplan.review.rendered import check_slice
    from vfplan.session.result import read_result

    planned, seal = read_sealed(fixture)
    ticks = None
    if result is not None:
        ticks, _ = read_result(result, seal["sha256"])
    image = None if slice_path is None else read_slice_of(planned, slice_path)
    if image is not None:
        check_slice(planned, image)

    from vfplan import view3d

    with announce_if_slow("trying how pictures can be drawn here"):
        view3d.ready_pyvista(screen=screenshot is None)
    data: dict[str, Any] = {"points": len(planned.points), "files": []}
    if ticks is not None:
        data["ticks"] = len(ticks)
    next_step = command_of("replay", fixture, "SESSION")
    if screenshot is None:
        view3d.show(planned, ticks, image)
        return CommandResult(data, verdict="seen and closed", next_step=next_step)
    with outputs(screenshot) as (picture,):
        view3d.draw_view(planned, picture, ticks=ticks, image=image)
    data["files"] = [str(screenshot)]
    look = f"look at {screenshot}"
    return CommandResult(data, f"wrote {screenshot}", verdict="drawn", next_step=look)
