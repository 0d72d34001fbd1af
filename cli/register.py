"""`vfplan register`: carry a curve into the robot's frame and make it a fixture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from vfplan.cli import options
from vfplan.cli.extract import findings_verdict
from vfplan.cli.next_commands import page_shows, register_command, review_command
from vfplan.cli.options import FILE, MM_OR_ZERO, option, options_in_order, output_option
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, command

from vfplan.display import Report, count, micrometres, millimetres, wrote


@command(
    "register",
    first_screen="-o --model --robust --find-markers --image --max-residual --max-tre "
    "--markers-as-given --common --seen-from --tolerance --stiffness --contact-radius --margin "
    "--guide --json",
    settings_file=True,
)
@click.argument("curve", type=FILE, metavar="CURVE.h5")
@options.MARKERS
@options_in_order(
    output_option("Write the fixture to this bundle."),
    option("--image", type=FILE, metavar="IMAGE",
           help="Compare the markers with the marks on this slice, on which the curve was drawn."),
    option("--touched", type=FILE, metavar="POINTS.csv",
           help="Refine a surface's registration by points that the robot touched on it "
           "(x_m,y_m,z_m) [m]."),
    option("--tip-radius", type=MM_OR_ZERO,
           help="Radius of the ball that touched them [mm].  [default: 0]"),
    options.TIP,
    options.FIXTURE_OPTIONS,
)  # fmt: skip
def vfplan_register(
    curve, markers, markers2, output, image, touched, tip_radius, picture_out, **arguments
) -> CommandResult:
    """Register CURVE.h5 to the robot by MARKERS and write a fixture bundle.

    MARKERS is one CSV (label,u_px,v_px,x_m,y_m,z_m), or two files joined by label: CSV, Slicer
    .mrk.json or .fcsv.
    """
    from vfplan.bundle.read import read_fixture
    from vfplan.bundle.write import write_fixture
    from vfplan.images.read import read_slice_of
    from vfplan.planning.plan import planning_of, register
    from vfplan.stability.study import with_verdict_by

    drawn = read_fixture(curve)
    settings = planning_of(drawn, options.given_of_plan(arguments))
    if touched is None:
        options.refuse_unused("without --touched POINTS.csv", "tip_radius")
    slice_image = read_slice_of(drawn, image) if image is not None else None
    planned = register(
        drawn, markers, markers2, settings, image=slice_image, touched=touched,
        tip_radius=tip_radius or 0.0, tip=arguments["tip"],
    )  # fmt: skip
    options.check_campaign_matches(arguments, planned.fixture)
    fixture = with_verdict_by(drawn.provenance.settings, planned.fixture)
    with outputs(output, picture_out) as (path, picture):
        write_fixture(fixture, path)
        write_registration_picture(planned, drawn, slice_image, picture)
    if fixture.frame == "robot_base":
        # The page shows a curve on its own slice alone, so another image is not named.
        is_other = any(finding.code == "image-other" for finding in planned.findings)
        if is_other or (image is None and fixture.image is not None):
            image = output.parent
        has_page = page_shows(fixture, has_slice=image is not None)
        next_step = review_command(output, image, has_page=has_page)
    else:
        next_step = register_command(output)
    return CommandResult(
        planned.report, f"{registered_text(planned.report)}\n{wrote(output)}",
        findings=planned.findings, verdict=findings_verdict("registered", fixture),
        next_step=next_step,
    )  # fmt: skip


def write_registration_picture(
    planned: Any, curve: Any, image: Any | None, picture: Path | None
) -> None:
    """Write the picture of the registration, where it is wanted."""
    if picture is not None:
        from vfplan.figures.registration import draw_registration

        draw_registration(planned.registration, curve, picture, image=image)


def registered_text(report: Report) -> str:
    """The registration on a screen: how well the markers fit, and how far off the curve may be."""
    residuals = report["residuals"]
    used = [marker for marker in residuals if marker["used"]]
    worst = max(used, key=lambda marker: marker["residual_m"])
    markers = count(len(used), "marker")
    if len(used) < report["markers"]:
        markers = f"{len(used)} of {report['markers']} markers"
    lines = [
        f"{markers} ({report['model']}) fit to {millimetres(report['fre_rms_m'])} rms; the "
        f"largest residual is that of {worst['label']}, {millimetres(worst['residual_m'])}",
        "  95 % bound of the error on the whole curve: "
        f"{millimetres(report['tre']['curve95_max_m'])}",
    ]
    if unused := [str(marker["label"]) for marker in residuals if not marker["used"]]:
        lines.append(f"  left out: {', '.join(unused)}")
    if suspect := [str(m["label"]) for m in used if m["label"] in report["outliers"]]:
        lines.append(f"  suspect: {', '.join(suspect)}")
    if "markers_found" in report:
        moved_px = max(marker["moved_px"] for marker in report["markers_found"])
        lines.append(f"  the marks on the slice are up to {moved_px:.2f} px away")
    if "touched" in report:
        refined = report["touched"]
        used = refined["points"] - len(refined["left_out"])
        lines.append(
            f"  refined by {used} touched points: {millimetres(refined['before_rms_m'])} rms off "
            f"the surface before, {millimetres(refined['rms_m'])} after; the surface moved by "
            f"{millimetres(refined['moved_max_m'])} at most"
        )
    if report.get("seen_from"):
        lines.append(f"  The slice is seen from {report['seen_from']}.")
    line = f"{report['points']} points, {millimetres(report['spacing_m'])} apart"
    if "pieces" in report:
        pieces = report["pieces"]
        error = micrometres(pieces["error_m"], 1)
        line = f"{pieces['lines_and_arcs']} lines and arcs within {error} of the curve"
    if "sampling_error_m" in report:
        line += (
            "; between points the surface departs from the curve's by at most "
            f"{micrometres(report['sampling_error_m'], 1)}"
        )
    lines.append(line)
    if "margin" in report:
        lines.append(
            f"margin: {millimetres(report['margin']['largest_m'])} added to the point radius"
        )
    if "guide" in report:
        guide = report["guide"]
        which = f"stroke {guide['stroke']}" if "stroke" in guide else "the curve"
        line = (
            f"guide: a tube of {1e3 * guide['radius_m']:.6g} mm around {which}, "
            f"{millimetres(sum(guide['lengths_m']))} long; ends {guide['ends']}"
        )
        if guide["lead_force_n"]:
            line += f"; led by {guide['lead_force_n']:g} N"
        if "clearance_min_m" in guide:
            line += (
                f"; at least {millimetres(guide['clearance_min_m'])} before the forbidden region"
            )
        lines.append(line)
    return "\n".join(lines)
