"""A curve drawn as vectors: by Slicer, ImageJ, on a DICOM image beside its pixels, or in a CSV.

Nothing is measured here: the points are taken as given, and no standard deviation is known.

ImageJ counts the coordinates of area selections from a pixel's corner, and those of line selections
from its centre (class `ij.gui.Roi`, since ImageJ 1.52u of March 2020; before, all from the corner).
Here a whole number is a pixel's centre.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, ImageError, MarkerError, SettingError, requires_extra
from vfplan.geometry import CORNER_PX, PixelSpacing
from vfplan.geometry.lines import Array
from vfplan.images.dicom import is_dicom
from vfplan.io.files import (
    MAX_TEXT_BYTES,
    METRES,
    FilePath,
    decode_text,
    naming_place,
    parse_table,
    read_bytes,
)
from vfplan.markers.correspondences import fcsv_points, imagej_columns, lps_points, markups_of
from vfplan.vectors.curve import (
    VectorDrawing,
    distinct_points,
    read_presentation_curve,
    without_repeated_end,
)  # fmt: skip

Origin = Literal["centre", "corner"]
CurveType = Literal["spline", "linear"]
# Where ImageJ's zero may lie on the first pixel.
ORIGINS = ("centre", "corner")
AREAS = ("POLYGON", "FREEHAND", "TRACED")
LINES = ("POLYLINE", "FREELINE")
# The format of a `.roi` that counts in either way: ImageJ 1.52i to 1.54 wrote it. The lines of
# older formats count from corners, those of newer ones from centres.
UNCLEAR_FORMAT = 228
NAME_ORIGIN = "Say where it counts a pixel from: --curve-origin centre or corner"


# Largest distance from a slice's plane [m] of a curve that was drawn on it.
OUT_OF_PLANE_M = 1e-3
# How the names of files end that hold a curve alone.
SLICER_SUFFIXES = (".json", ".fcsv")


def read_vector_curve(
    path: FilePath, origin: Origin | None = None, number: int | str | None = None,
    curve_type: CurveType | None = None,
) -> VectorDrawing:  # fmt: skip
    """Read a Slicer `.mrk.json` with one Curve or ClosedCurve, a `.fcsv`, `.roi`, CSV or DICOM.

    A CSV is `u_px,v_px`, or ImageJ's `X,Y`, calibrated where a unit follows (`X (mm)`); it and a
    `.fcsv` are closed where the last row repeats the first.

    Parameters
    ----------
    path
        The file.
    origin
        Where on a pixel ImageJ's whole numbers lie, "centre" or "corner", if the file leaves it
        open (a `X,Y` table does).
    number
        Which of several graphics of a DICOM presentation state, from 1.
    curve_type
        What Slicer draws through the points of its curves; its file does not say it. `None`:
        Slicer's default, a spline.

    Raises
    ------
    CurveError
        The file is missing, is no such curve, or holds fewer than two different points.
    SettingError
        An origin or a number is given for a file that needs none.
    MissingExtra
        A `.roi` without the package roifile.
    """
    where = str(path)
    data, digest = read_bytes(Path(path), MAX_TEXT_BYTES, CurveError)
    dicom = is_dicom(data)

    # An option that has no effect is refused.
    if origin is not None and origin not in ORIGINS:
        raise SettingError(
            f"curve_origin is {origin!r}. Give centre or corner", code="origin-unknown"
        )
    if curve_type is not None and Path(path).suffix.lower() not in SLICER_SUFFIXES:
        raise SettingError(
            f"curve_type {curve_type!r} has no effect on a file that is not Slicer's. Leave it out",
            code="setting-without-effect",
        )
    is_number = isinstance(number, int)
    if dicom and is_number and (number is True or number < 1):
        text = f"stroke is {number!r}. Give a whole number from 1"
        raise SettingError(text, code="stroke-unknown")
    if number is not None and not (dicom and is_number):
        raise SettingError(
            f"stroke {number!r} has no effect on a vector curve. Leave it out",
            code="stroke-without-effect",
        )

    try:
        with naming_place(where):
            if dicom:
                refuse_origin(origin, "DICOM")
                curve = read_presentation_curve(data, number, where)
            else:
                curve = read_by_suffix(data, Path(path).suffix.lower(), origin, where)
            if curve.joined == "slicer" and curve_type is None:
                curve = replace(curve, type_difference_m=curve.distance_from_straight())
            elif curve_type == "linear":
                curve = replace(curve, joined="straight")
    except (MarkerError, ImageError) as error:
        raise CurveError(error.message, where=error.where, code="vector-unreadable") from None
    return replace(curve, sha256=digest)


def onto_slice(
    curve: VectorDrawing, T_patient_image: NDArray | None, where: str,
    spacing_mm: PixelSpacing = None,
) -> VectorDrawing:  # fmt: skip
    """The curve in the pixels of a slice whose place in the patient, or pixel spacing, is known.

    Raises `CurveError` when it is not known, or the curve does not lie in the slice's plane.
    """
    if curve.measured_from is not None:
        if spacing_mm is None:
            raise CurveError(
                "is in millimetres, and no image says how large a pixel is. Give the image, with "
                "--pixel-spacing if it has none",
                where=where, code="curve-without-spacing",
            )  # fmt: skip
        pixels = _from_centres(curve.points / spacing_mm, curve.measured_from)
        return replace(curve, points=pixels, measured_from=None)
    if curve.points.shape[1] == 2:
        return curve
    if T_patient_image is None:
        raise CurveError(
            "is in the patient's frame, and the image does not say where it lies in the "
            "patient. Give a DICOM slice with position, orientation and PixelSpacing",
            where=where, code="slice-without-place",
        )  # fmt: skip
    axes = T_patient_image[:3, :2]
    offset = curve.points - T_patient_image[:3, 2]
    pixels, *_ = np.linalg.lstsq(axes, offset.T, rcond=None)
    distance = float(np.linalg.norm(offset.T - axes @ pixels, axis=0).max())
    if distance > OUT_OF_PLANE_M:
        raise CurveError(
            f"lies up to {1e3 * distance:.1f} mm off the slice's plane, and at most "
            f"{1e3 * OUT_OF_PLANE_M:.0f} mm counts as drawn on it. Give the slice that it is "
            "drawn on",
            where=where, code="vector-out-of-plane",
            numbers={"distance_mm": distance * 1e3, "distance_max_mm": OUT_OF_PLANE_M * 1e3},
        )  # fmt: skip
    return replace(curve, points=pixels.T.copy())


def read_by_suffix(data: bytes, suffix: str, origin: Origin | None, where: str) -> VectorDrawing:
    """A curve of any other file, by how its name ends."""
    if suffix == ".roi" or data.startswith(b"Iout"):
        points, closed, warnings = read_roi(data, origin, where)
        return VectorDrawing(distinct_points(points, closed), closed, "straight", warnings=warnings)
    text = decode_text(data, where, CurveError)
    if suffix in SLICER_SUFFIXES:
        refuse_origin(origin, "Slicer's curves")
        return read_markups(text) if suffix == ".json" else read_control_points(text, where)
    return read_table(text, origin, where)


# Slicer's names of curves, and whether they are closed.
SLICER_CURVES = {"Curve": False, "ClosedCurve": True}


def read_markups(text: str) -> VectorDrawing:
    """The one curve of a Slicer `.mrk.json`."""
    markups = markups_of(text)
    curves = [markup for markup in markups if markup.get("type") in SLICER_CURVES]
    if len(curves) != 1:
        listed = ", ".join(repr(markup.get("type")) for markup in markups) or "nothing"
        raise CurveError(
            f"holds {listed}. Give one Curve or ClosedCurve",
            code="vector-several", numbers={"curves": len(curves)},
        )  # fmt: skip
    return slicer_curve(lps_points(curves[0]), SLICER_CURVES[curves[0]["type"]])


def slicer_curve(points: NDArray, closed: bool) -> VectorDrawing:
    """A curve of 3D Slicer; its spline counts points, so those that are there twice stay."""
    distinct_points(points, closed)
    return VectorDrawing(points, closed, "slicer")


def read_control_points(text: str, where: str) -> VectorDrawing:
    """A Slicer `.fcsv`, which says no more of its points than their order."""
    control_points = np.array([xyz for _, xyz in fcsv_points(text, where)]).reshape(-1, 3)
    return slicer_curve(*without_repeated_end(control_points))


def read_table(text: str, origin: Origin | None, where: str) -> VectorDrawing:
    """A CSV with the columns u_px,v_px, or with ImageJ's X,Y, with or without row numbers."""
    table = parse_table(text, where, MarkerError)
    columns = tuple(name for name in table.header if name)
    pair, unit = imagej_columns(columns)
    if {"u_px", "v_px"} <= {*columns} and not {"label", "name"} & {*map(str.casefold, columns)}:
        columns = ("u_px", "v_px")  # With a label as well it is a list of markers.
        refuse_origin(origin, "u_px,v_px")
        origin = "centre"
    elif columns != pair:
        is_area = columns[:2] == ("X", "Y")
        raise CurveError(
            f"is no image, and as a curve its header is {','.join(columns)[:60]!r}"
            f"{', as of every pixel of an area' if is_area else ''}. Give u_px,v_px or ImageJ's "
            "X,Y of a curve",
            code="table-header",
        )
    elif origin is None:
        raise CurveError(
            f"holds X,Y [px] of a line or of an area, which ImageJ counts differently. "
            f"{NAME_ORIGIN} (a line's and an area's)",
            code="origin-unknown",
        )
    points, closed = without_repeated_end(table.numbers(columns))
    points = distinct_points(points, closed)
    if unit:
        points = 1e3 * METRES[unit.lower()] * points
        return VectorDrawing(points, closed, "straight", measured_from=origin)
    return VectorDrawing(_from_centres(points, origin), closed, "straight")


def read_roi(data: bytes, origin: Origin | None, where: str) -> tuple[Array, bool, tuple[str, ...]]:
    """The (M, 2) vertices (u, v) [px] of a `.roi`, whether it is closed, and warnings.

    Raises
    ------
    CurveError
        The file is damaged or no polygon and no polyline, or it does not tell how it counts and
        `origin` is `None`.
    SettingError
        The file tells how it counts, and `origin` is given.
    MissingExtra
        The package roifile is not installed.
    """
    with requires_extra("reading an ImageJ .roi needs the package roifile", "imagej", where):
        import roifile
    logging.getLogger("roifile").addHandler(logging.NullHandler())
    try:
        roi = roifile.ImagejRoi.frombytes(data)
        coordinates = roi.coordinates()
    except Exception as error:  # The file is foreign: numpy, struct and codecs raise all sorts.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise CurveError(
            f"the ImageJ selection cannot be read: {reason}. Save it again in ImageJ",
            code="roi-damaged",
        ) from None

    # What it is.
    selection = roi.roitype.name
    if roi.composite or roi.subtype != 0 or selection not in (*AREAS, *LINES):
        kind = f"of type {selection}, subtype {roi.subtype.name}"
        wanted = ", ".join((*AREAS, *LINES)).lower()
        raise CurveError(
            f"is {'a composite' if roi.composite else kind}. Give one of {wanted}",
            code="roi-selection",
        )
    if roi.options & roifile.ROI_OPTIONS.SPLINE_FIT:
        raise CurveError(
            "is fitted with a spline that the file does not hold. Apply Edit > Selection > "
            "Interpolate in ImageJ, which adds its points",
            code="roi-spline",
        )

    # How it counts.
    closed = selection in AREAS
    if closed:
        refuse_origin(origin, f"ImageJ's {selection.lower()}")
    counted_from, warnings = (
        ("corner", ()) if closed else origin_of_line(roi.version, origin, where)
    )
    with np.errstate(invalid="ignore"):  # What is not finite is refused with the other points.
        points = np.asarray(coordinates, float).reshape(-1, 2)
    return _from_centres(points, counted_from), closed, warnings


def refuse_origin(origin: Origin | None, what: str) -> None:
    """Raise `SettingError` where an origin is given for a file that leaves none open."""
    if origin is not None:
        raise SettingError(
            f"curve_origin {origin!r} has no effect on {what}. Leave it out",
            code="origin-without-effect",
        )


def _from_centres(points: NDArray, origin: str) -> Array:
    """Points that are counted from a pixel's centre or corner, counted from centres."""
    return points - CORNER_PX if origin == "corner" else points


def origin_of_line(
    version: int, origin: Origin | None, where: str
) -> tuple[Origin, tuple[str, ...]]:
    """From where on a pixel a line of a format counts, with a warning where that is not sure."""
    if version > UNCLEAR_FORMAT:
        refuse_origin(origin, "a selection of this format")
        return "centre", ()
    if origin is not None:
        return origin, ()
    if version < UNCLEAR_FORMAT:
        raise CurveError(
            f"is of an ImageJ before 1.52i (format {version}). {NAME_ORIGIN}",
            code="origin-unknown", numbers={"format": version},
        )  # fmt: skip
    warning = (
        f"{where}: is taken to count from the centres of pixels. Had an ImageJ before 1.52u "
        f"(March 2020) written it, it would lie half a pixel off. {NAME_ORIGIN}"
    )
    return "centre", (warning,)
