"""A line's way over the pixels: a mask's skeleton, its branches, and the geometry of a path."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

NEAR_PX = 8  # farther from every skeleton no line lies, but a broad one
# So much of a thinned line's end, in widths beyond a thin line's, may turn to a corner of the pen.
CROOKED, THIN_PX = 1.25, 2.5
STRETCH_PX = 9.0  # of line, or a width, from which the bend at an end is taken
# (row, column) steps to half of the eight neighbours; the other half is the same edges again.
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))


@dataclass(frozen=True, eq=False)
class Branch:
    """A run of skeleton pixels between two places where the path ends, forks or closes."""

    path: NDArray[np.int64]  # (M, 2) int64 pixels (u, v), in order
    closed: bool  # whether the last pixel touches the first
    # Whether its (first, last) pixel ends freely; `False` where it runs into a junction
    free: tuple[bool, bool]

    @property
    def length(self) -> float:
        """Along the pixels [px]."""
        steps = np.diff(self.path, axis=0)
        return float(np.hypot(steps[:, 0], steps[:, 1]).sum())


def thin(mask: NDArray) -> NDArray[np.bool_]:
    """(H, W) bool, the mask thinned to lines of one pixel; the border is padded first.

    Zhang and Suen's way, which is quick, eats a line of even width at 45° from its end, the whole
    of it at worst: where it left a part of the mask without a skeleton near, Lee's is taken.
    """
    import cv2
    from skimage.morphology import skeletonize

    padded = np.pad(mask.view(bool), 1)
    bone = skeletonize(padded)
    near = cv2.dilate(bone.view(np.uint8), np.ones((2 * NEAR_PX + 1,) * 2, np.uint8))
    if (padded & (near == 0)).any():
        bone = skeletonize(padded, method="lee") > 0
    return bone[1:-1, 1:-1]


def edges_of(rows: NDArray, cols: NDArray, width: int) -> NDArray[np.int64]:
    """(E, 2) pairs of neighbouring pixels, as indices into the list sorted by row, then column.

    A diagonal pair that also shares a straight neighbour is left out: the corner of a staircase is
    not a fork.
    """
    flat = rows * (width + 2) + cols
    pairs = []
    for dr, dc in _STEPS:
        target = _find(flat, flat + dr * (width + 2) + dc)
        keep = target >= 0
        if dr and dc:
            corner_a = _find(flat, flat + dr * (width + 2))
            corner_b = _find(flat, flat + dc)
            keep &= (corner_a < 0) & (corner_b < 0)
        here = np.nonzero(keep)[0]
        pairs.append(np.column_stack([here, target[here]]))
    return np.concatenate(pairs)


def _find(haystack: NDArray, needles: NDArray) -> NDArray[np.int64]:
    at = np.searchsorted(haystack, needles)
    at[at == len(haystack)] = 0
    return np.where(haystack[at] == needles, at, -1)


def branches_of(
    rows: NDArray, cols: NDArray, width: int
) -> tuple[list[Branch], list[tuple[int, int]]]:
    """Split one connected skeleton into branches.

    rows, cols: (M,) int64 pixels of one connected skeleton, sorted by row, then column
    width: columns of the image
    Returns the branches, and the pixels (u, v) where three or more of them meet
    """
    pairs = edges_of(rows, cols, width)
    forks = np.bincount(pairs.ravel(), minlength=len(rows)) > 2
    near: list[list[int]] = [[] for _ in rows]  # but for forks
    beside = np.zeros(len(rows), bool)  # a fork
    for a, b in pairs.tolist():
        if forks[a] or forks[b]:
            beside[[a, b]] = True
        else:
            near[a].append(b)
            near[b].append(a)
    pixels = np.column_stack([cols, rows]).astype(np.int64)
    branches, seen = [], set(np.flatnonzero(forks).tolist())
    # Ends first, so that every open branch is walked from one; what is left are rings.
    for start in sorted(range(len(rows)), key=lambda i: len(near[i]) > 1):
        if start not in seen:
            order = _walk(start, near, seen)
            closed = len(order) > 2 and start in near[order[-1]]
            free = tuple(not (closed or beside[end]) for end in (start, order[-1]))
            branches.append(Branch(pixels[order], closed, free))
    return branches, [tuple(each) for each in pixels[forks].tolist()]


def _walk(start: int, near: list[list[int]], seen: set[int]) -> list[int]:
    """The pixels from one on, and marks them as seen."""
    order, onward = [], [start]
    while onward:
        order.append(onward[0])
        seen.add(onward[0])
        onward = [n for n in near[order[-1]] if n not in seen]
    return order


def normals(points: NDArray, closed: bool) -> NDArray:
    """(M, 2) unit normals of a path."""
    if closed:
        tangent = np.roll(points, -1, 0) - np.roll(points, 1, 0)
    else:
        tangent = np.gradient(points, axis=0)
    tangent /= np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-12)[:, None]
    return np.column_stack([-tangent[:, 1], tangent[:, 0]])


def is_straight(path: NDArray) -> bool:
    """Whether a pixel path keeps to the line between its ends."""
    chord = (path[-1] - path[0]).astype(float)
    length = np.hypot(*chord)
    aside = np.abs((path - path[0]) @ np.array([-chord[1], chord[0]])) / max(length, 1.0)
    return bool((aside < 1.2 + 0.02 * length).all())


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


def without_tips(path: NDArray, width: float) -> tuple[NDArray, float]:
    """The path without what thinning bends at its ends, and the length cut off on either side."""
    cut = max(0, min(int(CROOKED * (width - THIN_PX)), (len(path) - 20) // 2))
    kept = path[cut : len(path) - cut]
    return kept, float(arc_length(path[: cut + 1], False)[-1])


def extended(points: NDArray, by: ArrayLike, width: float) -> NDArray:
    """The line carried on by `by` px, or by (first, last), at both ends as it bends there."""
    first, last = np.broadcast_to(by, 2)
    tails = _onward(points[::-1], first, width)[::-1], _onward(points, last, width)
    return np.vstack([tails[0], points, tails[1]])


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
