"""What the profiles across a path show of the line there, and a smooth line through them.

A profile is a row of samples across the path; `offset` is where the ink's centre lies in it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.curve import tuned

NEARBY_POINTS = 41
"""Points along a line whose median is what is usual there; longer than a branch's mouth."""

MAX_BRANCH_PX = 60
"""Length [px] of a place where other ink joins the line, over which the line can be carried."""


def is_valley(coverage: NDArray) -> NDArray[np.bool_]:
    """(M, K) bool: samples with stronger ink on both sides, as between two lines that touch."""
    left = np.maximum.accumulate(coverage, axis=1)
    right = np.maximum.accumulate(coverage[:, ::-1], axis=1)[:, ::-1]
    return np.minimum(left, right) - coverage > tuned.RISE * coverage.max(axis=1, keepdims=True)


def usual_nearby(width: NDArray, has_ink: NDArray[np.bool_], usual: float) -> NDArray[np.float64]:
    """(M,) the line's usual width nearby: a pressed pen grows wide slowly, a branch at once."""
    from scipy.ndimage import median_filter

    nearby = np.full(len(width), usual)
    at = np.flatnonzero(has_ink)
    nearby[at] = median_filter(width[at], size=NEARBY_POINTS, mode="nearest")
    return np.maximum(nearby, usual)


def is_strong(peak: NDArray, has_ink: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(M,) bool: half as strong as the ink around, at least; where it is fainter, the line ends."""
    from scipy.ndimage import median_filter

    strong = np.zeros(len(peak), bool)
    at = np.flatnonzero(has_ink)
    if len(at):
        usual = median_filter(peak[at], size=NEARBY_POINTS, mode="nearest")
        strong[at] = peak[at] >= tuned.HALF * usual
    return strong


def jumps(offset: NDArray, has_ink: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(M,) bool: offsets that lie off their neighbours', where the nearest ink is another's."""
    from scipy.ndimage import median_filter

    at = np.flatnonzero(has_ink)
    is_jump = np.zeros(len(offset), bool)
    if len(at) >= 5:
        trend = median_filter(offset[at], size=NEARBY_POINTS, mode="nearest")
        is_jump[at] = np.abs(offset[at] - trend) > 1.5
    return is_jump


def faded(offset: NDArray, has_ink: NDArray[np.bool_], closed: bool) -> NDArray[np.float64]:
    """Offsets along a path; beyond the last ink that of the ink goes on, and fades over ten px."""
    if has_ink.all():
        return offset
    # Steps to the nearest point with ink, and which that is; round a ring through its seam.
    count = len(has_ink)
    places = np.flatnonzero(has_ink)
    if closed:
        places = np.concatenate([places - count, places, places + count])
    own = np.arange(count)
    after = np.clip(np.searchsorted(places, own), 0, len(places) - 1)
    before = np.clip(after - 1, 0, None)
    is_before = np.abs(places[before] - own) < np.abs(places[after] - own)
    nearest = np.where(is_before, places[before], places[after])
    distance = np.abs(nearest - own)
    nearest %= count
    fade = np.exp(-0.5 * (distance / 10.0) ** 2)
    return np.where(has_ink, offset, offset[nearest] * fade)


def past_branches(
    points: NDArray, joined: NDArray[np.bool_], alone: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The points with a smooth way past every place where other ink joins the line.

    There the centre of the ink is not that of the line. The line goes on as on both sides. Also
    returns which points were carried past.
    """
    from scipy.interpolate import CubicSpline

    between = ~alone
    edges = np.flatnonzero(np.diff(np.r_[False, between, False].astype(int))).reshape(-1, 2)
    points = points.copy()
    passed = np.zeros(len(points), bool)
    at = np.flatnonzero(alone)
    for start, stop in edges:
        before = at[at < start][-13::4]
        after = at[at >= stop][:13:4]
        is_branch = joined[start:stop].mean() > 0.5 and stop - start <= MAX_BRANCH_PX
        if not is_branch or len(before) < 2 or len(after) < 2:
            continue
        known = np.r_[before, after]
        run = np.arange(start, stop)
        points[run] = CubicSpline(known, points[known])(run)
        passed[run] = True
    return points, passed
