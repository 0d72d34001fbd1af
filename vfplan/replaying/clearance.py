"""The least distance between proxies and fixture, found without the engine that placed them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.arcs import plane, strokes_of
from vfplan.engine.parameters import Rule
from vfplan.engine.renderable import exact_of
from vfplan.fixture import Fixture
from vfplan.registration.nearest import on_triangles
from vfplan.replaying.quantities import flattened

Array = NDArray[np.float64]
_PAIRS = 2_000_000  # distances held at a time
_STRIDE = 64  # far ticks looked at together


def clearance_of(fixture: Fixture, rule: Rule) -> Clearance | CurveClearance | MeshClearance | None:
    """To what the rule renders: the curve, the triangles, the points; `None` where all guides."""
    kind = exact_of(fixture) if rule == "exact" else None
    if kind == "curve":
        return CurveClearance(fixture.region)
    if kind == "mesh":
        radius = fixture.contact_radius + fixture.point_radius
        return MeshClearance(fixture.points, fixture.mesh, radius)
    return Clearance(fixture) if len(fixture.forbidden) else None


class CurveClearance:
    """Keep the minimum of the distance to lines and arcs, less R [m].

    fixture: its pieces, radii and ignored axis
    """

    def __init__(self, fixture: Fixture) -> None:
        self._radius = fixture.contact_radius + fixture.point_radius
        self._frame = plane(fixture.ignore_axis)
        self._strokes = strokes_of(fixture.pieces, self._frame)
        self._nearest = np.inf

    @property
    def minimum_m(self) -> float:
        """The least clearance so far [m]."""
        return float(self._nearest - self._radius)

    def update(self, proxy: Array) -> None:
        """Take in the proxies of a block, (n, 3) [m]."""
        flat = proxy @ self._frame.T
        for stroke in self._strokes:
            self._nearest = min(self._nearest, float(stroke.distance(flat).min()))


class MeshClearance:
    """Keep the minimum of the distance to triangles, less R [m].

    points, triangles: (N, 3) corners [m], and (K, 3) rows of them
    radius: R [m]
    """

    def __init__(self, points: Array, triangles: NDArray[np.int32], radius: float) -> None:
        from scipy.spatial import cKDTree

        self._radius, corners = radius, points[triangles]
        self._corners, self._middle = corners, corners.mean(axis=1)
        self._size = np.linalg.norm(corners - self._middle[:, None], axis=2).max(axis=1)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._normal = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        # Those of about one size in a tree of their own: a few large ones widen no other's search.
        kind = np.frexp(self._size)[1]
        self._rows = [np.flatnonzero(kind == k) for k in np.unique(kind)]
        self._trees = [cKDTree(self._middle[rows]) for rows in self._rows]
        self._nearest = np.inf

    @property
    def minimum_m(self) -> float:
        """The least clearance so far [m]."""
        return float(self._nearest - self._radius)

    def update(self, proxy: Array) -> None:
        """Take in the proxies of a block, (n, 3) [m]."""
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
        found = on_triangles(x[near], self._corners[k[near]]) - x[near]
        self._nearest = float(np.linalg.norm(found, axis=1).min(initial=self._nearest))


class Clearance:
    """Keep the minimum of |p_i - proxy| - R over all points and ticks [m].

    Points lie in cells a little wider than R, sorted by cell; a block's ticks are grouped by cell,
    and each group is compared with its own and the neighbouring cells. A tick with nothing there is
    farther than one cell from the cloud; it is measured in full only while no nearer tick is known.

    fixture: its forbidden points, radii and ignored axis
    """

    def __init__(self, fixture: Fixture) -> None:
        self._radius = fixture.contact_radius + fixture.point_radius
        self._axis = fixture.ignore_axis
        # A little wider than R: a proxy in contact then is near, and far ticks need no look.
        self._cell = 1.1 * self._radius
        points = flattened(fixture.forbidden, self._axis)
        self._corner = points.min(axis=0)
        self._shape = ((points.max(axis=0) - self._corner) // self._cell).astype(np.int64) + 1
        keys = self._keys(self._cells(points))
        order = np.argsort(keys, kind="stable")
        self._points = points[order]
        self._sorted = keys[order]
        self._starts = np.append(np.flatnonzero(np.diff(self._sorted, prepend=-1)), len(points))
        occupied = self._cells(self._points[self._starts[:-1]])
        self._centres = self._corner + (occupied + 0.5) * self._cell
        self._half = 0.5 * np.sqrt(3.0) * self._cell
        self._nearest = np.inf

    @property
    def minimum_m(self) -> float:
        """The least clearance so far [m]; below 0 the proxy's ball overlaps a point's."""
        return float(self._nearest - self._radius)

    def update(self, proxy: Array) -> None:
        """Take in the proxies of a block, (n, 3) [m]."""
        places = flattened(proxy, self._axis)
        cells = self._cells(places)
        near = ((cells >= -1) & (cells <= self._shape)).all(axis=1)
        if near.any():
            self._update_near(places[near], cells[near])
        if self._nearest > self._cell:
            self._update_far(places)

    def _update_near(self, places: Array, cells: NDArray[np.int64]) -> None:
        # Clipping keeps the outermost ring of cells outside the cloud apart from its own.
        _, group = np.unique(self._keys(cells + 1, pad=2), return_inverse=True)
        order = np.argsort(group, kind="stable")
        cuts = np.flatnonzero(np.diff(group[order])) + 1
        for members in np.split(order, cuts):
            candidates = self._around(cells[members[0]])
            if len(candidates):
                self._take(places[members], candidates)

    def _around(self, cell: NDArray[np.int64]) -> Array:
        low = np.maximum(cell - 1, 0)
        high = np.minimum(cell + 1, self._shape - 1)
        x, y = (np.arange(low[i], high[i] + 1) for i in range(2))
        _, ny, nz = self._shape
        rows = ((x[:, None] * ny + y) * nz).ravel()  # cells along z lie side by side
        first = np.searchsorted(self._sorted, rows + low[2], "left")
        last = np.searchsorted(self._sorted, rows + high[2], "right")
        spans = [self._points[a:b] for a, b in zip(first, last, strict=True) if b > a]
        return np.concatenate(spans) if spans else np.empty((0, 3))

    def _take(self, places: Array, candidates: Array) -> None:
        rows = max(1, _PAIRS // len(candidates))
        for start in range(0, len(places), rows):
            part = places[start : start + rows]
            squares = np.zeros((len(part), len(candidates)))
            for i in range(3):
                squares += (part[:, i, None] - candidates[None, :, i]) ** 2
            self._nearest = min(self._nearest, float(np.sqrt(squares.min())))

    def _update_far(self, places: Array) -> None:
        # A cell's points are within half its diagonal of its centre, and no distance changes by
        # more than the proxy moves: most cells, and mostly all of them, need no look.
        for start in range(0, len(places), _STRIDE):
            part = places[start : start + _STRIDE]
            reach = np.linalg.norm(part - part[0], axis=1).max()
            away = np.linalg.norm(self._centres - part[0], axis=1)
            if away.min() - self._half - reach >= self._nearest:
                continue
            chosen = np.flatnonzero(away - 2 * (self._half + reach) <= away.min())
            spans = [self._points[self._starts[c] : self._starts[c + 1]] for c in chosen]
            self._take(part, np.concatenate(spans))

    def _cells(self, places: Array) -> NDArray[np.int64]:
        # Clipped so that a HIP kilometres away stays an integer; such cells are never near.
        scaled = np.floor((places - self._corner) / self._cell)
        return np.clip(scaled, -2, self._shape + 1).astype(np.int64)

    def _keys(self, cells: NDArray[np.int64], pad: int = 0) -> NDArray[np.int64]:
        _, ny, nz = self._shape + pad
        return (cells[:, 0] * ny + cells[:, 1]) * nz + cells[:, 2]
