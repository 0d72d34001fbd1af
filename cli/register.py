"""`vfplan register`: carry a curve into the robot's frame and make it a fixture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from vfplan.cli import options
from vfplan.cli.options import option
from vfplan.cli.outputs import outputs
from vfplan.cli.run import Report, command
from vfplan.cli.telling import told
from vfplan.cli.values import FILE, Real

TEXT = (
    "{model} registration from {markers} markers: FRE {fre_rms_m:mm} rms, leave-one-out "
    "{loo_rms_m:mm} rms",
    "\n  localisation error (FLE) about {fle_rms_m:mm} a marker\n{table}{marks}",
    "\n  predicted TRE over the curve {tre[rms_m]:mm} rms, at most {tre[max_rms_m]:mm}",
    "\n  95 % bound: {tre[bound95_max_m]:mm} at its worst point ({place}), {tre[curve95_max_m]:mm} "
    "for the whole curve at once",
    "\n  refined by {used} touched points: {touched[before_rms_m]:mm} rms off the surface before, "
    "{touched[rms_m]:mm} after; the surface moved by {touched[moved_max_m]:mm} at most",
    "\n  scale {scale:.6f}",
    "\n  {scale_m_per_px:mm.5}/px, anisotropy {anisotropy:.2%}, shear {shear:+.2%}",
    "; against the known pixel spacing {departure} along u, v",
    "\n  The slice is seen from {seen_from}.",
    "\n{held}{margin}",
)
# What is rendered, and what it costs.
HELD = (
    "{pieces[lines_and_arcs]} lines and arcs within {pieces[error_m]:um.2g} of the curve; {points} "
    "points, {spacing_m:mm} apart, for engines that know points alone",
    "{points} points, {spacing_m:mm} apart",
    "; between points the surface departs from the curve's by at most {sampling_error_m:um.1}",
)
GUIDE = (
    "\nguide: a tube of {radius_m:mm.6g} around {which}, {length_m:mm} long; ends {ends}",
    "{led}",
    "; at least {clearance_min_m:mm} before the forbidden region",
)


@command(
    "register",
    first_screen="-o --model --robust --find-markers --image --max-residual --max-tre "
    "--markers-as-given --common --seen-from --tolerance --stiffness --contact-radius --margin "
    "--guide --json",
    settings_file=True,
)
@click.argument("curve", type=FILE, metavar="CURVE.h5")
@click.argument("markers", type=FILE)
@click.argument("markers2", type=FILE, required=False)
@options.taking(
    options.output("The fixture bundle to write."),
    option("--image", type=FILE, metavar="IMAGE",
           help="The slice the curve was drawn on: the markers are held against the marks on it; "
           "for --find-markers, under --picture-out, and for markers in the patient's frame, to "
           "which a DICOM slice carries the curve."),
    option("--touched", type=FILE, metavar="POINTS.csv",
           help="Points that the robot touched on the surface (x_m,y_m,z_m) refine its rigid "
           "registration."),
    option("--tip-radius", type=Real(min=0), metavar="MM", **options.MILLI,
           help="Radius of the ball that touched them.  [default: 0]"),
    options.MAKING,
)  # fmt: skip
def command(
    curve, markers, markers2, output, image, touched, tip_radius, picture_out, **given
) -> Report:
    """Register CURVE.h5 to the robot by MARKERS and write a fixture bundle.

    MARKERS is one CSV (label,u_px,v_px,x_m,y_m,z_m), or two files joined by label: CSV, Slicer
    .mrk.json or .fcsv.
    """
    from vfplan.bundle import read_fixture, write_fixture
    from vfplan.images.read import read_image
    from vfplan.planning import register

    settings = options.fixture_settings(given)
    if settings.find_markers and image is None:
        raise click.UsageError("--find-markers needs --image, the slice the markers are drawn on")
    if tip_radius is not None and touched is None:
        raise click.UsageError("--tip-radius has no effect without --touched")
    drawn = read_fixture(curve)
    slice_ = None if image is None else read_image(image)
    planned = register(
        drawn, markers, markers2, settings, image=slice_, touched=touched,
        tip_radius=tip_radius or 0.0,
    )  # fmt: skip
    options.hold_campaign(given, planned.fixture)
    with outputs(output, picture_out) as (path, picture):
        write_fixture(planned.fixture, path)
        write_registration_picture(planned, drawn, slice_, picture)
    text = f"{registered_text(planned.report)}\nwrote {output}"
    return Report(planned.report, text, findings=planned.findings)


def write_registration_picture(
    planned: Any, curve: Any, image: Any | None, picture: Path | None
) -> None:
    """Write the registration's picture where one was asked for."""
    if picture is None:
        return
    from vfplan.figures.registration import draw_registration

    draw_registration(planned.registration, curve, picture, image=image)


def registered_text(report: dict[str, Any]) -> str:
    """The registration on a screen."""
    tre, touched = (
        report["tre"]["worst_source"],
        report.get("touched", {"points": 0, "left_out": ()}),
    )
    place = ", ".join(f"{x:.1f}" for x in tre)
    if len(tre) == 3:
        place = ", ".join(f"{1e3 * x:.1f}" for x in tre) + " mm"
    margin = ""
    if "margin" in report:
        margin = told(report["margin"], "\nmargin: {largest_m:mm} added to the point radius")
    more = {
        "table": _marker_table(report),
        "marks": _marks_line(report),
        "place": place,
        "used": touched["points"] - len(touched["left_out"]),
        "held": told(report, *HELD[:1]) or told(report, *HELD[1:]),
        "margin": margin,
    }
    if "spacing_departure" in report and "scale_m_per_px" in report:
        more["departure"] = ", ".join(f"{share:+.2%}" for share in report["spacing_departure"])
    text = told(report | more, *TEXT)
    if "guide" in report:
        guide = report["guide"]
        more = {"length_m": sum(guide["lengths_m"])}
        more["which"] = f"stroke {guide['stroke']}" if "stroke" in guide else "the curve"
        more["led"] = f"; led by {guide['lead_force_n']:g} N" if guide["lead_force_n"] else ""
        text += told(guide | more, *GUIDE)
    return text


def _marker_table(report: dict[str, Any]) -> str:
    width = max(6, *(len(str(marker["label"])) for marker in report["residuals"]))
    lines = [f"  {'marker':<{width}}  residual  leave-one-out  leverage       F  [mm]"]
    moved = {marker["label"]: marker["moved_px"] for marker in report.get("markers_found", ())}
    for marker in report["residuals"]:
        label = marker["label"]
        line = (
            f"  {label!s:<{width}}  {_number(marker['residual_m'], 8, 1e3)}  "
            f"{_number(marker['loo_m'], 13, 1e3)}  {_number(marker['leverage'], 8)}  "
            f"{_number(marker['f'], 6, digits=1)}"
        )
        if label in moved:
            line += f"  found {moved[label]:.2f} px away"
        if not marker["used"]:
            line += "  left out"
        elif label in report["outliers"]:
            line += "  suspect"
        lines.append(line)
    return "\n".join(lines)


def _number(value: float, width: int, scale: float = 1.0, digits: int = 3) -> str:
    known = value == value and abs(value) != float("inf")
    return f"{value * scale:{width}.{digits}f}" if known else f"{'-':>{width}}"


def _marks_line(report: dict[str, Any]) -> str:
    """How the given positions lie to the marks drawn; nothing where these were taken instead."""
    marks = report.get("marks_drawn")
    if marks is None or "markers_found" in report:
        return ""
    if "rms_px" not in marks:
        return "\n  no marks are drawn at the given positions: they are taken as given"
    return told(
        report,
        "\n  {marks_drawn[near]} of {markers} given positions have a mark near them on the slice, "
        "{marks_drawn[rms_px]:.2f} px rms away",
    )
