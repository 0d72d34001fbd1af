"""A curve drawn as vectors: by Slicer, ImageJ, on a DICOM image beside its pixels, or in a CSV.

Nothing is measured here: the points are taken as given, and no standard deviation is known.

Curves that were drawn in 3D Slicer: a `.mrk.json`, or a table of control points.

A curve as a table: a CSV with the columns u_px,v_px, or with ImageJ's X,Y.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, ImageError, MarkerError, SettingError
from vfplan.images.dataset import is_dicom
from vfplan.io.files import MAX_TEXT_BYTES, read_whole
from vfplan.io.table import split_rows
from vfplan.markers.correspondences import fcsv_points, lps_points, markups_of
from vfplan.vectors import imagej
from vfplan.vectors.curve import (
    FINE_M,
    VectorDrawing,
    distinct_points,
    meeting_warnings,
    without_repeated_end,
)

__all__ = ["FINE_M", "SUFFIXES", "VectorDrawing", "onto_slice", "read_vector_curve"]


def read_table(text: str, origin: imagej.PixelOrigin | None, where: str) -> VectorDrawing:
    """A CSV with the columns u_px,v_px, or with ImageJ's X,Y."""
    rows = [row for _, row in split_rows(text, where, MarkerError)]
    header = [name.strip() for name in rows[0]] if rows else []
    if imagej.is_xy_table(header):
        points = imagej.read_xy_table(rows, origin, where)
    elif header == ["u_px", "v_px"]:  # With a label as well it is a list of markers.
        imagej.refuse_origin(origin, "u_px,v_px")
        points = imagej.parse_pixels(rows[1:], where)
    else:
        raise CurveError(
            f"is no image, and as a curve its header is {','.join(header)[:60]!r}. Give "
            "u_px,v_px or ImageJ's X,Y",
            where=where,
            code="table-header",
        )
    points, closed = without_repeated_end(points)
    return VectorDrawing(distinct_points(points, closed, where), closed, False, "")


OUT_OF_PLANE_M = 1e-3
"""Largest distance from a slice's plane [m] of a curve that was drawn on it."""
SUFFIXES = (".json", ".csv", ".fcsv", ".roi")
"""How the names of files end that hold a curve alone."""
WANTED = "Give a .mrk.json, .fcsv, .roi, CSV or DICOM"


def read_vector_curve(
    path: str | Path,
    origin: imagej.PixelOrigin | None = None,
    number: int | str | None = None,
) -> VectorDrawing:
    """Read a Slicer `.mrk.json` with one Curve or ClosedCurve, a `.fcsv`, `.roi`, CSV or DICOM.

    A CSV is `u_px,v_px`, or ImageJ's `X,Y`; it and a `.fcsv` are closed where the last row repeats
    the first.

    Parameters
    ----------
    path
        The file.
    origin
        Where on a pixel ImageJ's whole numbers lie, "centre" or "corner", if the file leaves it
        open (a `X,Y` table does).
    number
        Which of several graphics of a DICOM presentation state, from 1.

    Raises
    ------
    CurveError
        The file is missing, is no such curve, or holds fewer than two different points.
    SettingError
        An origin or a number is given for a file that needs none.
    MissingExtra
        A `.roi` without the package roifile, a DICOM file without pydicom.
    """
    where = str(path)
    data = read_whole(Path(path), MAX_TEXT_BYTES, CurveError)
    dicom = is_dicom(data)

    # An option that has no effect is refused.
    if origin is not None and origin not in imagej.ORIGINS:
        raise SettingError(
            f"curve_origin is {origin!r}. Give centre or corner", code="origin-unknown"
        )
    is_number = isinstance(number, int)
    if dicom and is_number and (number is True or number < 1):
        raise SettingError(
            f"stroke is {number!r}. Give a whole number from 1", code="stroke-unknown"
        )
    if number is not None and not (dicom and is_number):
        raise SettingError(
            f"stroke {number!r} has no effect on a vector curve. Leave it out",
            code="stroke-without-effect",
        )

    try:
        if dicom:
            from vfplan.vectors.curve import read_presentation_curve

            imagej.refuse_origin(origin, "DICOM")
            curve = read_presentation_curve(data, number, where)
        else:
            curve = read_by_suffix(data, Path(path).suffix.lower(), origin, where)
    except (MarkerError, ImageError) as error:
        raise CurveError(error.message, where=error.where, code="vector-unreadable") from None
    warnings = (*curve.warnings, *meeting_warnings(curve, where))
    return replace(curve, sha256=hashlib.sha256(data).hexdigest(), warnings=warnings)


def onto_slice(curve: VectorDrawing, T_patient_image: NDArray | None, where: str) -> VectorDrawing:
    """The curve in the pixels of a slice whose place in the patient is known.

    Raises `CurveError` when the place is not known, or the curve does not lie in the slice's plane.
    """
    if curve.points.shape[1] == 2:
        return curve
    if T_patient_image is None:
        raise CurveError(
            "is in the patient's frame, and the image does not say where it lies in the "
            "patient. Give a DICOM slice with position, orientation and PixelSpacing",
            where=where,
            code="slice-without-place",
        )
    axes = T_patient_image[:3, :2]
    offset = curve.points - T_patient_image[:3, 2]
    pixels, *_ = np.linalg.lstsq(axes, offset.T, rcond=None)
    distance = float(np.linalg.norm(offset.T - axes @ pixels, axis=0).max())
    if distance > OUT_OF_PLANE_M:
        raise CurveError(
            f"lies up to {1e3 * distance:.1f} mm off the slice's plane, and at most "
            f"{1e3 * OUT_OF_PLANE_M:.0f} mm counts as drawn on it. Give the slice that it is "
            "drawn on",
            where=where,
            code="vector-out-of-plane",
            numbers={"distance_mm": distance * 1e3, "distance_max_mm": OUT_OF_PLANE_M * 1e3},
        )
    return replace(curve, points=pixels.T.copy())


def read_by_suffix(
    data: bytes, suffix: str, origin: imagej.PixelOrigin | None, where: str
) -> VectorDrawing:
    """A curve of any other file, by how its name ends."""
    if suffix == ".roi" or imagej.is_roi(data):
        points, closed, warnings = imagej.read_roi(data, origin, where)
        return VectorDrawing(distinct_points(points, closed, where), closed, False, "", warnings)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise CurveError(f"is not text. {WANTED}", where=where, code="vector-not-text") from None
    if suffix == ".json":
        imagej.refuse_origin(origin, "Slicer's curves")
        return read_markups(text, where)
    if suffix == ".fcsv":
        imagej.refuse_origin(origin, "Slicer's curves")
        return read_control_points(text, where)
    return read_table(text, origin, where)


SPLINE_WARNING_M = 1e-4
"""Largest distance [m] of a spline from straight lines without a warning, where a file names
neither."""
SLICER_CURVES = {"Curve": False, "ClosedCurve": True}
"""Slicer's names of curves, and whether they are closed."""


def read_markups(text: str, where: str) -> VectorDrawing:
    """The one curve of a Slicer `.mrk.json`."""
    markups = markups_of(text, where)
    curves = []
    types = []
    for markup in markups:
        types.append(repr(markup.get("type")))
        if markup.get("type") in SLICER_CURVES:
            curves.append(markup)
    if len(curves) != 1:
        listed = ", ".join(types) or "nothing"
        raise CurveError(
            f"holds {listed}. Give one Curve or ClosedCurve",
            where=where,
            code="vector-several",
            numbers={"curves": len(curves)},
        )
    closed = SLICER_CURVES[curves[0]["type"]]
    return VectorDrawing(
        distinct_points(lps_points(curves[0], where), closed, where), closed, True, ""
    )


def read_control_points(text: str, where: str) -> VectorDrawing:
    """A Slicer `.fcsv`, which says no more of its points than their order."""
    control_points = np.array([xyz for _, xyz in fcsv_points(text, where)]).reshape(-1, 3)
    points, closed = without_repeated_end(control_points)
    curve = VectorDrawing(distinct_points(points, closed, where), closed, True, "")
    distance = curve.distance_from_straight()
    if distance <= SPLINE_WARNING_M:
        return curve
    warning = (
        f"{where}: does not say how its points are joined. A spline was laid through them, up to "
        f"{distance * 1e3:.1f} mm from straight lines. Save a .mrk.json Curve to say what is meant"
    )
    return replace(curve, warnings=(warning,))
