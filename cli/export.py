"""`vfplan export`: a bundle's points, or its lines and arcs, for other tools."""

from __future__ import annotations

from vfplan.cli.options import FIXTURE, output
from vfplan.cli.outputs import outputs
from vfplan.cli.run import Report, command
from vfplan.cli.values import Written

SUFFIXES = ".ply", ".csv", ".mrk.json", ".dxf"


@command("export")
@FIXTURE
@output("Where to; its ending says the form.", kind=Written(*SUFFIXES))
def command(fixture, output) -> Report:
    """Write the points of FIXTURE.h5 as .ply or .csv [m], its strokes as .mrk.json [mm], or its
    lines and arcs as .dxf [mm].
    """
    from vfplan.bundle import export, left_out, read_fixture

    data = read_fixture(fixture)
    with outputs(output) as (path,):
        export(data, path)
    report = {"output": str(output), "points": len(data.points), "frame": data.frame}
    what = f"{len(data.points)} points"
    if output.name.lower().endswith(".dxf"):
        what = f"{data.pieces.count} lines and arcs"
    text = f"wrote {what} of frame {data.frame} to {output}"
    if missing := left_out(data, output):
        report["left_out"] = missing
        text += f"; left out: {', '.join(missing)}"
    return Report(report, text)
