"""How far the points of a cloud stand apart, whatever its scale; NumPy only.

The engine's default band follows from it, so it must be cheap (a sample of the points, one pass
over the cloud) and robust (duplicates, stray points and separate objects do not count).
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

SAMPLE = 2048  # points whose nearest neighbour is looked up; the quantile needs no more
QUANTILE = 0.95  # of the nearest-neighbour distances
SAME = 1e-6  # points nearer than this share of `reach` count as one

_SEEDS, _THINNED = 8, 32768  # so many points against so many, to choose the first cell size
_OFFSETS = np.array(list(product((-1, 0, 1), repeat=3)))
_HASH = np.array([73856093, 19349663, 83492791], dtype=np.int64)


def cloud_spacing(points: NDArray[np.float64], reach: float) -> float | None:
    """Spacing of a cloud: the 95 % quantile of the distances to the nearest other point.

    Parameters
    ----------
    points
        (N, 3) finite positions [m].
    reach
        Points further apart than this [m] are separate objects and say nothing about spacing.

    Returns
    -------
    float or None
        Spacing [m]; `None` when no two points stand within `reach`.
    """
    nearest = nearest_distances(points, reach)
    nearest = nearest[np.isfinite(nearest)]
    return float(np.quantile(nearest, QUANTILE)) if nearest.size else None


def nearest_distances(points: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    """Distance [m] of evenly picked points to their nearest other point, inf beyond `reach`.

    Parameters
    ----------
    points
        (N, 3) finite positions [m].
    reach
        Search radius [m].

    Returns
    -------
    (min(N, 2048),) float64
    """
    queries = points[_even_indices(len(points), SAMPLE)]
    nearest = np.full(len(queries), np.inf)
    cell = _first_cell(points, queries, reach)
    while True:
        open_ = ~(nearest <= cell)
        nearest[open_] = _nearest_in_cells(points, queries[open_], cell, SAME * reach)
        # What lies further than a cell may have a nearer neighbour outside the 27 cells.
        nearest[nearest > cell] = np.inf
        if cell >= reach or np.all(nearest <= cell):
            return nearest
        cell = min(2 * cell, reach)


def _even_indices(n: int, count: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(0, n - 1, min(n, count)).astype(np.int64))


def _first_cell(points, queries, reach: float) -> float:
    """A cell that holds a handful of points: the worst spacing among a few of them.

    A thinned cloud answers for a large one, its distances shrunk as those of a surface are.
    """
    thinned = points[_even_indices(len(points), _THINNED)]
    worst = 0.0
    for query in queries[_even_indices(len(queries), _SEEDS)]:
        distance = np.sqrt(((thinned - query) ** 2).sum(axis=1))
        other = distance[distance > SAME * reach]
        worst = max(worst, float(other.min()) if other.size else reach)
    return min(1.5 * worst * np.sqrt(len(thinned) / len(points)), reach)


def _nearest_in_cells(points, queries, cell: float, same: float) -> NDArray[np.float64]:
    """Distance of each query to the nearest point of its own and the 26 cells around it.

    Cells are hashed to one integer; two cells of one hash only add candidates.
    """
    corner = points.min(axis=0)
    keys = _keys(np.floor((points - corner) / cell).astype(np.int64))
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    nearest = np.full(len(queries), np.inf)
    home = np.floor((queries - corner) / cell).astype(np.int64)
    for offset in _OFFSETS:
        wanted = _keys(home + offset)
        first, last = np.searchsorted(keys, wanted), np.searchsorted(keys, wanted, side="right")
        counts = last - first
        row = np.repeat(np.arange(len(queries)), counts)
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        candidates = points[order[np.repeat(first, counts) + within]]
        distance = np.sqrt(((candidates - queries[row]) ** 2).sum(axis=1))
        distance[distance <= same] = np.inf
        np.minimum.at(nearest, row, distance)
    return nearest


def _keys(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    with np.errstate(over="ignore"):
        return (cells * _HASH).sum(axis=1)
