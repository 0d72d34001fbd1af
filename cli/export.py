"""`vfplan export`: a bundle's points, or its lines and arcs, for other tools."""

from __future__ import annotations

from vfplan.cli.options import FIXTURE, output_option
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, command
from vfplan.cli.units import count
from vfplan.cli.values import OutputFile


@command("export")
@FIXTURE
@output_option(
    "Write this file. Its suffix says the format: .ply, .csv, .mrk.json or .dxf.",
    kind=OutputFile(".ply", ".csv", ".mrk.json", ".dxf"),
)
def vfplan_export(fixture, output) -> CommandResult:
    """Write the points of FIXTURE.h5 as .ply or .csv [m], its strokes as .mrk.json [mm], or its
    lines and arcs as .dxf [mm].
    """
    from vfplan.bundle import export, left_out, read_fixture

    exported = read_fixture(fixture)
    with outputs(output) as (path,):
        export(exported, path)
    data = {"output": str(output), "points": len(exported.points), "frame": exported.frame}
    what = count(len(exported.points), "point")
    if output.name.lower().endswith(".dxf"):
        what = f"{exported.pieces.count} lines and arcs"
    text = f"wrote {what} of frame {exported.frame} to {output}"
    verdict = f"exported {what}"
    missing = left_out(exported, output)
    if missing:
        data["left_out"] = missing
        verdict += f", without {', '.join(missing)}, which this format does not hold"
    return CommandResult(
        data, text, verdict=verdict,
        next_step=f"open {output} in your tool; vfplan import reads .ply and .csv back",
    )  # fmt: skip
