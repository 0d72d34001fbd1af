"""A curve drawn as vectors: by Slicer, ImageJ, on a DICOM image beside its pixels, or in a CSV.

Nothing is measured here: the points are taken as given, and no standard deviation is known.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.parameters import MOST_POINTS
from vfplan.errors import CurveError, ImageError, MarkerError, SettingError
from vfplan.images.read import is_dicom
from vfplan.io.files import read_whole
from vfplan.vectors import imagej

MAX_BYTES = 256 * 2**20
FINE_M = 2.5e-4  # of a curve in the patient: a point every quarter of a millimetre
OUT_OF_PLANE_M = 1e-3  # a curve further than this from the slice was not drawn on it
FURTHEST = 1e9  # pixels or metres; nothing real is, and squares of more overflow in the end
SAME = 1e-12  # of a curve's length: points no further apart are one
KINDS = {"Curve": False, "ClosedCurve": True}
SUFFIXES = (".json", ".csv", ".fcsv", ".roi")  # of files that hold a curve alone
WANTED = "a .mrk.json, .fcsv, .roi, CSV or DICOM is wanted"
# Two places nearer than this share of a step, and more steps apart along the curve, are a meeting.
MEETING, APART, TOGETHER = 0.75, 4, 2**16
SPLINE_TOLD_M = 1e-4  # a spline this far from straight lines is told where a file names neither


@dataclass(frozen=True, eq=False)
class VectorCurve:
    """A curve as a drawing program left it."""

    # (M, 2) control points or vertices (u, v) [px], or (M, 3) in the patient's LPS frame [m]
    points: NDArray[np.float64]
    closed: bool  # whether the last point joins the first
    # Whether a cubic spline runs through the points (Slicer), or straight lines (CSV, ImageJ)
    smooth: bool
    sha256: str  # of the file's bytes, lower-case hex
    warnings: tuple[str, ...] = ()  # what the file leaves open, and how it was taken
    # The DICOM images that it says it was drawn on, each with its frames; none where it does not
    drawn_on: dict[str, list[int]] = field(default_factory=dict)

    def fine(self, step: float) -> NDArray[np.float64]:
        """(K, 2|3) points along the curve, `step` apart in arc length, ends included.

        Raises `CurveError` where these are more than a bundle holds.
        """
        ring = self._ring()
        at = _chords(ring)
        if not at[-1] / step < MOST_POINTS:
            raise CurveError(
                f"is a curve of {at[-1] / step:.3g} points; at most {MOST_POINTS} fit into a bundle"
            )
        dense = np.linspace(0, at[-1], max(64, 8 * round(at[-1] / step)) + 1)
        line = self._through(at, ring, dense)
        arc = _chords(line)
        even = np.linspace(0, arc[-1], max(3, round(arc[-1] / step)) + 1)
        line = np.column_stack([np.interp(even, arc, line[:, k]) for k in range(line.shape[1])])
        return line[:-1] if self.closed else line

    def off_straight(self) -> float:
        """How far the spline lies from straight lines between its points, at most; their unit."""
        ring = self._ring()
        at = _chords(ring)
        dense = np.concatenate([at[:-1] + part * np.diff(at) for part in (0.25, 0.5, 0.75)])
        straight = replace(self, smooth=False)._through(at, ring, dense)
        return float(np.linalg.norm(self._through(at, ring, dense) - straight, axis=1).max())

    def _ring(self) -> NDArray:
        return np.vstack([self.points, self.points[:1]]) if self.closed else self.points

    def _through(self, at: NDArray, ring: NDArray, dense: NDArray) -> NDArray:
        if not self.smooth or len(ring) < 3:
            return np.column_stack([np.interp(dense, at, ring[:, k]) for k in range(ring.shape[1])])
        from scipy.interpolate import CubicSpline

        return CubicSpline(at, ring, bc_type="periodic" if self.closed else "natural")(dense)


def read_vector_curve(
    path: str | Path,
    origin: imagej.PixelOrigin | None = None,
    number: int | str | None = None,
) -> VectorCurve:
    """Read a Slicer `.mrk.json` with one Curve or ClosedCurve, a `.fcsv`, `.roi`, CSV or DICOM.

    A CSV is `u_px,v_px`, or ImageJ's `X,Y`; it and a `.fcsv` are closed where the last row repeats
    the first.

    path: the file
    origin: where on a pixel ImageJ's whole numbers lie, "centre" or "corner", if the file leaves it
        open (a `X,Y` table does)
    number: which of several graphics of a DICOM presentation state, from 1
    Raises CurveError: the file is missing, is no such curve, or holds fewer than two different
        points
    Raises SettingError: an origin or a number is given for a file that needs none
    Raises MissingExtra: a `.roi` without the package roifile, a DICOM file without pydicom
    """
    where = str(path)
    data = read_whole(Path(path), MAX_BYTES, CurveError)
    if origin is not None and origin not in imagej.ORIGINS:
        raise SettingError(f"curve_origin is {origin!r}; centre or corner is wanted")
    dicom = is_dicom(data)
    if dicom and isinstance(number, int) and (number is True or number < 1):
        raise SettingError(f"stroke {number!r} is not a number from 1")
    if number is not None and not (dicom and isinstance(number, int)):
        raise SettingError(f"stroke {number!r} has no effect on a vector curve; leave it out")
    try:
        curve = (
            _presentation(data, origin, number, where)
            if dicom
            else _read(data, Path(path).suffix.lower(), origin, where)
        )
    except (MarkerError, ImageError) as error:
        raise CurveError(error.message, where=error.where) from None
    told = (*curve.warnings, *_meets_itself(curve, where))
    return replace(curve, sha256=hashlib.sha256(data).hexdigest(), warnings=told)


def _read(data: bytes, suffix: str, origin: imagej.PixelOrigin | None, where: str) -> VectorCurve:
    if suffix == ".roi" or imagej.is_roi(data):
        points, closed, warnings = imagej.read_roi(data, origin, where)
        return VectorCurve(_distinct(points, closed, where), closed, False, "", warnings)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise CurveError(f"is not text; {WANTED}", where=where) from None
    if suffix not in (".json", ".fcsv"):
        return _polyline(text, origin, where)
    if origin is not None:
        raise SettingError(f"curve_origin {origin!r} has no effect on Slicer's curves")
    return _slicer(text, where) if suffix == ".json" else _control_points(text, where)


def _presentation(
    data: bytes, origin: imagej.PixelOrigin | None, number: int | None, where: str
) -> VectorCurve:
    from vfplan.vectors.presentation import read_presentation

    if origin is not None:
        raise SettingError(f"curve_origin {origin!r} has no effect on DICOM")
    drawn, warnings = read_presentation(data, number, where)
    points, closed = _opened(drawn.points)
    points = _distinct(points, closed, where)
    curve = VectorCurve(points, closed, drawn.smooth, "", warnings, drawn.drawn_on)
    if not curve.smooth:
        return curve
    away = f"a spline is laid through its points, up to {curve.off_straight():.2g} px from straight"
    warning = f"{where}: {away} lines; DICOM leaves its form open"
    return replace(curve, warnings=(*warnings, warning))


def _meets_itself(curve: VectorCurve, where: str) -> list[str]:
    """A warning where a curve crosses, touches or doubles itself."""
    unit, step, scale = ("px", 1.0, 1.0) if curve.points.shape[1] == 2 else ("mm", FINE_M, 1e3)
    if not _chords(curve._ring())[-1] / step < MOST_POINTS:
        return []  # refused where it is sampled
    places = curve.fine(step)
    met = meetings(places, curve.closed, step)
    if not met.any():
        return []
    first = ", ".join(f"{x:.1f}" for x in scale * places[np.argmax(met)])
    over = f"over {scale * step * met.sum():.3g} {unit} in all"
    return [f"{where}: crosses, touches or doubles itself first at ({first}) {unit}, {over}"]


def meetings(points: NDArray, closed: bool, step: float) -> NDArray[np.bool_]:
    """(M,) which points of a curve in even steps lie where it crosses, touches or doubles itself.

    Of two straight runs that cross, some points lie no further apart than 0.71 steps.
    """
    from scipy.spatial import cKDTree

    tree, count = cKDTree(points), len(points)
    met = np.zeros(count, bool)
    for part in np.array_split(np.arange(count), count // TOGETHER + 1):
        off, other = tree.query(points[part], 2 * APART + 2, distance_upper_bound=MEETING * step)
        along = np.abs(other - part[:, None])
        along = np.minimum(along, count - along) if closed else along
        met[part] = (np.isfinite(off) & (along > APART)).any(1)
    return met


def onto_slice(curve: VectorCurve, T_patient_image: NDArray | None, where: str) -> VectorCurve:
    """The curve in the pixels of a slice whose place in the patient is known.

    Raises `CurveError` when the place is not known, or the curve lies off the slice's plane.
    """
    if curve.points.shape[1] == 2:
        return curve
    if T_patient_image is None:
        raise CurveError(
            "is in the patient's frame, and the image does not say where it lies in the patient "
            "(a DICOM slice with position, orientation and PixelSpacing does)",
            where=where,
        )
    axes = T_patient_image[:3, :2]
    offset = curve.points - T_patient_image[:3, 2]
    pixels, *_ = np.linalg.lstsq(axes, offset.T, rcond=None)
    away = float(np.linalg.norm(offset.T - axes @ pixels, axis=0).max())
    if away > OUT_OF_PLANE_M:
        raise CurveError(
            f"lies up to {away * 1e3:.1f} mm off the slice's plane; at most "
            f"{OUT_OF_PLANE_M * 1e3:.0f} mm is taken for drawn on it",
            where=where,
        )
    return replace(curve, points=pixels.T.copy())


def _slicer(text: str, where: str) -> VectorCurve:
    from vfplan.markers.slicer import lps_points, markups_of

    markups = markups_of(text, where)
    curves = [m for m in markups if m.get("type") in KINDS]
    if len(curves) != 1:
        types = ", ".join(repr(m.get("type")) for m in markups) or "nothing"
        raise CurveError(f"holds {types}; one Curve or ClosedCurve is wanted", where=where)
    closed = KINDS[curves[0]["type"]]
    return VectorCurve(_distinct(lps_points(curves[0], where), closed, where), closed, True, "")


def _control_points(text: str, where: str) -> VectorCurve:
    """Slicer's control-point table says of what kind its points are no more than their order."""
    from vfplan.markers.slicer import fcsv_points

    points, closed = _opened(np.array([xyz for _, xyz in fcsv_points(text, where)]).reshape(-1, 3))
    curve = VectorCurve(_distinct(points, closed, where), closed, True, "")
    away = curve.off_straight()
    if away <= SPLINE_TOLD_M:
        return curve
    told = (
        f"{where}: names points alone; a spline is laid through them, up to {away * 1e3:.1f} mm "
        "from straight lines; a .mrk.json Curve says which is meant"
    )
    return replace(curve, warnings=(told,))


def _polyline(text: str, origin: imagej.PixelOrigin | None, where: str) -> VectorCurve:
    from vfplan.io.table import split_rows

    rows = [row for _, row in split_rows(text, where, MarkerError)]
    header = [name.strip() for name in rows[0]] if rows else []
    if imagej.is_xy_table(header):
        points = imagej.read_xy_table(rows, origin, where)
    elif header == ["u_px", "v_px"]:  # exactly: with a label it is a list of markers
        if origin is not None:
            raise SettingError(f"curve_origin {origin!r} has no effect on u_px,v_px")
        points = imagej.pixels_of(rows[1:], where)
    else:
        found = ",".join(header)[:60]
        raise CurveError(
            f"is no image, and as a curve its header is {found!r}; u_px,v_px or ImageJ's X,Y is "
            "wanted",
            where=where,
        )
    points, closed = _opened(points)
    return VectorCurve(_distinct(points, closed, where), closed, False, "")


def _opened(points: NDArray) -> tuple[NDArray, bool]:
    """The points without the last where it repeats the first, and whether it does."""
    closed = len(points) > 3 and bool(np.array_equal(points[0], points[-1]))
    return (points[:-1] if closed else points), closed


def _distinct(points: NDArray, closed: bool, where: str) -> NDArray:
    if not np.isfinite(points).all():
        raise CurveError("holds a point that is not finite", where=where)
    if np.abs(points).max(initial=0.0) > FURTHEST:
        raise CurveError(
            f"holds a coordinate of {np.abs(points).max():g}; at most {FURTHEST:g} is allowed",
            where=where,
        )
    if len(points):
        arc = _chords(points)
        points = points[np.r_[True, np.diff(arc) > SAME * arc[-1]]]
        if closed and np.linalg.norm(points[-1] - points[0]) <= SAME * arc[-1]:
            points = points[:-1]
    least = 3 if closed else 2
    if len(points) < least:
        raise CurveError(f"holds {len(points)} different points; {least} are wanted", where=where)
    return points


def _chords(points: NDArray) -> NDArray:
    return np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
