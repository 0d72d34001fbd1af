"""The geometry of a path: its normals, its length, even steps, what lies beyond its ends."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

# So much of a thinned line's end, in widths beyond a thin line's, may turn to a corner of the pen.
CROOKED, THIN_PX = 1.25, 2.5
# Two places nearer than this share of a step, and more steps apart along the curve, are a meeting.
MEETING, APART, TOGETHER = 0.75, 4, 2**16
STRETCH_PX = 9.0  # of line, or a width, from which the bend at an end is taken


def normals(points: NDArray, closed: bool) -> NDArray:
    """(M, 2) unit normals of a path."""
    if closed:
        tangent = np.roll(points, -1, 0) - np.roll(points, 1, 0)
    else:
        tangent = np.gradient(points, axis=0)
    tangent /= np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-12)[:, None]
    return np.column_stack([-tangent[:, 1], tangent[:, 0]])


def arc_length(points: NDArray, closed: bool) -> NDArray:
    """(M,) or, closed, (M + 1,) arc length at the points [px]."""
    ring = np.vstack([points, points[:1]]) if closed else points
    return np.r_[0.0, np.cumsum(np.hypot(*np.diff(ring, axis=0).T))]


def drawn_length(path: NDArray, closed: bool) -> float:
    """Length of a line along its pixels, the staircase smoothed away [px]."""
    from scipy.ndimage import gaussian_filter1d

    smooth = gaussian_filter1d(path, 3.0, axis=0, mode="wrap" if closed else "nearest")
    cut = 0.0 if closed else float(np.hypot(*(smooth - path)[[0, -1]].T).sum())
    return float(arc_length(smooth, closed)[-1]) + cut


def evenly(points: NDArray, closed: bool) -> tuple[NDArray, float]:
    """About one point a pixel, at equal steps of arc; and the step."""
    arc = arc_length(points, closed)
    ring = np.vstack([points, points[:1]]) if closed else points
    count = max(4, round(arc[-1]))
    at = np.linspace(0, arc[-1], count + 1)
    even = np.column_stack([np.interp(at, arc, ring[:, k]) for k in (0, 1)])
    return (even[:-1] if closed else even), arc[-1] / count


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


def without_tips(path: NDArray, width: float) -> tuple[NDArray, float]:
    """The path without what thinning bends at its ends, and the length cut off on either side."""
    cut = max(0, min(int(CROOKED * (width - THIN_PX)), (len(path) - 20) // 2))
    kept = path[cut : len(path) - cut]
    return kept, float(arc_length(path[: cut + 1], False)[-1])


def extended(points: NDArray, by: float, width: float) -> NDArray:
    """The line carried on by `by` px at both ends as it bends there."""
    return np.vstack([_onward(points[::-1], by, width)[::-1], points, _onward(points, by, width)])


def prolonged(
    spline: Callable[[NDArray], NDArray], first: float, last: float, by: float, width: float
) -> Callable[[NDArray], NDArray]:
    """A spline over arc length, carried on by `by` px beyond `first` and `last` as `extended` does.

    A cubic would not: a pixel's error of its last points grows with the third power of the way.
    """
    line = spline(np.linspace(first, last, max(2, round(last - first) + 1)))
    tails = [np.vstack([at[-1:], _onward(at, by, width)]) for at in (line[::-1], line)]

    def place(s: NDArray) -> NDArray[np.float64]:
        points = spline(np.clip(s, first, last))
        for tail, beyond in zip(tails, (first - s, s - last), strict=True):
            out, steps = beyond > 0, np.arange(len(tail))
            points[out] = np.column_stack([np.interp(beyond[out], steps, u) for u in tail.T])
        return points

    return place


def _onward(points: NDArray, by: float, width: float) -> NDArray:
    """(M, 2) steps of 1 px beyond the last point, along the arc of the line's last stretch."""
    stretch = max(STRETCH_PX, width)
    reach = min(int(stretch), (len(points) - 1) // 2)
    near, far = points[-1] - points[-1 - reach], points[-1 - reach] - points[-1 - 2 * reach]
    turn = np.arctan2(far[0] * near[1] - far[1] * near[0], far @ near) / np.hypot(*near)
    steps = np.arange(1, int(np.ceil(by)) + 1)
    bend = np.hypot(*near) / 2 + stretch * (1 - np.exp((0.5 - steps) / stretch))
    heading = np.arctan2(near[1], near[0]) + turn * bend
    return points[-1] + np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
