"""Straight marks that point or measure: arrows, scale bars and callipers, leaders."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate
from vfplan.curve.skeleton import Branch

POINTER = 2.0  # an arrow is at least this many times shorter than the curve it stands beside
TICK_PX, TICK = 6, 1.5  # a scale's ticks reach so far along it, and so far aside of it [px]
SHAFT = 0.75  # of a straight mark's path, at least
NEAR_WORDS_PX, THINNER = 20.0, 0.7  # a leader begins at words; its width over the curve's
WORD_PX = 50  # of line in a letter at most


def is_scale(line: Candidate, mask: NDArray) -> bool:
    """A straight shaft with a tick, a cross or a dot at both ends: a scale bar, a calliper."""
    import cv2

    if line.closed or len(line.marks) > 1:
        return False
    u, v, width, height = line.box
    reach = 2 * round(line.width_px) + TICK_PX
    top, left = max(v - reach, 0), max(u - reach, 0)
    crop = mask[top : v + height + reach, left : u + width + reach].view(np.uint8)
    label = cv2.connectedComponents(crop, connectivity=8)[1]
    path = max((b.path for b in line.marks[0].branches), key=len)
    if not _mostly_straight(path):
        return False
    begin, end = path[len(path) // 4] - [left, top], path[3 * len(path) // 4] - [left, top]
    ink = np.column_stack(np.nonzero(label == label[begin[1], begin[0]])[::-1])
    along = (end - begin) / np.hypot(*(end - begin))
    t = (ink - begin) @ along
    x = (ink - begin) @ [-along[1], along[0]]
    t -= t.min()
    head, tail = t < reach, t > t.max() - reach
    shaft = ~head & ~tail
    if not shaft.any() or np.abs(x[shaft]).max() > line.width_px + 0.02 * t.max() + 1:
        return False
    across = [side * x[end] for end in (head, tail) for side in (1, -1)]
    return min(part.max() for part in across) > line.width_px / 2 + TICK


def is_arrow(line: Candidate, mask: NDArray) -> bool:
    """A straight shaft with two barbs, or with a filled head, at one end."""
    if line.closed or len(line.marks) > 1:
        return False
    branches = sorted(line.marks[0].branches, key=lambda b: -b.length)
    shaft = branches[0].path
    if not _straight(shaft):
        return False
    if line.junctions:
        barbs = branches[1:]
        tip = np.mean(line.junctions, axis=0)
        near = all(np.hypot(*(np.array(j) - tip)) < 2.5 * line.width_px for j in line.junctions)
        short = all(b.length < 0.5 * branches[0].length for b in barbs)
        return near and short and 2 <= len(barbs) <= 4 and not all(map(_straight_on(shaft), barbs))
    half = _half_widths(line, mask)
    usual = np.median(half)
    head = half > 1.6 * usual + 0.5
    ends = np.r_[head[: len(head) // 3], head[-(len(head) // 3) :]]
    return bool(ends.sum() >= 3 and ends.sum() == head.sum())


def is_leader(line: Candidate, told: list[Candidate]) -> bool:
    """A straight line, thinner than the longest curve and shorter by half, that words begin."""
    if not line.is_candidate or line.closed:
        return False
    shaft = max((b.path for m in line.marks for b in m.branches), key=len)
    curve = max((c for c in told if c.kind == "curve"), key=lambda c: c.length_px, default=line)
    thin = line.width_px < THINNER * curve.width_px
    if not (thin and POINTER * len(shaft) <= curve.length_px and _mostly_straight(shaft)):
        return False
    small = [c.pixels for c in told if c is not line and c.length_px < WORD_PX]
    small += [b.path for m in line.marks for b in m.branches if len(b.path) < len(shaft) / 2]
    near = [
        sum(np.hypot(*(glyph - end).T).min() < NEAR_WORDS_PX for glyph in small)
        for end in (shaft[0], shaft[-1])
    ]
    return max(near) >= 1 and min(near) == 0


def _straight_on(shaft: NDArray) -> Callable[[Branch], bool]:
    """A test of whether a branch merely carries the shaft on."""
    along = shaft[-1] - shaft[0]

    def test(branch: Branch) -> bool:
        way = branch.path[-1] - branch.path[0]
        size = np.hypot(*way) * np.hypot(*along)
        return bool(size and abs(way @ along) > 0.95 * size)

    return test


def _straight(path: NDArray) -> bool:
    chord = (path[-1] - path[0]).astype(float)
    length = np.hypot(*chord)
    if length < 8:
        return False
    aside = np.abs((path - path[0]) @ np.array([-chord[1], chord[0]])) / length
    return bool(aside.max() < 1.2 + 0.02 * length)


def _mostly_straight(path: NDArray) -> bool:
    """Whether a path is straight but for hooks at its ends."""
    begin, end = path[len(path) // 4], path[3 * len(path) // 4]
    chord = (end - begin).astype(float)
    length = np.hypot(*chord)
    if length < 8:
        return False
    aside = np.abs((path - begin) @ np.array([-chord[1], chord[0]])) / length
    return bool((aside < 1.2 + 0.02 * length).mean() > SHAFT)


def _half_widths(line: Candidate, mask: NDArray) -> NDArray:
    """(M,) distance of each path pixel from the mark's edge [px]."""
    import cv2

    path = line.pixels  # of a faded line, some lie outside the box of its mask
    left, top = np.maximum(path.min(0) - 1, 0)
    right, bottom = path.max(0) + 2
    reach = int(np.ceil(line.width_px))
    left, top = max(left - reach, 0), max(top - reach, 0)
    crop = mask[top : bottom + reach, left : right + reach].view(np.uint8)
    distance = cv2.distanceTransform(np.pad(crop, 1), cv2.DIST_L2, 3)[1:-1, 1:-1]
    return distance[path[:, 1] - top, path[:, 0] - left]
