"""The smallest distance from proxies to a fixture, computed without the engine that placed them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.engine.choosing import exact_shape
from vfplan.engine.parameters import Rule
from vfplan.fixture import Fixture, Pieces
from vfplan.geometry import ROUNDING
from vfplan.replaying.quantities import flattened, row_norms

Array = NDArray[np.float64]

PAIRS_AT_ONCE = 2_000_000
"""Distances that are held in memory at a time, about 50 MB."""

TICKS_AT_ONCE = 64
"""Ticks that are compared with a mesh together."""

CELLS_ACROSS = 64
"""Cells along the longest side of a cloud. Smaller ones are tried while few of them hold points."""

FEW_CELLS = CELLS_ACROSS**2
"""Cells with points up to which smaller cells still pay: a flat cloud's. All three numbers only set
the speed."""

# A cell's key holds its three coordinates in 21 bits each, of which the highest is unused.
KEY_STEP = 1 << np.iinfo(np.int64).bits // 3
# Mask that removes the bit that a halved coordinate passes to its neighbour in the key.
HALVED_KEY_MASK = ~(KEY_STEP >> 1 | KEY_STEP * KEY_STEP >> 1)

HALF_DIAGONAL = math.sqrt(3) / 2 * (1 + ROUNDING)
"""Half a cube's diagonal in units of its side, rounded up."""


def clearance_of(fixture: Fixture, rule: Rule) -> Clearance | None:
    """To what the rule renders: the curve, the triangles, the points; `None` where all guides."""
    radius = fixture.contact_radius + fixture.point_radius
    if rule == "exact":
        kind = exact_shape(fixture)
        if kind == "curve":
            return CurveClearance(fixture.region.pieces, radius, fixture.ignore_axis)
        if kind == "mesh":
            return MeshClearance(fixture.points, fixture.mesh, radius)
    points = fixture.forbidden
    return None if not len(points) else PointClearance(points, radius, fixture.ignore_axis)


class Clearance:
    """Keep the minimum over all ticks of the distance to something, minus `radius`, R [m]."""

    def __init__(self, radius: float) -> None:
        self._radius = radius
        self._distance = np.inf

    @property
    def minimum_m(self) -> float:
        """The smallest clearance so far [m]; below 0 the proxy's ball overlaps the fixture."""
        return float(self._distance - self._radius)

    def update(self, proxy: Array) -> None:
        """Add the proxies of a block, (n, 3) [m]."""
        raise NotImplementedError


class CurveClearance(Clearance):
    """To lines and arcs, across an ignored axis."""

    def __init__(self, pieces: Pieces, radius: float, axis: Array) -> None:
        super().__init__(radius)
        self._curve = (pieces.vertices, pieces.bulges, pieces.stroke, pieces.closed.view(np.uint8))
        self._axis = axis

    def update(self, proxy: Array) -> None:
        """Add the proxies of a block, (n, 3) [m]."""
        distances = _core.distance_to_pieces(*self._curve, self._axis, np.ascontiguousarray(proxy))
        self._distance = min(self._distance, float(distances.min()))


class MeshClearance(Clearance):
    """To triangles (K, 3), rows of corners (N, 3) [m].

    The middles of the triangles are searched first. A triangle's nearest point is computed only
    where the disk around its middle that holds it comes nearer than the smallest distance so far.
    """

    def __init__(self, points: Array, triangles: NDArray[np.int32], radius: float) -> None:
        from scipy.spatial import cKDTree

        super().__init__(radius)
        corners = points[triangles]
        self._corners = corners
        self._middle = corners.mean(axis=1)
        self._size = np.linalg.norm(corners - self._middle[:, None], axis=2).max(axis=1)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._normal = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        # Triangles of about one size share a tree, so that a few large ones do not widen the search
        # for all others.
        size_class = np.frexp(self._size)[1]
        self._rows = []
        self._trees = []
        for value in np.unique(size_class):
            rows = np.flatnonzero(size_class == value)
            self._rows.append(rows)
            self._trees.append(cKDTree(self._middle[rows]))

    def update(self, proxy: Array) -> None:
        """Add the proxies of a block, (n, 3) [m]."""
        for start in range(0, len(proxy), TICKS_AT_ONCE):
            places = proxy[start : start + TICKS_AT_ONCE]
            distances = [tree.query(places)[0] for tree in self._trees]
            self._distance = min(self._distance, float(np.min(distances)))
            for tree, rows, distance in zip(self._trees, self._rows, distances, strict=True):
                reach = self._distance + self._size[rows].max()
                if (distance <= reach).any():
                    self._measure(places[distance <= reach], tree, rows, reach)

    def _measure(self, places: Array, tree: Any, rows: NDArray[np.intp], reach: float) -> None:
        """Measure from the places to the triangles whose middles are within reach [m]."""
        from scipy.spatial import cKDTree

        from vfplan.registration.nearest import on_triangles

        pairs = cKDTree(places).sparse_distance_matrix(tree, reach, output_type="ndarray")
        place = places[pairs["i"]]
        triangle = rows[pairs["j"]]
        # The distance to the disk around the triangle's middle.
        height = ((place - self._middle[triangle]) * self._normal[triangle]).sum(axis=1)
        from_middle = np.sqrt(np.maximum(pairs["v"] ** 2 - height**2, 0.0))
        from_rim = np.maximum(from_middle - self._size[triangle], 0.0)
        may_count = np.hypot(height, from_rim) <= self._distance
        place = place[may_count]
        difference = on_triangles(place, self._corners[triangle[may_count]]) - place
        distance = np.linalg.norm(difference, axis=1).min(initial=self._distance)
        self._distance = float(distance)


class PointClearance(Clearance):
    """To points (N, 3) [m], across an ignored axis where there is one.

    The points and the ticks lie in cells. The ticks of a cell are compared with the points of the
    cells that can hold their nearest point, and only if that can be the nearest of all.
    """

    def __init__(self, points: Array, radius: float, axis: Array | None) -> None:
        super().__init__(radius)
        self._axis = axis
        points = flattened(points, axis)
        self._low = points.min(axis=0)
        self._high = points.max(axis=0)
        cell = max(radius / 2, float((self._high - self._low).max()) / CELLS_ACROSS)
        # Begin with the smallest cells and double them until few of them hold points.
        halvings = min(13, int(np.log2(2 * cell / radius)))
        steps = (KEY_STEP**2, KEY_STEP, 1)
        keys = ((points - self._low) * (2**halvings / cell)).astype(int) @ steps
        occupied = np.unique(keys)
        while halvings and len(occupied) > FEW_CELLS:
            halvings -= 1
            keys = keys >> 1 & HALVED_KEY_MASK
            occupied = np.unique(occupied >> 1 & HALVED_KEY_MASK)
        self._cell = cell / 2**halvings
        # The points, cell by cell, and where each cell begins.
        self._points = points[np.argsort(keys, kind="stable")]
        self._starts = np.append(np.searchsorted(np.sort(keys), occupied), len(points))
        coordinates = occupied[:, None] // steps % KEY_STEP
        self._centres = self._low + (coordinates + 0.5) * self._cell

    def update(self, proxy: Array) -> None:
        """Add the proxies of a block, (n, 3) [m]."""
        places = flattened(proxy, self._axis)
        from_box = row_norms(places - np.clip(places, self._low, self._high))
        self._measure(places[[from_box.argmin()]])
        places = places[from_box < self._distance]
        cells = (places - self._low) // self._cell
        order = np.lexsort(cells.T)
        is_new_cell = (np.diff(cells[order], axis=0) != 0).any(axis=1)
        for group in np.split(places[order], np.flatnonzero(is_new_cell) + 1):
            self._measure(group)

    def _measure(self, places: Array) -> None:
        """Measure from the places (n, 3), which lie in one cell."""
        if not len(places):
            return
        half_diagonal = HALF_DIAGONAL * self._cell
        middle = self._low + ((places[0] - self._low) // self._cell + 0.5) * self._cell
        # A point of another cell may be half a diagonal from its cell's middle, as a place is from
        # its own.
        cells = self._nearest_possible(row_norms(self._centres - middle), 2 * half_diagonal)
        if not len(cells):
            return
        candidates = np.concatenate(
            [self._points[self._starts[k] : self._starts[k + 1]] for k in cells]
        )
        rows = self._nearest_possible(row_norms(candidates - middle), half_diagonal)
        candidates = candidates[rows]
        if not len(candidates):
            return
        count = max(1, PAIRS_AT_ONCE // len(candidates))
        for start in range(0, len(places), count):
            part = places[start : start + count, None]
            squares = (part[..., 0] - candidates[:, 0]) ** 2
            for axis in (1, 2):
                squares = squares + (part[..., axis] - candidates[:, axis]) ** 2
            self._distance = min(self._distance, float(np.sqrt(squares.min())))

    def _nearest_possible(self, distance: Array, slack: float) -> NDArray[np.intp]:
        """Rows at such distances from a middle that may be the nearest to a place within slack."""
        may_be_smallest = distance - slack < self._distance
        may_be_nearest = distance - 2 * slack <= distance.min()
        return np.flatnonzero(may_be_smallest & may_be_nearest)
