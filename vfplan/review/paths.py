"""The geometry of a path of points on a slice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def with_first_again(points: NDArray, closed: bool) -> Array:
    """The points of a path; those of a closed one end with the first again."""
    if closed:
        return np.vstack([points, points[:1]])
    return np.asarray(points, float)


def arc_length(points: NDArray, closed: bool) -> Array:
    """(M,) or, closed, (M + 1,) arc length at the points [px]."""
    ring = with_first_again(points, closed)
    return np.r_[0.0, np.cumsum(np.hypot(*np.diff(ring, axis=0).T))]


def evenly(points: NDArray, closed: bool) -> Array:
    """The path at about one point a pixel, at equal steps of arc; its ends stay where they are."""
    ring = with_first_again(points, closed)
    arc = arc_length(points, closed)
    count = max(4, round(arc[-1]))
    at = np.linspace(0.0, arc[-1], count + 1)
    even = np.column_stack([np.interp(at, arc, ring[:, k]) for k in (0, 1)])
    if closed:
        return even[:-1]
    return even


def normals(points: NDArray, closed: bool) -> Array:
    """(M, 2) unit normals of a path."""
    if closed:
        step = np.roll(points, -1, 0) - np.roll(points, 1, 0)
    else:
        step = np.gradient(points, axis=0)
    step = step / np.maximum(np.hypot(*step.T), 1e-12)[:, None]
    return np.column_stack([-step[:, 1], step[:, 0]])


def spline_through(points: NDArray, closed: bool) -> Array:
    """The cubic spline through points, at about one point a pixel.

    Its parameter is the length of the polygon through the points; two points give a straight line.
    """
    from scipy.interpolate import CubicSpline

    points = np.asarray(points, float)
    if len(points) == 2:
        return evenly(points, False)
    ring = with_first_again(points, closed)
    arc = arc_length(points, closed)
    if closed:
        spline = CubicSpline(arc, ring, bc_type="periodic")
    elif len(points) == 3:
        spline = CubicSpline(arc, ring, bc_type="natural")
    else:
        spline = CubicSpline(arc, ring, bc_type="not-a-knot")
    dense = spline(np.linspace(0.0, arc[-1], 4 * max(2, round(arc[-1])) + 1))
    if closed:
        dense = dense[:-1]
    return evenly(dense, closed)


def nearest_point(points: NDArray, place: NDArray) -> tuple[int, float]:
    """Which point is nearest to a place, and how far off it is [px]."""
    distance = np.hypot(*(points - np.asarray(place, float)).T)
    nearest = int(distance.argmin())
    return nearest, float(distance[nearest])
