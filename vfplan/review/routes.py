"""The routes that a curve may take over a piece of ink: from each free end to each other one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.centreline import drawn_length
from vfplan.fixture import Stroke

MAX_ROUTES = 9
"""Routes that are offered at most: one digit chooses among them."""

MAX_FREE_ENDS = 12
"""Free ends of a forked line beyond which it is writing, through which no route is offered."""


def route_along(pixels: NDArray, closed: bool) -> Stroke:
    """A route that a curve may take over the ink, along skeleton pixels (u, v) in order."""
    return Stroke(pixels, closed, known_length=drawn_length(pixels, closed))


def routes_through(
    mask: NDArray[np.bool_], corner: tuple[int, int] = (0, 0)
) -> tuple[list[Stroke], list[tuple[float, float]]]:
    """The routes through one connected piece of ink, the longest first, and where it forks.

    A line has one route, from end to end, or around. A forked line has one for each pair of its
    free ends. `corner` is where (0, 0) of the mask lies on the slice.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra
    from skimage.morphology import skeletonize

    # The skeleton's pixels are the nodes of a graph, with an edge between neighbours.
    bone = skeletonize(np.pad(mask, 1), method="lee") > 0
    rows, columns = np.nonzero(bone)
    if len(rows) < 2:
        return [], []
    number = np.full(bone.shape, -1)
    number[rows, columns] = np.arange(len(rows))
    pairs = []
    lengths = []
    for dv, du in ((0, 1), (1, 0), (1, 1), (1, -1)):
        neighbour = number[rows + dv, columns + du]
        keep = neighbour >= 0
        if dv and du:
            # The corner of a staircase is no fork.
            keep &= (number[rows + dv, columns] < 0) & (number[rows, columns + du] < 0)
        pairs.append(np.column_stack([np.flatnonzero(keep), neighbour[keep]]))
        lengths.append(np.full(keep.sum(), np.hypot(dv, du)))
    edges = np.concatenate(pairs)
    count = len(rows)
    degree = np.bincount(edges.ravel(), minlength=count)
    graph = coo_matrix((np.concatenate(lengths), edges.T), shape=(count, count)).tocsr()
    pixels = np.column_stack([columns, rows]) - 1.0 + np.array(corner, float)
    forks = [tuple(place) for place in pixels[degree > 2].tolist()]
    ends = np.flatnonzero(degree == 1)
    if len(ends) == 0:
        return _around(graph, pixels, edges), forks
    if len(ends) > MAX_FREE_ENDS:
        return [], forks

    # The shortest path from each end to each other one.
    distance, before = dijkstra(graph, directed=False, indices=ends, return_predecessors=True)
    routes = []
    for i, start in enumerate(ends):
        for stop in ends[i + 1 :]:
            if np.isfinite(distance[i, stop]):
                routes.append(route_along(pixels[_walked_back(before[i], start, stop)], False))
    routes.sort(key=lambda route: -route.length)
    return routes[:MAX_ROUTES], forks


def _around(graph: Any, pixels: NDArray, edges: NDArray) -> list[Stroke]:
    """The one route around a ring: cut beside a pixel, and walked the other way round."""
    from scipy.sparse.csgraph import dijkstra

    cut = graph.tolil()
    start, stop = edges[0]
    cut[start, stop] = 0
    cut[stop, start] = 0
    cut = cut.tocsr()
    cut.eliminate_zeros()
    distance, before = dijkstra(cut, directed=False, indices=start, return_predecessors=True)
    if not np.isfinite(distance[stop]):
        return []
    return [route_along(pixels[_walked_back(before, start, stop)], True)]


def _walked_back(before: NDArray, start: int, stop: int) -> list[int]:
    """The pixels from `start` to `stop`, by each pixel's predecessor."""
    path = [stop]
    while path[-1] != start:
        path.append(before[path[-1]])
    return path[::-1]
