"""The least distance between proxies and fixture, found without the engine that placed them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.engine.parameters import Rule
from vfplan.engine.renderable import exact_of
from vfplan.fixture import Fixture, Pieces
from vfplan.replaying.quantities import flattened, row_norms

Array = NDArray[np.float64]
_PAIRS = 2_000_000  # distances held at a time
_STRIDE = 64  # ticks held against a mesh together
_ACROSS = 64  # cells along a cloud, more where few of them hold points
_FEW = 4096
_FIELD = 1 << 21  # of each coordinate in a cell's key, its highest bit unused
_HALVES = ~(_FIELD >> 1 | _FIELD * _FIELD >> 1)


def clearance_of(fixture: Fixture, rule: Rule) -> Clearance | None:
    """To what the rule renders: the curve, the triangles, the points; `None` where all guides."""
    kind, radius = exact_of(fixture) if rule == "exact" else None, fixture.contact_radius
    radius += fixture.point_radius
    if kind == "curve":
        return CurveClearance(fixture.region.pieces, radius, fixture.ignore_axis)
    if kind == "mesh":
        return MeshClearance(fixture.points, fixture.mesh, radius)
    points = fixture.forbidden
    return PointClearance(points, radius, fixture.ignore_axis) if len(points) else None


class Clearance:
    """Keep the minimum over all ticks of the distance to something, less `radius`, R [m]."""

    def __init__(self, radius: float) -> None:
        self._radius, self._nearest = radius, np.inf

    @property
    def minimum_m(self) -> float:
        """The least clearance so far [m]; below 0 the proxy's ball overlaps the fixture."""
        return float(self._nearest - self._radius)

    def update(self, proxy: Array) -> None:
        """Take in the proxies of a block, (n, 3) [m]."""
        raise NotImplementedError


class CurveClearance(Clearance):
    """To lines and arcs, across an ignored axis."""

    def __init__(self, pieces: Pieces, radius: float, axis: Array) -> None:
        super().__init__(radius)
        self._curve = (pieces.vertices, pieces.bulges, pieces.stroke, pieces.closed.view(np.uint8))
        self._axis = axis

    def update(self, proxy: Array) -> None:
        """As `Clearance` has it."""
        distances = _core.distance_to_pieces(*self._curve, self._axis, np.ascontiguousarray(proxy))
        self._nearest = min(self._nearest, float(distances.min()))


class MeshClearance(Clearance):
    """To triangles (K, 3), rows of corners (N, 3) [m]."""

    def __init__(self, points: Array, triangles: NDArray[np.int32], radius: float) -> None:
        from scipy.spatial import cKDTree

        super().__init__(radius)
        corners = points[triangles]
        self._corners, self._middle = corners, corners.mean(axis=1)
        self._size = np.linalg.norm(corners - self._middle[:, None], axis=2).max(axis=1)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._normal = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        # Those of about one size in a tree of their own: a few large ones widen no other's search.
        kind = np.frexp(self._size)[1]
        self._rows = [np.flatnonzero(kind == k) for k in np.unique(kind)]
        self._trees = [cKDTree(self._middle[rows]) for rows in self._rows]

    def update(self, proxy: Array) -> None:
        """As `Clearance` has it."""
        for start in range(0, len(proxy), _STRIDE):
            places = proxy[start : start + _STRIDE]
            away = [tree.query(places)[0] for tree in self._trees]
            self._nearest = min(self._nearest, float(np.min(away)))
            for tree, rows, off in zip(self._trees, self._rows, away, strict=True):
                reach = self._nearest + self._size[rows].max()
                if (off <= reach).any():
                    self._look(places[off <= reach], tree, rows, reach)

    def _look(self, places: Array, tree: Any, rows: NDArray[np.intp], reach: float) -> None:
        from scipy.spatial import cKDTree

        pairs = cKDTree(places).sparse_distance_matrix(tree, reach, output_type="ndarray")
        x, k = places[pairs["i"]], rows[pairs["j"]]
        # Each lies in a disk around its middle.
        high = ((x - self._middle[k]) * self._normal[k]).sum(axis=1)
        wide = np.sqrt(np.maximum(pairs["v"] ** 2 - high**2, 0.0)) - self._size[k]
        near = np.hypot(high, np.maximum(wide, 0.0)) <= self._nearest
        from vfplan.registration.nearest import on_triangles

        found = on_triangles(x[near], self._corners[k[near]]) - x[near]
        self._nearest = float(np.linalg.norm(found, axis=1).min(initial=self._nearest))


class PointClearance(Clearance):
    """To points (N, 3) [m], across an ignored axis where there is one.

    The points and the ticks lie in cells: the ticks of a cell are compared with the cells in which
    their nearest point can be, if that can be the nearest of all.
    """

    def __init__(self, points: Array, radius: float, axis: Array | None) -> None:
        super().__init__(radius)
        self._axis = axis
        points = flattened(points, axis)
        self._low, self._high = points.min(axis=0), points.max(axis=0)
        cell = max(radius / 2, float((self._high - self._low).max()) / _ACROSS)
        halved = min(13, int(np.log2(2 * cell / radius)))
        keys = ((points - self._low) * (2**halved / cell)).astype(int) @ (_FIELD**2, _FIELD, 1)
        held = np.unique(keys)
        while halved and len(held) > _FEW:
            halved, keys, held = halved - 1, keys >> 1 & _HALVES, np.unique(held >> 1 & _HALVES)
        self._cell = cell / 2**halved
        self._points = points[np.argsort(keys, kind="stable")]
        self._spans = np.append(np.searchsorted(np.sort(keys), held), len(points))
        cells = held[:, None] // (_FIELD**2, _FIELD, 1) % _FIELD
        self._centres = self._low + (cells + 0.5) * self._cell

    def update(self, proxy: Array) -> None:
        """As `Clearance` has it."""
        places = flattened(proxy, self._axis)
        beyond = row_norms(places - np.clip(places, self._low, self._high))
        self._look(places[[beyond.argmin()]])
        places = places[beyond < self._nearest]
        cells = (places - self._low) // self._cell
        order = np.lexsort(cells.T)
        other = (np.diff(cells[order], axis=0) != 0).any(axis=1)
        for group in np.split(places[order], np.flatnonzero(other) + 1):
            self._look(group)

    def _look(self, places: Array) -> None:
        if not len(places):
            return
        off = 0.87 * self._cell  # of a tick, and of a point, from the middle of its cell
        middle = self._low + ((places[0] - self._low) // self._cell + 0.5) * self._cell
        near = np.flatnonzero(self._may_be_nearest(row_norms(self._centres - middle), 2 * off))
        if not len(near):
            return
        spans = [self._points[self._spans[k] : self._spans[k + 1]] for k in near]
        candidates = np.concatenate(spans)
        candidates = candidates[self._may_be_nearest(row_norms(candidates - middle), off)]
        if not len(candidates):
            return
        rows = max(1, _PAIRS // len(candidates))
        for start in range(0, len(places), rows):
            part = places[start : start + rows, None]
            squares = sum((part[..., i] - candidates[:, i]) ** 2 for i in range(3))
            self._nearest = min(self._nearest, float(np.sqrt(squares.min())))

    def _may_be_nearest(self, away: Array, off: float) -> NDArray[np.bool_]:
        """Of what is so far from a middle: what may be the nearest to a tick within `off`."""
        return (away - off < self._nearest) & (away - 2 * off <= away.min())
