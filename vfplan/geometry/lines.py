"""Lines of points: lengths, normals, even steps, runs, and cubic splines.

The splines are our own, because importing scipy.interpolate takes a third of the time of a plan.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def ring_of(points: NDArray, closed: bool) -> Array:
    """The points of a line; those of a closed one end with the first again."""
    return np.vstack([points, points[:1]]) if closed else np.asarray(points, float)


def step_lengths(points: NDArray) -> Array:
    """(M - 1,) the distances of neighbouring points."""
    steps = np.diff(points, axis=0)
    return np.hypot(*steps.T) if steps.shape[1] == 2 else np.linalg.norm(steps, axis=1)


def arc_lengths(points: NDArray, closed: bool) -> Array:
    """(M,) the length of the line up to each point; of a closed one (M + 1,), back to the first."""
    return np.concatenate([[0.0], np.cumsum(step_lengths(ring_of(points, closed)))])


def length_of(points: NDArray, closed: bool) -> float:
    """The length of the line, of a closed one back to the first point."""
    return float(step_lengths(ring_of(points, closed)).sum())


def evenly(points: NDArray, closed: bool) -> Array:
    """The line at equal steps of about one unit; its ends stay where they are."""
    ring = ring_of(points, closed)
    arc = arc_lengths(points, closed)
    count = max(4, round(arc[-1]))
    at = np.linspace(0.0, arc[-1], count + 1)
    even = np.column_stack([np.interp(at, arc, column) for column in ring.T])
    return even[:-1] if closed else even


def normals(points: NDArray, closed: bool) -> Array:
    """(M, 2) unit normals of a line in the plane."""
    if closed:
        step = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    else:
        step = np.gradient(points, axis=0)
    step = step / np.maximum(np.hypot(*step.T), 1e-9)[:, None]
    return np.column_stack([-step[:, 1], step[:, 0]])


def values_at(values: NDArray, parameter: NDArray) -> Array:
    """Values (M,) or (M, K) of a line's points at float indices (N,) of these points.

    Between the last point of a closed line (index M - 1) and M lies the step back to the first.
    """
    ring = np.concatenate([values, values[:1]])
    below = np.minimum(parameter.astype(int), len(values) - 1)
    part = (parameter - below).reshape(-1, *[1] * (values.ndim - 1))
    return ring[below] * (1 - part) + ring[below + 1] * part


BLOCK = 32
"""Rows of a banded system that are solved at once: few enough for arithmetic to cost no more than
NumPy's call does."""

RING_REACH = 40
"""Points of a ring that are repeated beyond its seam. A point's effect on a spline falls to a
quarter from each point to the next, so none is left after 40."""


@dataclass(frozen=True, eq=False)
class Spline:
    """A piecewise cubic curve in K dimensions.

    Parameters
    ----------
    knots
        (N,) in ascending order; beyond them the outermost pieces go on.
    values, bends
        (N, K) at the knots: places, and second derivatives.
    """

    knots: Array
    values: Array
    bends: Array

    def __call__(self, at: NDArray, derivative: int = 0) -> Array:
        """(M, K) places at parameters (M,), or their first or second derivatives."""
        piece = np.searchsorted(self.knots, at, side="right") - 1
        piece = np.clip(piece, 0, len(self.knots) - 2)
        before, after = self.knots[piece, None], self.knots[piece + 1, None]
        step = after - before
        to_after, to_before = after - at[:, None], at[:, None] - before
        bend, next_bend = self.bends[piece], self.bends[piece + 1]
        if derivative == 2:
            return (bend * to_after + next_bend * to_before) / step
        start = self.values[piece] / step - bend * step / 6
        stop = self.values[piece + 1] / step - next_bend * step / 6
        if derivative == 1:
            bent = (next_bend * to_before**2 - bend * to_after**2) / (2 * step)
            return bent + stop - start
        bent = (bend * to_after**3 + next_bend * to_before**3) / (6 * step)
        return bent + start * to_after + stop * to_before


def spline_through(points: Array, periodic: bool = False) -> Spline:
    """The spline through (N, K) points over their index.

    The third derivative is the same on both sides of the last point but one of each end; of a
    periodic curve, whose last point is its first, everything is the same on both sides of the seam.
    """
    count = len(points)
    if periodic:
        ring = np.pad(points[:-1], [(RING_REACH, RING_REACH + 1), (0, 0)], "wrap")
        inner = slice(RING_REACH, RING_REACH + count)
        return Spline(np.arange(count, dtype=float), points, spline_through(ring).bends[inner])
    bends = np.zeros_like(points)
    second = 6 * np.diff(points, 2, axis=0)
    if count == 3:
        bends[:] = second / 6
    elif count > 3:
        band = np.zeros((count, 5))
        band[1:-1, 1:4] = 1, 4, 1
        band[0, 2:] = 1, -2, 1
        band[-1, :3] = 1, -2, 1
        bends = solve_banded(band, np.pad(second, [(1, 1), (0, 0)]))
    return Spline(np.arange(count, dtype=float), points, bends)


def smoothing_spline(knots: NDArray, points: Array, weight: Array, smoothing: float) -> Spline:
    """The spline that bends least and keeps close to (N, K) points.

    It makes Σ weight |spline − point|² + smoothing ∫ |spline″|² as small as can be. C. H. Reinsch,
    "Smoothing by spline functions", Numer. Math. 10 (1967), whose names for R and Q are kept.
    """
    step = np.diff(knots)
    # A second difference, Q' y, takes a point with these three factors, from the one before it.
    before, after = 1 / step[:-1], 1 / step[1:]
    middle = -before - after
    variance = smoothing / weight
    # The diagonals of R + Q' variance Q, which is symmetric.
    band = np.zeros((len(middle), 5))
    band[:, 2] = (step[:-1] + step[1:]) / 3 + middle**2 * variance[1:-1]
    band[:, 2] += before**2 * variance[:-2] + after**2 * variance[2:]
    band[:-1, 3] = step[1:-1] / 6 + middle[:-1] * variance[1:-2] * before[1:]
    band[:-1, 3] += after[:-1] * variance[2:-1] * middle[1:]
    band[:-2, 4] = after[:-2] * variance[2:-2] * before[2:]
    band[1:, 1] = band[:-1, 3]
    band[2:, 0] = band[:-2, 4]
    bends = solve_banded(band, np.diff(np.diff(points, axis=0) / step[:, None], axis=0))
    bends = np.pad(bends, [(1, 1), (0, 0)])
    force = np.diff(np.diff(bends, axis=0) / step[:, None], axis=0, prepend=0, append=0)
    return Spline(np.asarray(knots, float), points - variance[:, None] * force, bends)


def solve_banded(band: Array, right: Array) -> Array:
    """(N, K) x, where the sum of `band[i, k] x[i + k - reach]` over k is `right[i]`.

    Blocks of rows are eliminated one after the other, without a choice of pivots between them.
    """
    count, width = band.shape
    blocks = -(-count // BLOCK)
    # Each row's entries in the block before its own, in its own and in the next.
    rows = np.zeros((blocks * BLOCK, 3 * BLOCK))
    number = np.arange(blocks * BLOCK)
    rows[number[count:], BLOCK + number[count:] % BLOCK] = 1.0
    for k in range(width):
        rows[number[:count], BLOCK + number[:count] % BLOCK + k - width // 2] = band[:, k]
    before, own, after = np.moveaxis(rows.reshape(blocks, BLOCK, 3, BLOCK), 2, 0)
    right = np.pad(right, [(0, blocks * BLOCK - count), (0, 0)]).reshape(blocks, BLOCK, -1)
    carried, solution = np.zeros_like(own), np.zeros_like(right)
    for k in range(blocks):
        matrix = own[k] - before[k] @ carried[k - 1]
        known = right[k] - before[k] @ solution[k - 1]
        solved = np.linalg.solve(matrix, np.hstack([after[k], known]))
        carried[k], solution[k] = solved[:, :BLOCK], solved[:, BLOCK:]
    for k in range(blocks - 2, -1, -1):
        solution[k] -= carried[k] @ solution[k + 1]
    return solution.reshape(blocks * BLOCK, -1)[:count]


def runs(flags: Flags, closed: bool) -> Iterator[NDArray[np.int64]]:
    """Indices of each run of flags; on a ring a run may lead through the seam."""
    if not flags.any():
        return
    shift = int(np.argmin(flags)) if closed else 0
    rolled = np.roll(flags, -shift)
    edges = np.flatnonzero(np.diff(np.r_[False, rolled, False].astype(int))).reshape(-1, 2)
    for start, stop in edges:
        yield (np.arange(start, stop) + shift) % len(flags)


def plane_normal(axes: Array) -> Array:
    """(3,) perpendicular to the first two columns of `axes` (3, k), as long as their area."""
    return np.cross(axes[:, 0], axes[:, 1])
