"""Triangles without height: a corner nearly on the opposite edge, which marching cubes leaves.

Such an edge is given to the corner: the two triangles at it become two others. The surface moves by
no more than the flat one's height, and no corner moves at all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Triangles = NDArray[np.int32]
FLAT = np.cos(np.radians(150.0))  # a corner that is wider
PASSES = 12


def without_caps(points: Array, triangles: Triangles) -> Triangles:
    """The same surface with the edges opposite wide corners flipped.

    Parameters
    ----------
    points
        (N, 3) corners.
    triangles
        (K, 3) rows of them, alike in orientation.
    """
    triangles = triangles.copy()
    for _ in range(PASSES):
        wide = _cosines(points[triangles])
        rows = np.flatnonzero(wide.min(axis=1) < FLAT)
        rows = rows[np.argsort(wide[rows].min(axis=1), kind="stable")]
        if not sum([_flip(points, triangles, *pair) for pair in _pairs(triangles, wide, rows)]):
            break
    return triangles


def _pairs(triangles: Triangles, wide: Array, rows: NDArray[np.intp]) -> list[tuple]:
    """(triangle, its corner, the neighbour beyond, its corner) where the flip adds a new edge."""
    size = int(triangles.max()) + 1
    directed = triangles.astype(np.int64) * size + np.roll(triangles, -1, axis=1)
    owner = {int(key): k // 3 for k, key in enumerate(directed.ravel())}
    pairs, taken = [], set()
    for row in rows:
        k = int(wide[row].argmin())
        a, b, c = (int(triangles[row, (k + j) % 3]) for j in range(3))
        other = owner.get(c * size + b)
        if other is None or taken & {int(row), other}:
            continue
        d = int(triangles[other].sum()) - b - c
        if a * size + d not in owner and d * size + a not in owner:
            taken |= {int(row), other}
            owner[a * size + d] = row  # a second flip must not make the same edge
            pairs.append((int(row), (a, b, c), other, d))
    return pairs


def _flip(
    points: Array, triangles: Triangles, row: int, corners: tuple[int, int, int], other: int, d: int
) -> bool:
    """Flip one edge where that makes the narrowest corner wider."""
    a, b, c = corners
    new = np.array([[a, b, d], [a, d, c]])
    before = _cosines(points[triangles[[row, other]]]).max()
    if _cosines(points[new]).max() >= before:
        return False
    triangles[[row, other]] = new
    return True


def _cosines(corners: Array) -> Array:
    """(K, 3) of the angles of triangles (K, 3, 3)."""
    along = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, 1, axis=1) - corners
    sizes = np.linalg.norm(along, axis=2) * np.linalg.norm(back, axis=2)
    return np.asarray((along * back).sum(axis=2) / np.maximum(sizes, np.finfo(float).tiny))
