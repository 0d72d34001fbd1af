"""A mask's skeleton as a graph: ordered pixel paths, their ends and their junctions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# (row, column) steps to half of the eight neighbours; the other half is the same edges again.
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))


@dataclass(frozen=True, eq=False)
class Branch:
    """A run of skeleton pixels between two places where the path ends, forks or closes.

    Parameters
    ----------
    path
        (M, 2) int64 pixels (u, v), in order.
    closed
        Whether the last pixel touches the first.
    free
        Whether its (first, last) pixel ends freely; `False` where it runs into a junction.
    """

    path: NDArray[np.int64]
    closed: bool
    free: tuple[bool, bool]

    @property
    def length(self) -> float:
        """Along the pixels [px]."""
        steps = np.diff(self.path, axis=0)
        return float(np.hypot(steps[:, 0], steps[:, 1]).sum())


def thin(mask: NDArray) -> NDArray[np.bool_]:
    """(H, W) bool, the mask thinned to lines of one pixel; the border is padded first."""
    from skimage.morphology import skeletonize

    padded = np.pad(mask.view(bool), 1)
    return skeletonize(padded)[1:-1, 1:-1]


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

    Parameters
    ----------
    rows, cols
        (M,) int64 pixels of one connected skeleton, sorted by row, then column.
    width
        Columns of the image.

    Returns
    -------
    branches, junctions
        The branches, and the pixels (u, v) where three or more of them meet.
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
