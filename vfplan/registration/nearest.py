"""The nearest place on a mesh, for points that lie close to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.geometry import ROWS_AT_ONCE

from vfplan.registration.models import Array

# Number of nearest corners whose triangles are compared.
CORNERS = 4


class NearestOnMesh:
    """Finds the nearest place among the triangles that meet in a point's nearest corners.

    That is the nearest place of the whole mesh where its triangles are of about one size and the
    point is not much further away than they are large; elsewhere a place somewhat further.

    points: (N, 3) corners [m]
    triangles: (K, 3) rows of them
    """

    def __init__(self, points: Array, triangles: NDArray[np.int32]) -> None:
        from scipy.sparse import csr_array
        from scipy.spatial import cKDTree

        self.points, self.triangles = points, triangles
        used = np.bincount(triangles.ravel(), minlength=len(points)) > 0
        self._tree = cKDTree(points[used])
        corner = (np.cumsum(used) - 1)[triangles.ravel()]
        incidence = csr_array((np.ones(len(corner)), (corner, np.arange(len(corner)) // 3)))
        # Triangles around each corner, one corner after the other.
        self._around, self._first = incidence.indices, incidence.indptr

    def __call__(self, places: Array) -> tuple[Array, NDArray[np.intp]]:
        """Nearest place (M, 3) on the mesh to each of (M, 3), and the triangle it lies in (M,)."""
        nearest = np.empty_like(places)
        rows = np.empty(len(places), dtype=np.intp)
        for start in range(0, len(places), ROWS_AT_ONCE):
            block = slice(start, start + ROWS_AT_ONCE)
            nearest[block], rows[block] = self._nearest(places[block])
        return nearest, rows

    def normals(self, rows: NDArray[np.intp]) -> Array:
        """(M, 3) unit normals of triangles, to the side from which they turn anticlockwise."""
        a, b, c = np.moveaxis(self.points[self.triangles[rows]], 1, 0)
        normal = np.cross(b - a, c - a)
        return normal / np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)[:, None]

    def _nearest(self, places: Array) -> tuple[Array, NDArray[np.intp]]:
        corners = min(CORNERS, self._tree.n)
        corner = self._tree.query(places, k=[*range(1, corners + 1)])[1].ravel()
        # All triangles around the nearest corners of each place, one row each.
        count = self._first[corner + 1] - self._first[corner]
        owner = np.repeat(np.repeat(np.arange(len(places)), corners), count)
        start = np.repeat(self._first[corner] - (np.cumsum(count) - count), count)
        rows = self._around[start + np.arange(len(owner))]
        nearest = on_triangles(places[owner], self.points[self.triangles[rows]])
        square = ((places[owner] - nearest) ** 2).sum(axis=1)
        # The nearest of each place's triangles.
        order = np.lexsort((square, owner))
        best = order[np.searchsorted(owner[order], np.arange(len(places)))]
        return nearest[best], rows[best]


def on_triangles(places: Array, corners: Array) -> Array:
    """(M, 3) nearest place of each triangle (M, 3, 3) to its point (M, 3)."""
    best = np.empty_like(places)
    smallest = np.full(len(places), np.inf)

    def take_nearer(candidate: Array, is_allowed: NDArray[np.bool_]) -> None:
        square = ((places - candidate) ** 2).sum(axis=1)
        is_nearer = is_allowed & (square < smallest)
        best[is_nearer], smallest[is_nearer] = candidate[is_nearer], square[is_nearer]

    # The nearest place of each edge.
    for k in range(3):
        start, along = corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
        length = np.maximum((along**2).sum(axis=1), np.finfo(float).tiny)
        t = np.clip(((places - start) * along).sum(axis=1) / length, 0.0, 1.0)
        take_nearer(start + t[:, None] * along, np.full(len(places), True))

    # The foot on the triangle's plane, where it lies inside.
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    square = (normal**2).sum(axis=1)
    is_inside = square > 0
    square = np.where(is_inside, square, 1.0)
    foot = places - (((places - a) * normal).sum(axis=1) / square)[:, None] * normal
    for first, second in ((a, b), (b, c), (c, a)):
        is_inside &= (np.cross(second - first, foot - first) * normal).sum(axis=1) >= 0
    take_nearer(foot, is_inside)
    return best
