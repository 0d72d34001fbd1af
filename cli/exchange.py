"""`vfplan import` and `export`: from other tools' clouds and meshes to a bundle, and back."""

from __future__ import annotations

from dataclasses import replace

import click
from vfplan.cli import options
from vfplan.cli.next_commands import register_command, review_command
from vfplan.cli.options import FILE, FIXTURE, OutputFile, option, options_in_order, output_option
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, command

from vfplan.display import count, or_not, quoted, wrote
from vfplan.planning.settings import FixtureSettings

AXES = {"none": None, "x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


@command("import")
@click.argument("cloud", type=FILE, metavar="CLOUD.ply|stl|obj|csv|npy")
@options_in_order(
    option("--units", type=options.UNIT, required=True,
           help="Unit of the numbers in the file."),
    option("--frame", type=click.Choice(["robot_base", "patient_lps"]),
           help="Frame of the numbers in the file.  [default: robot_base, or patient_lps if the "
           "file says SPACE=]"),
    option("--curve", type=click.Choice(["open", "closed"]),
           help="Take the points as one curve, in their order.  [default: a bare cloud, without a "
           "leak certificate]"),
    option("--spacing", type=options.MM,
           help="Distance between the samples that rules robust and paper take of a mesh [mm].  "
           "[default: R/10]"),
    options.setting_options(FixtureSettings, "stiffness contact_radius point_radius"),
    option("--ignore-axis", type=click.Choice(list(AXES)), default="none",
           help="Extend the fixture without end along this axis."),
    output_option("Write the fixture to this bundle."),
)  # fmt: skip
def vfplan_import(cloud, output, ignore_axis, **arguments) -> CommandResult:
    """Make a fixture bundle of the points or the mesh in CLOUD."""
    from vfplan.bundle.importing import import_cloud
    from vfplan.bundle.read import read_bundle
    from vfplan.bundle.validation import engine_doubt, opening_in_words
    from vfplan.bundle.write import write_fixture
    from vfplan.engine.proxy import best_rule, mesh_findings
    from vfplan.errors import SceneError
    from vfplan.fixture import size_doubt

    fixture = import_cloud(cloud, ignore_axis=AXES[ignore_axis], **arguments)
    try:
        findings = [*mesh_findings(fixture)]
    except SceneError:
        # The warnings below say that no engine renders it.
        findings = []
    fixture = replace(fixture, findings=(*fixture.findings, *findings))
    with outputs(output) as (path,):
        write_fixture(fixture, path)
        content, _ = read_bundle(path)

    low, high = fixture.points.min(axis=0), fixture.points.max(axis=0)
    triangles = len(content.get("/mesh/triangles", ()))
    rule = best_rule(fixture) if fixture.rendering else None
    data = {
        "output": str(output), "points": len(fixture.points), "triangles": triangles, "rule": rule,
        "band_m": fixture.band, "frame": fixture.frame,
        "leak": {name: content[name] for name in content if name.startswith("/leak@")},
        "extent_m": [low, high],
    }  # fmt: skip

    # What was read, and whether anything can slip through it.
    size = ", ".join(f"{1e3 * side:.4g}" for side in high - low)
    certified = or_not(content["/leak@certified"], "certified")
    if content["/leak@kind"] == "mesh":
        certified = f"each triangle {certified}"
    text = (
        f"{data['points']} points, {triangles} triangles, {size} mm across in {fixture.frame}; "
        f"{content['/leak@kind']}, {certified}: {opening_in_words(content)}"
    )
    if rule is not None:
        text += f"; rule {rule}"
    text += f"\n{wrote(output)}"
    next_step = review_command(output, None, has_page=False)
    if fixture.frame == "patient_lps":
        next_step = f"{register_command(output)} --model rigid"
    # Doubts about its size, about its engine, and about what was ignored.
    _, no_engine = engine_doubt(fixture) or ("", "")
    warnings = [size_doubt(fixture.points), no_engine]
    if ignored := fixture.provenance.settings.get("left_out"):
        warnings.append(f"the file says more than the fixture holds, which is left out: {ignored}")
    return CommandResult(
        data, text, warnings=[*filter(None, warnings)], findings=fixture.findings,
        verdict=f"imported, {certified}", next_step=next_step,
    )  # fmt: skip


@command("export")
@FIXTURE
@output_option(
    "Write this file. Its suffix says the format: .ply, .stl, .csv, .mrk.json, .dxf, "
    ".rtstruct.dcm or .seg.dcm.",
    kind=OutputFile(".ply", ".stl", ".csv", ".mrk.json", ".dxf", ".rtstruct.dcm", ".seg.dcm"),
)
@option("--study", type=FILE, metavar="SLICE.dcm",
        help="Write the .dcm into the patient and study of this slice.")  # fmt: skip
def vfplan_export(fixture, output, study) -> CommandResult:
    """Write the points of FIXTURE.h5 as .ply or .csv [m], its mesh as .stl [mm], its strokes as
    .mrk.json [mm], or its lines and arcs as .dxf [mm]. For a PACS write its strokes as
    .rtstruct.dcm, or the inside of its closed mesh as .seg.dcm.
    """
    from vfplan.bundle.dicom import in_patient
    from vfplan.bundle.exporting import export, left_out
    from vfplan.bundle.read import read_fixture

    exported = read_fixture(fixture)
    with outputs(output) as (path,):
        export(exported, path, study=study)
    # The frame that the file is in: a .dcm is the patient's, as are others where one knows how.
    frame, ending = exported.frame, output.name.lower()
    if ending.endswith((".mrk.json", ".stl")):
        frame = in_patient(exported, exported.points)[1]
    elif ending.endswith(".dcm"):
        frame = "patient_lps"
    data = {"output": str(output), "points": len(exported.points), "frame": frame}
    what = count(len(exported.points), "point")
    if ending.endswith(".dxf"):
        what = f"{exported.pieces.count} lines and arcs"
    text = f"wrote {what} of frame {frame} to {quoted(output)}"
    verdict = f"exported {what}"
    if missing := left_out(exported, output):
        data["left_out"] = missing
        verdict += f", without {', '.join(missing)}, which this format does not hold"
    warnings = []
    if frame == "robot_base" and ending.endswith((".mrk.json", ".stl")):
        warnings.append(
            "the points are the robot's, which Slicer takes for LPS: do not lay them over a patient"
        )
    return CommandResult(
        data, text, warnings=warnings, verdict=verdict,
        next_step=f"open {output} in your tool; vfplan import reads .ply and .csv back",
    )  # fmt: skip
