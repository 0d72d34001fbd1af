"""`vfplan register`: carry a curve into the robot's frame and make it a fixture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from vfplan.cli.options import (
    MAKING,
    MILLI,
    fixture_settings,
    hold_campaign,
    option,
    output,
    taking,
)
from vfplan.cli.outputs import outputs
from vfplan.cli.run import Report, command
from vfplan.cli.values import FILE, Real, mm

if TYPE_CHECKING:
    from vfplan.fixture import Fixture
    from vfplan.images.read import PlannedImage
    from vfplan.planning import Planned


@command("register")
@click.argument("curve", type=FILE, metavar="CURVE.h5")
@click.argument("markers", type=FILE)
@click.argument("markers2", type=FILE, required=False)
@taking(
    output("The fixture bundle to write."),
    option("--image", type=FILE, metavar="IMAGE",
           help="The slice the curve was drawn on: the markers are held against the marks on it; "
           "for --find-markers, under --picture-out, and for markers in the patient's frame, to "
           "which a DICOM slice carries the curve."),
    option("--touched", type=FILE, metavar="POINTS.csv",
           help="Points that the robot touched on the surface (x_m,y_m,z_m) refine its rigid "
           "registration."),
    option("--tip-radius", type=Real(min=0), metavar="MM", **MILLI,
           help="Radius of the ball that touched them.  [default: 0]"),
    MAKING,
)  # fmt: skip
def command(
    curve: Path,
    markers: Path,
    markers2: Path | None,
    output: Path,
    image: Path | None,
    touched: Path | None,
    tip_radius: float | None,
    picture_out: Path | None,
    **given: Any,
) -> Report:
    """Register CURVE.h5 to the robot by MARKERS and write a fixture bundle.

    MARKERS is one CSV (label,u_px,v_px,x_m,y_m,z_m), or two files joined by label: CSV, Slicer
    .mrk.json or .fcsv.
    """
    from vfplan.bundle import read_fixture, write_fixture
    from vfplan.images.read import read_image
    from vfplan.planning import register

    settings = fixture_settings(given)
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
    hold_campaign(given, planned.fixture)
    with outputs(output, picture_out) as (path, picture):
        write_fixture(planned.fixture, path)
        write_registration_picture(planned, drawn, slice_, picture)
    text = f"{registered_text(planned.report)}\nwrote {output}"
    return Report(planned.report, text, warnings=list(planned.warnings))


def write_registration_picture(
    planned: Planned, curve: Fixture, image: PlannedImage | None, picture: Path | None
) -> None:
    """Write the registration's picture where one was asked for."""
    if picture is None:
        return
    from vfplan.figures.registration import draw_registration

    draw_registration(planned.registration, curve, picture, image=image)


def registered_text(report: dict[str, Any]) -> str:
    """The registration on a screen."""
    lines = [
        f"{report['model']} registration from {report['markers']} markers: "
        f"FRE {mm(report['fre_rms_m'])} rms, leave-one-out {mm(report['loo_rms_m'])} rms",
        f"  localisation error (FLE) about {mm(report['fle_rms_m'])} a marker",
        *_marker_lines(report),
        *_marks_line(report),
        *_error_lines(report["tre"]),
        *_touched_lines(report),
        *_geometry_lines(report),
        _held_line(report),
    ]
    if "margin" in report:
        lines.append(_margin_line(report["margin"]))
    if "guide" in report:
        lines.append(_guide_line(report["guide"]))
    return "\n".join(lines)


def _marker_lines(report: dict[str, Any]) -> list[str]:
    width = max(6, *(len(str(marker["label"])) for marker in report["residuals"]))
    lines = [f"  {'marker':<{width}}  residual  leave-one-out  leverage       F  [mm]"]
    moved = {marker["label"]: marker["moved_px"] for marker in report.get("markers_found", ())}
    reasons = {suspect["label"]: suspect["reason"] for suspect in report["suspects"]}
    for marker in report["residuals"]:
        label = marker["label"]
        line = (
            f"  {label!s:<{width}}  {_number(marker['residual_m'], 8, 1e3)}  "
            f"{_number(marker['loo_m'], 13, 1e3)}  {_number(marker['leverage'], 8)}  "
            f"{_number(marker['f'], 6, digits=1)}"
        )
        if label in moved:
            line += f"  found {moved[label]:.2f} px away"
        if label in reasons:
            line += f"  suspect: {reasons[label]}"
        lines.append(line)
    return lines


def _marks_line(report: dict[str, Any]) -> list[str]:
    """How the given positions lie to the marks drawn; nothing where these were taken instead."""
    marks = report.get("marks_drawn")
    if marks is None or "markers_found" in report:
        return []
    if not marks["near"]:
        return ["  the slice shows no marks at the given positions: they are taken as given"]
    return [
        f"  {marks['near']} of {report['markers']} given positions have a mark near them on the "
        f"slice, {marks['rms_px']:.2f} px rms away"
    ]


def _number(value: float, width: int, scale: float = 1.0, digits: int = 3) -> str:
    known = value == value and abs(value) != float("inf")
    return f"{value * scale:{width}.{digits}f}" if known else f"{'-':>{width}}"


def _error_lines(tre: dict[str, Any]) -> list[str]:
    place = ", ".join(f"{x:.1f}" for x in tre["worst_source"])
    if len(tre["worst_source"]) == 3:
        place = ", ".join(f"{1e3 * x:.1f}" for x in tre["worst_source"]) + " mm"
    return [
        f"  predicted TRE over the curve {mm(tre['rms_m'])} rms, at most {mm(tre['max_rms_m'])}",
        f"  95 % bound: {mm(tre['bound95_max_m'])} at its worst point ({place}), "
        f"{mm(tre['curve95_max_m'])} for the whole curve at once",
    ]


def _touched_lines(report: dict[str, Any]) -> list[str]:
    if "touched" not in report:
        return []
    touched = report["touched"]
    used = touched["points"] - len(touched["left_out"])
    return [
        f"  refined by {used} touched points: {mm(touched['before_rms_m'])} rms off the surface "
        f"before, {mm(touched['rms_m'])} after; the surface moved by {mm(touched['moved_max_m'])}"
        " at most",
    ]


def _geometry_lines(report: dict[str, Any]) -> list[str]:
    if "scale_m_per_px" not in report:
        return [f"  scale {report['scale']:.6f}"]
    faces = ", ".join(f"{x:+.3f}" for x in report["image_faces"])
    line = (
        f"  {report['scale_m_per_px'] * 1e3:.5f} mm/px, anisotropy {report['anisotropy']:.2%}, "
        f"shear {report['shear']:+.2%}; the image faces ({faces})"
    )
    if "spacing_departure" in report:
        shares = ", ".join(f"{share:+.2%}" for share in report["spacing_departure"])
        line += f"; against the known pixel spacing {shares} along u, v"
    return [line]


def _guide_line(guide: dict[str, Any]) -> str:
    which = f"stroke {guide['stroke']}" if "stroke" in guide else "the curve"
    line = (
        f"guide: a tube of {1e3 * guide['radius_m']:g} mm around {which}, "
        f"{mm(sum(guide['lengths_m']))} long; ends {guide['ends']}"
    )
    if guide["lead_force_n"]:
        line += f"; led by {guide['lead_force_n']:g} N"
    if "clearance_min_m" in guide:
        line += f"; at least {mm(guide['clearance_min_m'])} before the forbidden region"
    return line


def _held_line(report: dict[str, Any]) -> str:
    """What is rendered, and what it costs."""
    points = f"{report['points']} points, {mm(report['spacing_m'])} apart"
    if "pieces" in report:
        pieces = report["pieces"]
        return (
            f"{pieces['lines_and_arcs']} lines and arcs within {pieces['error_m'] * 1e6:.2g} um of "
            f"the curve; {points}, for engines that know points alone"
        )
    if "sampling_error_m" in report:
        points += (
            f"; between points the surface departs from the curve's by at most "
            f"{report['sampling_error_m'] * 1e6:.1f} um"
        )
    return points


def _margin_line(margin: dict[str, Any]) -> str:
    if margin["side"] == "both":
        return f"margin: {mm(margin['largest_m'])} added to the point radius"
    return (
        f"margin: the curve moved {mm(margin['smallest_m'])} to {mm(margin['largest_m'])} "
        f"to the {margin['side']}, {margin['samples_dropped']} samples dropped in tight bends"
    )
