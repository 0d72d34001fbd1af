"""Sets of markers with planted noise and planted mistakes, from one seed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from drawing import unit
from numpy.typing import NDArray

from vfplan.geometry.lines import Array

SPACING_M = 0.5e-3
LAYOUTS = ("grid", "ring", "random")


@dataclass(frozen=True, eq=False)
class MarkerSet:
    """Markers of a slice whose true place in front of the robot is known."""

    kind: str
    source: Array  # (N, 2) [px]
    target: Array  # (N, 3) as touched [m]
    T: Array  # (3, 3) the true map on [u v 1] [m]
    fle_m: float
    # Whether another order of the labels fits the true positions to within three FLE.
    is_symmetric: bool


def marker_sets(
    count: int, *, model: str = "affine", fle_m: float | None = None, seed: int = 0
) -> Iterator[MarkerSet]:
    """Layouts of 3 to 12 markers (affine: from 4), FLE log-uniform from 0.1 to 1 mm by default."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        n = int(rng.integers(4 if model == "affine" else 3, 13))
        kind = LAYOUTS[k % 3]
        source = _layout(rng, kind, n)
        fle = fle_m if fle_m is not None else float(np.exp(rng.uniform(np.log(1e-4), np.log(1e-3))))
        T = _pose(rng)
        true = np.column_stack([source, np.ones(n)]) @ T.T
        target = true + fle / np.sqrt(3) * rng.normal(size=(n, 3))
        yield MarkerSet(kind, source, target, T, fle, _is_symmetric(source, 3 * fle))


def _layout(rng: np.random.Generator, kind: str, n: int) -> Array:
    """(n, 2) [px], never on a line."""
    while True:
        jitter = rng.normal(0, rng.choice([0.3, 5.0, 20.0]), (n, 2))
        if kind == "grid":
            side = int(np.ceil(np.sqrt(n)))
            row, column = np.divmod(np.arange(n), side)
            source = 150 + 700 / (side - 1) * np.column_stack([column, row]) + jitter
        elif kind == "ring":
            angle = 2 * np.pi * np.arange(n) / n + rng.uniform(0, 2 * np.pi)
            source = 512 + 350 * unit(angle) + jitter
        else:
            source = rng.uniform(60, 960, (n, 2))
        extent = np.linalg.svd(source - source.mean(axis=0), compute_uv=False)
        if extent[1] > extent[0] / 10:
            return source


def _pose(rng: np.random.Generator) -> Array:
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    return np.column_stack([SPACING_M * turn[:, :2], rng.uniform(0.2, 0.6, 3)])


def _is_symmetric(source: Array, within_m: float) -> bool:
    """Whether a turn, a mirror or an exchange takes the layout onto itself.

    By the similarity that fits best, with turns over allowed as a slice may be turned over: the
    markers' distances from each other decide.
    """
    from itertools import combinations

    n = len(source)
    orders = [np.roll(np.arange(n), k) for k in range(1, n)]
    orders += [np.roll(np.arange(n)[::-1], k) for k in range(n)]
    for i, j in combinations(range(n), 2):
        order = np.arange(n)
        order[[i, j]] = j, i
        orders.append(order)
    for rows in range(2, n):
        if n % rows == 0:
            grid = np.arange(n).reshape(rows, -1)
            orders += [grid.T.ravel(), grid[::-1].ravel(), grid[:, ::-1].ravel()]
    centred = SPACING_M * (source - source.mean(axis=0))
    for order in orders:
        if (order == np.arange(n)).all():
            continue
        u, _, vt = np.linalg.svd(centred[order].T @ centred)
        left = centred[order] - centred @ (u @ vt).T
        if np.sqrt((left**2).sum(axis=1).mean()) < within_m:
            return True
    return False


def mistaken_orders(rng: np.random.Generator, n: int) -> dict[str, NDArray[np.intp]]:
    """Orders of n labels as people mistake them."""
    forward = np.arange(n)
    exchanged = forward.copy()
    i, j = rng.permutation(n)[:2]
    exchanged[[i, j]] = j, i
    permuted = rng.permutation(n)
    while (permuted == forward).all():
        permuted = rng.permutation(n)
    return {
        "reversed": forward[::-1],
        "shifted": np.roll(forward, int(rng.integers(1, n))),
        "exchanged": exchanged,
        "permuted": permuted,
    }


def with_outlier(rng: np.random.Generator, target: Array) -> Array:
    """One marker 5 to 100 mm (log-uniform) from where it was touched, in any direction."""
    moved = target.copy()
    direction = rng.normal(size=3)
    size = np.exp(rng.uniform(np.log(5e-3), np.log(0.1)))
    moved[rng.integers(len(moved))] += size * direction / np.linalg.norm(direction)
    return moved
