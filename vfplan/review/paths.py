"""A spline through clicks, and the point of a line that is nearest to a click."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.geometry.polyline import arc_lengths, evenly, ring_of

Array = NDArray[np.float64]


def spline_through(points: NDArray, closed: bool) -> Array:
    """The cubic spline through points, at about one point a pixel.

    Its parameter is the length of the polygon through the points; two points give a straight line.
    """
    from scipy.interpolate import CubicSpline

    points = np.asarray(points, float)
    if len(points) == 2:
        return evenly(points, False)
    ring = ring_of(points, closed)
    arc = arc_lengths(points, closed)
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
