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

    points: (N, 3) corners
    triangles: (K, 3) rows of them, alike in orientation
    """
    triangles, near = triangles.copy(), np.arange(len(triangles))
    for _ in range(PASSES):
        cosines = _cosines(points[triangles[near]])
        flat = np.flatnonzero(cosines.min(axis=1) < FLAT)
        flat = flat[np.argsort(cosines[flat].min(axis=1), kind="stable")]
        rows, corner = near[flat], cosines[flat].argmin(axis=1)
        touched = np.zeros(len(points), dtype=bool)
        touched[triangles[rows]] = True
        near = np.flatnonzero(touched[triangles].any(axis=1))
        if not _flipped(points, triangles, _pairs(triangles, near, rows, corner)):
            break
    return triangles


def _pairs(
    triangles: Triangles, near: NDArray[np.intp], rows: NDArray[np.intp], corner: NDArray[np.intp]
) -> list[tuple[int, ...]]:
    """Two triangles and the four corners (a, b, c, d) of each flip of b-c to a-d, a new edge.

    No triangle is in two of them; `near` are all triangles at the corners of `rows`.
    """
    owner = {}
    for row, (a, b, c) in zip(near.tolist(), triangles[near].tolist(), strict=True):
        owner[a, b], owner[b, c], owner[c, a] = row, row, row
    pairs, taken = [], set()
    for row, k in zip(rows.tolist(), corner.tolist(), strict=True):
        b, c, a = (triangles.item(row, (k + turn) % 3) for turn in (1, 2, 3))
        other = owner.get((c, b))
        if other is None or taken & {row, other}:
            continue
        d = int(triangles[other].sum()) - b - c
        if (a, d) not in owner and (d, a) not in owner:
            taken |= {row, other}
            owner[a, d] = row  # a second flip must not make the same edge
            pairs.append((row, other, a, b, c, d))
    return pairs


def _flipped(points: Array, triangles: Triangles, pairs: list[tuple[int, ...]]) -> bool:
    """Flip where that makes the narrowest corner wider; whether any was."""
    row, other, a, b, c, d = np.array(pairs, dtype=np.int64).reshape(-1, 6).T
    new = np.stack([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    old = triangles[np.stack([row, other])]
    narrow = [_cosines(points[two]).max(axis=2).max(axis=0) for two in (old, new)]
    better = narrow[1] < narrow[0]
    triangles[row[better]], triangles[other[better]] = new[0, better], new[1, better]
    return bool(better.any())


def _cosines(corners: Array) -> Array:
    """(..., 3) of the angles of triangles (..., 3, 3)."""
    along = np.roll(corners, -1, axis=-2) - corners
    back = np.roll(corners, 1, axis=-2) - corners
    sizes = np.sqrt((along**2).sum(axis=-1) * (back**2).sum(axis=-1))
    return np.asarray((along * back).sum(axis=-1) / np.maximum(sizes, np.finfo(float).tiny))
