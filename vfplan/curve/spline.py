"""A smoothing spline through measured points: it follows the hand and not the noise.

Knots stand closer where the line bends: a cubic spline with knots h apart departs from a bend of
radius R by little as long as h is below about R/2. On straight runs `widest` px of line share a
knot, so that the noise averages out. No knot falls into a gap: there one cubic, smooth to the
second derivative at both sides, carries the line from edge to edge.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CLOSEST_PX = 3.5
GAP_PX = 2.0  # between neighbouring points: more is a gap
WRAP_PX = 100.0  # a knot's influence fades by a factor of about 4 each knot further
BEND_SHARE = 0.5  # of the radius of curvature: the knots' distance in a bend


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
    edges = np.flatnonzero(np.diff(np.r_[False, valid, False].astype(int))).reshape(-1, 2)
    knots = [np.array([0.0])]
    for start, stop in edges:
        run, gaps = s[start:stop], spacing[start:stop]
        count = np.r_[0.0, np.cumsum(np.diff(run) / ((gaps[1:] + gaps[:-1]) / 2))]
        knots.append(np.interp(np.linspace(0, count[-1], max(1, round(count[-1])) + 1), count, run))
    at = np.unique(np.concatenate([*knots, [length]]))
    return at[(at >= 0) & (at <= length)]


def curvature_of(spline, s: NDArray) -> NDArray:
    """Signed curvature [1/px] of a plane spline."""
    first, second = spline(s, 1), spline(s, 2)
    speed = np.maximum(np.hypot(first[:, 0], first[:, 1]), 1e-9)
    return (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3
