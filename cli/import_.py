"""`vfplan import`: a bundle from any point cloud or mesh."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import click
from vfplan.cli.options import option, output, taking
from vfplan.cli.outputs import outputs
from vfplan.cli.run import Report, command
from vfplan.cli.values import FILE, MM, Number, Numbers

from vfplan.findings import Finding

AXES = {"none": None, "x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


@command("import")
@click.argument("cloud", type=FILE, metavar="CLOUD.ply|stl|csv|npy")
@taking(
    option("--units", type=click.Choice(["m", "cm", "mm", "um", "in"]), required=True,
           help="Unit of the file's numbers; files do not say."),
    option("--frame", type=click.Choice(["robot_base", "patient_lps"]), default="robot_base",
           help="Frame of the file's numbers."),
    option("--curve", type=click.Choice(["open", "closed"]),
           help="The points, not a mesh's, are one curve, in order; otherwise a bare cloud, which "
           "nothing certifies."),
    option("--spacing", type=MM, help="Longest edge of a mesh.  [default: R/10]"),
    option("--stiffness", type=Numbers(1, 3, metavar="N_PER_M[,Y,Z]", positive=False),
           default="1000", help="K along the axes of the frame."),
    option("--contact-radius", type=MM, default="5", help="The proxy's radius r_c."),
    option("--point-radius", type=Number("MM", 1e-3, positive=False), default="0",
           help="Radius r_v of each point."),
    option("--ignore-axis", type=click.Choice(list(AXES)), default="none",
           help="The fixture is infinite along it."),
    output("The fixture bundle."),
)  # fmt: skip
def command(cloud, output, **given) -> Report:
    """Make a fixture bundle of the points in CLOUD; a mesh is sampled and certified."""
    from vfplan.bundle import import_cloud, read_bundle, write_fixture
    from vfplan.engine.renderable import best_rule

    fixture = import_cloud(cloud, **given | {"ignore_axis": AXES[given["ignore_axis"]]})
    findings = _findings(fixture)
    fixture = replace(fixture, findings=(*fixture.findings, *findings))
    with outputs(output) as (path,):
        write_fixture(fixture, path)
        content, _ = read_bundle(path)
    data = {
        "output": str(output),
        "points": len(fixture.points),
        "triangles": 0 if fixture.mesh is None else len(fixture.mesh),
        "rule": best_rule(fixture) if fixture.rendering else None,
        "band_m": fixture.band,
        "leak": {p: content[p] for p in content if p.startswith("/leak@")},
        "extent_m": [fixture.points.min(axis=0), fixture.points.max(axis=0)],
    }
    size = ", ".join(f"{1e3 * (b - a):.4g}" for a, b in zip(*data["extent_m"], strict=True))
    certified = "certified" if content["/leak@certified"] else "not certified"
    opening = f"largest opening {1e3 * content['/leak@largest_m']:.3f} mm"
    if content["/leak@kind"] == "cloud":  # what its points leave open nothing says
        opening = f"no point further than {1e3 * content['/leak@largest_m']:.3f} mm from the next"
        opening = opening if data["points"] > 1 else "a single point"
    text = (
        f"{data['points']} points, {data['triangles']} triangles, {size} mm across;"
        f" {content['/leak@kind']}, {certified}: {opening}"
    )
    text += f"; rule {data['rule']}" if data["rule"] else ""
    text += f"\nwrote {output}"
    warnings = _warnings(fixture, content["/leak@largest_m"])
    return Report(data, text, warnings=warnings, findings=findings)


def _findings(fixture: Any) -> list[Finding]:
    """What the mesh or the band is too coarse for; what no engine renders is warned of already."""
    from vfplan.engine.renderable import mesh_findings
    from vfplan.errors import SceneError

    try:
        return mesh_findings(fixture)
    except SceneError:
        return []


def _warnings(fixture: Any, opening: float) -> list[str]:
    from vfplan.bundle.validation import engine_doubt, mesh_doubts
    from vfplan.fixture import size_doubt

    left_out = fixture.provenance.settings.get("left_out")
    doubts = size_doubt(fixture.points), (engine_doubt(fixture) or ("", None))[1]
    found = [doubt for doubt in doubts if doubt]
    if left_out:
        found.append(f"the file says more than the fixture holds, which is left out: {left_out}")
    if fixture.mesh is not None:
        return found + mesh_doubts(fixture)
    wide = 2 * (fixture.contact_radius + fixture.point_radius)
    if fixture.curve is None and opening > wide:
        found.append(
            f"a bare cloud, and a point is {1e3 * opening:.3g} mm from the next: the proxy, "
            f"{1e3 * wide:g} mm wide, goes between"
        )
    return found
