"""A curve of straight lines or a spline, as a drawing program left it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.parameters import MAX_POINTS
from vfplan.errors import CurveError
from vfplan.fixture import Stroke
from vfplan.geometry import ROUNDING, ROWS_AT_ONCE
from vfplan.geometry.polyline import arc_lengths, ring_of
from vfplan.io.table import MAX_NUMBER

FINE_M = 2.5e-4
"""Distance [m] between the points of a curve in the patient. It is half a pixel of a fine scan."""
MEETING_STEPS = 0.75
"""Largest distance, in steps, of two points where a curve meets itself. Of two straight runs that
cross, some points are 0.71 steps apart."""
NEIGHBOUR_STEPS = 4
"""Number of steps along the curve within which two points are neighbours and do not meet."""


@dataclass(frozen=True, eq=False)
class VectorDrawing:
    """A curve as a drawing program left it.

    Parameters
    ----------
    points
        (M, 2) control points or vertices (u, v) [px], or (M, 3) in the patient's LPS frame [m].
    closed
        Whether the last point joins the first.
    smooth
        Whether a cubic spline runs through the points (Slicer), or straight lines (CSV, ImageJ).
    sha256
        SHA-256 of the file's bytes, lower-case hex.
    warnings
        What the file leaves open, and how it was taken.
    drawn_on
        The DICOM images that it says it was drawn on, each with its frames; none where it does
        not say.
    """

    points: NDArray[np.float64]
    closed: bool
    smooth: bool
    sha256: str
    warnings: tuple[str, ...] = ()
    drawn_on: dict[str, list[int]] = field(default_factory=dict)

    def stroke(self, step: float) -> Stroke:
        """The curve as a stroke whose points are `step` apart in arc length, ends included.

        Raises `CurveError` where these are more than a bundle holds.
        """
        chords = arc_lengths(self.points, self.closed)
        steps = chords[-1] / step
        if not steps < MAX_POINTS:
            raise CurveError(
                f"is a curve of {steps:.3g} points, and at most {MAX_POINTS} fit into a "
                "bundle. Give a shorter one",
                code="vector-too-long",
                numbers={"points": float(steps), "points_max": MAX_POINTS},
            )
        at = np.linspace(0, chords[-1], max(64, 8 * round(steps)) + 1)
        line = self.at(at)
        arc = arc_lengths(line, False)
        even = np.linspace(0, arc[-1], max(3, round(arc[-1] / step)) + 1)
        line = _interpolate(even, arc, line)
        if self.closed:
            line = line[:-1]
        return Stroke(line, self.closed)

    def distance_from_straight(self) -> float:
        """The largest distance of the spline from straight lines between its points; their unit."""
        chords = arc_lengths(self.points, self.closed)
        quarters = np.arange(1, 4)[:, None] / 4
        at = (chords[:-1] + quarters * np.diff(chords)).ravel()
        straight = _interpolate(at, chords, ring_of(self.points, self.closed))
        return float(np.linalg.norm(self.at(at) - straight, axis=1).max())

    def at(self, chords: NDArray) -> NDArray[np.float64]:
        """(K, 2|3) points at lengths along the chords between the curve's points."""
        ring = ring_of(self.points, self.closed)
        knots = arc_lengths(self.points, self.closed)
        if not self.smooth or len(ring) < 3:
            return _interpolate(chords, knots, ring)
        from scipy.interpolate import CubicSpline

        ends = "periodic" if self.closed else "natural"
        return CubicSpline(knots, ring, bc_type=ends)(chords)


def without_repeated_end(points: NDArray) -> tuple[NDArray, bool]:
    """The points without the last where it repeats the first, and whether it does."""
    if len(points) > 3 and np.array_equal(points[0], points[-1]):
        return points[:-1], True
    return points, False


def distinct_points(points: NDArray, closed: bool, where: str) -> NDArray:
    """The points without repetitions; raises `CurveError` where too few or none real are left."""
    if not np.isfinite(points).all():
        raise CurveError(
            "holds a point that is not finite. Correct the file",
            where=where,
            code="point-not-finite",
        )
    largest = float(np.abs(points).max(initial=0.0))
    if largest > MAX_NUMBER:
        raise CurveError(
            f"holds a coordinate of {largest:g}. Give at most {MAX_NUMBER:g}",
            where=where,
            code="coordinate-too-large",
            numbers={"coordinate": largest, "coordinate_max": MAX_NUMBER},
        )
    if len(points):
        chords = arc_lengths(points, False)
        same = ROUNDING * chords[-1]
        points = points[np.r_[True, np.diff(chords) > same]]
        if closed and np.linalg.norm(points[-1] - points[0]) <= same:
            points = points[:-1]
    wanted = 3 if closed else 2
    if len(points) < wanted:
        raise CurveError(
            f"holds {len(points)} different points. Give at least {wanted}",
            where=where,
            code="too-few-points",
            numbers={"points": len(points), "points_min": wanted},
        )
    return points


def meeting_warnings(curve: VectorDrawing, where: str) -> list[str]:
    """A warning where a curve crosses, touches or doubles itself."""
    if curve.points.shape[1] == 2:
        unit = "px"
        step = 1.0
        scale = 1.0
    else:
        unit = "mm"
        step = FINE_M
        scale = 1e3
    if not arc_lengths(curve.points, curve.closed)[-1] / step < MAX_POINTS:
        return []  # The curve is refused where it is sampled.
    places = curve.stroke(step).points
    meets = find_meetings(places, curve.closed, step)
    if not meets.any():
        return []
    first = ", ".join(f"{x:.1f}" for x in scale * places[np.argmax(meets)])
    length = f"{scale * step * meets.sum():.3g} {unit}"
    return [
        f"{where}: crosses, touches or doubles itself first at ({first}) {unit}, over {length} "
        "in all. Check that it is drawn so on purpose"
    ]


def find_meetings(points: NDArray, closed: bool, step: float) -> NDArray[np.bool_]:
    """(M,) which points of a curve in even steps lie where it crosses, touches or doubles itself.

    Of two straight runs that cross, some points lie no farther apart than 0.71 steps.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    count = len(points)
    meets = np.zeros(count, bool)
    neighbours = 2 * NEIGHBOUR_STEPS + 2
    for part in np.array_split(np.arange(count), count // ROWS_AT_ONCE + 1):
        distance, other = tree.query(
            points[part], neighbours, distance_upper_bound=MEETING_STEPS * step
        )
        along = np.abs(other - part[:, None])
        if closed:
            along = np.minimum(along, count - along)
        meets[part] = (np.isfinite(distance) & (along > NEIGHBOUR_STEPS)).any(1)
    return meets


def _interpolate(at: NDArray, knots: NDArray, points: NDArray) -> NDArray[np.float64]:
    return np.column_stack([np.interp(at, knots, column) for column in points.T])
