"""`vfplan surface`: a surface through the outlines of a stack of slices."""

from __future__ import annotations

import click

from vfplan.cli.next_commands import register_command
from vfplan.cli.options import (
    FILE,
    MM,
    PNG,
    option,
    options_in_order,
    output_option,
    setting_options,
)
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, announce_if_slow, command
from vfplan.display import Report, wrote
from vfplan.planning.settings import ExtractSettings, FixtureSettings
from vfplan.settings import settings_from_options


@command("surface")
@click.argument("sources", type=FILE, nargs=-1, required=True)
@options_in_order(
    output_option("Write the surface to this bundle, in patient_lps."),
    option("--structure", metavar="NAME|N", help="Take this structure if there are several."),
    option("--tolerance", "tolerance_m", type=MM, default="0.1",
           help="Allow the rendered surface to lie this far from the outlines [mm]."),
    option("--keep-open", is_flag=True,
           help="Leave the ends open.  [default: flat caps half a slice beyond the last outlines]"),
    option("--max-spacing", "max_spacing_m", type=MM,
           help="Interpolate between slices that are this far apart [mm].  [default: 1.5 times "
           "the usual distance]"),
    setting_options(ExtractSettings, "curve_type colour"),
    setting_options(FixtureSettings, "stiffness contact_radius point_radius"),
    option("--picture-out", type=PNG, metavar="PNG",
           help="Write a picture of the surface with the outlines, and three slices of it."),
)  # fmt: skip
def vfplan_surface(sources, output, picture_out, **options) -> CommandResult:
    """Make a surface through the outlines of one structure in SOURCES.

    SOURCES is an RTSTRUCT, a DICOM SEG, a label map (.seg.nrrd, .nii, .nii.gz), one or more Slicer
    .mrk.json of closed curves, or a folder of DICOM slices with a closed curve drawn on each.
    """
    from vfplan.bundle.write import write_fixture
    from vfplan.surface.build import SurfaceSettings, surface

    settings = settings_from_options(SurfaceSettings, options)
    with announce_if_slow("meshing"):
        result = surface(
            *sources, structure=options["structure"], colour=options["colour"], settings=settings
        )
    with outputs(output, picture_out) as (path, picture):
        write_fixture(result.fixture, path)
        if picture is not None:
            from vfplan.surface.figures import draw_surface

            draw_surface(result, picture)
    edges = result.report["open_edges"]
    verdict = f"meshed, with {edges} open edges" if edges else "meshed, closed"
    return CommandResult(
        result.report, f"{surface_text(result.report)}\n{wrote(output)}",
        findings=result.fixture.findings, verdict=verdict,
        next_step=f"{register_command(output)} --model rigid",
    )  # fmt: skip


def surface_text(report: Report) -> str:
    """The report in a few lines."""
    low, high = report["spacing_range_mm"]
    spacing = f"{low:.3g} to {high:.3g}" if high - low >= 1e-3 else f"{low:.3g}"
    sizes_mm = [f"{1e3 * (high - low):.1f}" for low, high in zip(*report["extent_m"], strict=True)]
    volume = report["volume_mm3"]
    is_open = volume is None
    closed = f"{report['open_edges']} open edges" if is_open else f"closed, {volume / 1e3:.2f} cm3"
    error = report["contour_error_mm"]
    return "\n".join(
        (
            f"{report['outlines']} outlines on {report['slices']} slices, {spacing} mm apart",
            f"{report['points']} points, {report['triangles']} triangles, {', '.join(sizes_mm)} mm "
            f"across; {closed}",
            f"from the outlines {error['rms']:.4f} mm rms, {error['max']:.4f} mm at most",
        )
    )
