"""A mask's skeleton as a graph: ordered pixel paths, their ends and their junctions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# (row, column) steps to half of the eight neighbours; the other half is the same edges again.
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))
# A skeleton ends before its line does, by half the width and a little more; how far before tells
# whether it was eaten. Half a pen's width is no more than `BROADEST_PX`.
NEAR_PX, BROADEST_PX = 8, 16.0
EATEN, EATEN_PX = 1.5, 3.0  # times half the width, and so much more [px]


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
    of it at worst. Where it left much of a line without a skeleton, Lee's way makes it anew.
    """
    from skimage.morphology import skeletonize

    padded = np.pad(mask.view(bool), 1)
    bone = skeletonize(padded)
    for box, line in _eaten(padded, bone):
        bone[box] = np.where(line, skeletonize(line, method="lee") > 0, bone[box])
    return bone[1:-1, 1:-1]


def _eaten(
    mask: NDArray[np.bool_], bone: NDArray[np.bool_]
) -> Iterator[tuple[tuple[slice, slice], NDArray[np.bool_]]]:
    """Boxes of a mask, and the line in each of which a part lies far from its own skeleton."""
    import cv2

    size = 2 * NEAR_PX + 1
    near = cv2.dilate(bone.view(np.uint8), np.ones((size, size), np.uint8))
    far = np.flatnonzero(mask & (near == 0))
    if not len(far):
        return
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8), connectivity=8)
    for label in np.unique(labels.ravel()[far]):
        left, top, width, height, _ = boxes[label].tolist()
        box = (slice(top - 1, top + height + 1), slice(left - 1, left + width + 1))
        line = labels[box] == label
        half = cv2.distanceTransform(line.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5).max()
        bare = (~(bone[box] & line)).view(np.uint8)
        away = cv2.distanceTransform(bare, cv2.DIST_L2, cv2.DIST_MASK_5)[line].max()
        if half <= BROADEST_PX and away > EATEN * half + EATEN_PX:
            yield box, line


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
    neighbours: list[list[int]] = [[] for _ in rows]
    for a, b in pairs.tolist():
        neighbours[a].append(b)
        neighbours[b].append(a)
    forks = {i for i, near in enumerate(neighbours) if len(near) > 2}
    pixels = np.column_stack([cols, rows]).astype(np.int64)
    branches, seen = [], set(forks)
    # Free ends first, so that every open branch is walked from an end.
    for start in sorted(range(len(rows)), key=lambda i: len(neighbours[i]) > 1):
        if start in seen or (len(neighbours[start]) == 2 and _inside(start, neighbours, forks)):
            continue
        branches.append(_walk(start, neighbours, forks, seen, pixels))
    for start in range(len(rows)):  # what is left are rings without a fork
        if start not in seen:
            branches.append(_walk(start, neighbours, forks, seen, pixels))
    return branches, [tuple(pixels[i].tolist()) for i in sorted(forks)]


def _inside(pixel: int, neighbours: list[list[int]], forks: set[int]) -> bool:
    return not any(n in forks for n in neighbours[pixel])


def _walk(
    start: int, neighbours: list[list[int]], forks: set[int], seen: set[int], pixels: NDArray
) -> Branch:
    order = [start]
    seen.add(start)
    while True:
        onward = [n for n in neighbours[order[-1]] if n not in seen]
        if not onward:
            break
        order.append(onward[0])
        seen.add(onward[0])
    last = order[-1]
    closed = len(order) > 2 and start in neighbours[last]
    free = tuple(not any(n in forks for n in neighbours[end]) for end in (start, last))
    return Branch(pixels[order], closed, (free[0] and not closed, free[1] and not closed))
