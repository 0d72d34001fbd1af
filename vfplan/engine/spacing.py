"""How far the points of a cloud stand apart, whatever its scale; NumPy only.

The engine's default band follows from it, so it must be cheap (a sample of the points, one pass
over the cloud) and robust: duplicates, stray points and separate objects do not count, nor does the
distance between two layers of a thin sheet.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

MOST_POINTS = 4_000_000  # in one bundle (schemas/bundle-1.1.json); more are refused unmade
SAMPLE = 512  # points whose neighbours are looked up; the quantile needs no more
QUANTILE = 0.75  # of the spacings at those points: edges of a sheet have fewer neighbours
SAME = 1e-6  # points nearer than this share of `reach` count as one
CURVE = 1.6  # fourth neighbour this much further than the second: a curve, not a surface

_SEEDS, _THINNED = 8, 32768  # so many points against so many, to choose the first cell size
_OFFSETS = np.array(list(product((-1, 0, 1), repeat=3)))
_HASH = np.array([73856093, 19349663, 83492791], dtype=np.int64)


def cloud_spacing(points: NDArray[np.float64], reach: float) -> float | None:
    """Spacing of a cloud [m]; `None` when no two points stand within `reach`.

    On a curve a point has two neighbours at the spacing, on a surface four: the second or fourth
    nearest tells it even where a second layer lies close behind the first. Where a point has fewer
    within `reach`, the furthest that it has.

    Parameters
    ----------
    points
        (N, 3) finite positions [m].
    reach
        Points further apart than this [m] are separate objects and say nothing about spacing.
    """
    d = neighbour_distances(points, reach, 4)
    surface = d[:, 3] < CURVE * d[:, 1]
    spacing = np.where(surface, d[:, 3], np.where(np.isfinite(d[:, 1]), d[:, 1], d[:, 0]))
    spacing = spacing[np.isfinite(spacing)]
    return float(np.quantile(spacing, QUANTILE)) if spacing.size else None


def neighbour_distances(points: NDArray[np.float64], reach: float, k: int) -> NDArray[np.float64]:
    """Distances [m] of evenly picked points to their k nearest others, ascending, inf beyond reach.

    Parameters
    ----------
    points
        (N, 3) finite positions [m].
    reach
        Search radius [m].
    k
        How many neighbours.

    Returns
    -------
    (min(N, 512), k) float64
    """
    queries = points[_even_indices(len(points), SAMPLE)]
    nearest = np.full((len(queries), k), np.inf)
    cell = _first_cell(points, queries, reach, k)
    while True:
        missing = ~np.isfinite(nearest[:, -1])
        found = _nearest_in_cells(points, queries[missing], cell, SAME * reach, k)
        # What lies further than a cell may have a nearer neighbour outside the 27 cells.
        nearest[missing] = np.where(found <= cell, found, np.inf)
        if cell >= reach or np.isfinite(nearest[:, -1]).all():
            return nearest
        cell = min(2 * cell, reach)


def _even_indices(n: int, count: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(0, n - 1, min(n, count)).astype(np.int64))


def _first_cell(points, queries, reach: float, k: int) -> float:
    """A cell that holds a handful of points: the worst spacing among a few of them.

    A thinned cloud answers for a large one, its distances shrunk as those of a surface are.
    """
    thinned = points[_even_indices(len(points), _THINNED)]
    worst = 0.0
    for query in queries[_even_indices(len(queries), _SEEDS)]:
        distance = np.sqrt(((thinned - query) ** 2).sum(axis=1))
        other = np.sort(distance[distance > SAME * reach])[:k]
        worst = max(worst, float(other[-1]) if other.size else reach)
    return min(1.2 * worst * np.sqrt(len(thinned) / len(points)), reach)


def _nearest_in_cells(points, queries, cell: float, same: float, k: int) -> NDArray[np.float64]:
    """Distances of each query to the k nearest points of its own and the 26 cells around it.

    Cells are hashed to one integer; two cells of one hash only add candidates.
    """
    corner = points.min(axis=0)
    keys = _keys(np.floor((points - corner) / cell).astype(np.int64))
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    home = np.floor((queries - corner) / cell).astype(np.int64)
    nearest = np.full((len(queries), k), np.inf)
    for i, cells in enumerate(home[:, None] + _OFFSETS):
        wanted = np.unique(_keys(cells))
        first, last = np.searchsorted(keys, wanted), np.searchsorted(keys, wanted, side="right")
        mine = np.concatenate([order[a:b] for a, b in zip(first, last, strict=True)])
        distance = np.sqrt(((points[mine] - queries[i]) ** 2).sum(axis=1))
        distance = distance[distance > same]
        if distance.size > k:
            distance = np.partition(distance, k - 1)[:k]
        nearest[i, : distance.size] = np.sort(distance)
    return nearest


def _keys(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    with np.errstate(over="ignore"):
        return (cells * _HASH).sum(axis=-1)
