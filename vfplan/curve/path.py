"""The geometry of a path: normals, length, even steps, a smoothing spline, what lies beyond it.

The spline's knots stand closer where the line bends: a cubic spline with knots h apart departs from
a bend of radius R by little as long as h is below about R/2. On straight runs `widest` px of line
share a knot, so that the noise averages out. No knot falls into a gap: there one cubic, smooth to
the second derivative at both sides, carries the line from edge to edge.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

# So much of a thinned line's end, in widths beyond a thin line's, may turn to a corner of the pen.
CROOKED, THIN_PX = 1.25, 2.5
# Two places nearer than this share of a step, and more steps apart along the curve, are a meeting.
MEETING, APART, TOGETHER = 0.75, 4, 2**16
STRETCH_PX = 9.0  # of line, or a width, from which the bend at an end is taken

CLOSEST_PX = 3.5
GAP_PX = 2.0  # between neighbouring points: more is a gap
WRAP_PX = 100.0  # a knot's influence fades by a factor of about 4 each knot further
BEND_SHARE = 0.5  # of the radius of curvature: the knots' distance in a bend


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


def fit_spline(s: NDArray, points: NDArray, valid: NDArray, period: float | None, knots: NDArray):
    """Least-squares cubic spline of points over arc length, with the knots given.

    s: (M,) arc length of each point, increasing
    points: (M, K) values; only those where `valid` count
    valid: (M,) bool
    period: length of a closed curve; `None` for an open one
    knots: (Q,) inner and end knots, increasing, of one period
    """
    from scipy.interpolate import make_lsq_spline

    x, y = s[valid], points[valid]
    inner = knots
    if period is not None:  # wrapped on both sides, so that the seam is as smooth as the rest
        reach = min(period / 3, WRAP_PX)
        before, after = x > x[0] + period - reach, x < x[0] + reach
        x = np.r_[x[before] - period, x, x[after] + period]
        y = np.vstack([y[before], y, y[after]])
        inner = np.r_[knots[:-1] - period, knots[:-1], knots + period]
        inner = inner[(inner > x[0] + CLOSEST_PX / 2) & (inner < x[-1] - CLOSEST_PX / 2)]
    inner = inner[(inner > x[0]) & (inner < x[-1])]
    inner = _with_data(inner, x)
    t = np.r_[[x[0]] * 4, inner, [x[-1]] * 4]
    return make_lsq_spline(x, y, t, 3)


def _with_data(inner: NDArray, x: NDArray) -> NDArray:
    """The knots that leave enough points in every interval to determine the spline.

    Only the interval over a gap may be empty, between two that are not: so the cubic that crosses
    it bends as it must, and those on either side follow what was measured there.
    """
    kept, last, crossing = [], 0, False
    for knot in inner:
        upto = int(np.searchsorted(x, knot))
        enough = upto - last >= 3
        beyond = 0 < upto < len(x) and x[upto] - x[upto - 1] > GAP_PX and kept and not crossing
        if (enough or beyond) and len(x) - upto >= 3:
            kept.append(knot)
            last, crossing = upto, not enough
    return np.array(kept)


def place_knots(
    s: NDArray, curvature: NDArray, valid: NDArray, length: float, widest: float
) -> NDArray:
    """Knots over [0, length], closer in bends; at the edges of a gap and none inside it."""
    from scipy.ndimage import maximum_filter1d

    bend = maximum_filter1d(np.abs(curvature), 9)
    spacing = np.clip(BEND_SHARE / np.maximum(bend, 1e-6), CLOSEST_PX, widest)
    knots = [np.array([0.0])]
    for seen in runs(valid, False):
        run, gaps = s[seen], spacing[seen]
        count = np.r_[0.0, np.cumsum(np.diff(run) / ((gaps[1:] + gaps[:-1]) / 2))]
        knots.append(np.interp(np.linspace(0, count[-1], max(1, round(count[-1])) + 1), count, run))
    at = np.unique(np.concatenate([*knots, [length]]))
    return at[(at >= 0) & (at <= length)]


def curvature_of(spline, s: NDArray) -> NDArray:
    """Signed curvature [1/px] of a plane spline."""
    first, second = spline(s, 1), spline(s, 2)
    speed = np.maximum(np.hypot(first[:, 0], first[:, 1]), 1e-9)
    return (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3


def runs(flags: NDArray[np.bool_], closed: bool) -> Iterator[NDArray[np.int64]]:
    """Indices of each run of flags; on a ring one may run through the seam."""
    if flags.all() or not flags.any():
        yield from [np.arange(len(flags))] if flags.any() else []
        return
    shift = int(np.argmin(flags)) if closed else 0
    rolled = np.roll(flags, -shift)
    edges = np.flatnonzero(np.diff(np.r_[False, rolled, False].astype(int))).reshape(-1, 2)
    for start, stop in edges:
        yield (np.arange(start, stop) + shift) % len(flags)
