"""Triangles small enough for a proxy not to pass through them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.bundle.table import table
from vfplan.errors import SceneError, SettingError

Points = NDArray[np.float64]
Triangles = NDArray[np.int32]


def refined(points: Points, triangles: Triangles, spacing: float) -> tuple[Points, Triangles]:
    """The same surface with no edge longer than `spacing` [m] and without unused points.

    Every longer edge is halved, in both triangles it belongs to, until none is left.

    Raises `SceneError` when that takes more points or triangles than a bundle may hold.
    """
    if not (np.isfinite(spacing) and spacing > 0):
        raise SettingError(f"spacing {spacing} m; more than 0 wanted")
    caps = table().sizes
    used, triangles = np.unique(triangles, return_inverse=True)
    points, triangles = points[used], triangles.reshape(-1, 3).astype(np.int64)
    while True:
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
        edges, which = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
        length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
        long = length > spacing
        if not long.any():
            return points, triangles.astype(np.int32)
        middle = np.where(long, len(points) + np.cumsum(long) - 1, -1)
        points = np.vstack([points, points[edges[long]].mean(axis=1)])
        triangles = _split(triangles, middle[which.reshape(-1, 3)], points)
        if len(points) > caps["N"] or len(triangles) > caps["K"]:
            raise SceneError(
                f"spacing {spacing} m takes more than {caps['N']} points or {caps['K']} triangles"
            )


def _split(triangles: NDArray[np.int64], middle: NDArray[np.int64], points: Points) -> Any:
    """Split triangles at the middles (-1: none) of their edges 01, 12, 20."""
    count = (middle >= 0).sum(axis=1)
    # Turn each so that a single split is on edge 01 and two splits are on 01 and 12.
    turn = np.where(count == 1, np.argmax(middle >= 0, axis=1), 0)
    turn = np.where(count == 2, (np.argmax(middle < 0, axis=1) + 1) % 3, turn)
    order = (np.arange(3) + turn[:, None]) % 3
    a, b, c = np.take_along_axis(triangles, order, axis=1).T
    ab, bc, ca = np.take_along_axis(middle, order, axis=1).T
    one, two, three = (count == n for n in (1, 2, 3))
    across = np.linalg.norm(points[a] - points[bc], axis=1)
    other = np.linalg.norm(points[c] - points[ab], axis=1)
    short = two & (across <= other)
    tall = two & ~short
    pieces = [
        (count == 0, (a, b, c)),
        (one, (a, ab, c)), (one, (ab, b, c)),
        (two, (ab, b, bc)),
        (short, (a, ab, bc)), (short, (a, bc, c)),
        (tall, (a, ab, c)), (tall, (ab, bc, c)),
        (three, (a, ab, ca)), (three, (ab, b, bc)), (three, (ca, bc, c)), (three, (ab, bc, ca)),
    ]  # fmt: skip
    return np.concatenate([np.column_stack(corners)[rows] for rows, corners in pieces])
