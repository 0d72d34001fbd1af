"""Lines of points: lengths, normals, even steps, runs, filters, cubic splines, lines and arcs.

The filters and the splines are our own, because importing SciPy takes a third of the time of a
plan. The filters run along the first axis of an array, and equal scipy.ndimage's to the bit.
Lines and arcs are laid along a measured curve, tangent-continuous but at its corners and within a
tolerance: each smooth run by pairs of arcs that meet with one tangent (Bolton, "Biarc curves",
1975), each pair as long as the tolerance allows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from vfplan import _core
from vfplan.errors import CurveError

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]

# How values go on beyond the ends of a line, as `np.pad` names it, by whether the line is closed.
BEYOND = {False: "edge", True: "wrap"}


def flattened(places: Array, axis: Array | None) -> Array:
    """(n, 3) places without their part along an ignored axis (a unit vector, or `None`)."""
    return places if axis is None else places - np.outer(places @ axis, axis)


def ring_of(points: NDArray, closed: bool) -> Array:
    """The points of a line; those of a closed one end with the first again."""
    return np.vstack([points, points[:1]]) if closed else np.asarray(points, float)


def in_space(flat: NDArray) -> Array:
    """(K, 3) places (K, 2) in the plane z = 0."""
    return np.pad(np.asarray(flat, float), ((0, 0), (0, 1)))


def homogeneous(places: Array) -> Array:
    """[x, 1] along the last axis."""
    return np.concatenate([places, np.ones((*places.shape[:-1], 1))], axis=-1)


def rms_length(vectors: Array) -> float:
    """RMS length of vectors (N, k)."""
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


def row_lengths(vectors: NDArray) -> Array:
    """(N,) the length of each of vectors (N, k)."""
    return np.linalg.norm(vectors, axis=1)


def step_lengths(points: NDArray) -> Array:
    """(M - 1,) the distances of neighbouring points."""
    steps = np.diff(points, axis=0)
    return np.hypot(*steps.T) if steps.shape[1] == 2 else row_lengths(steps)


def arc_lengths(points: NDArray, closed: bool) -> Array:
    """(M,) the length of the line up to each point; of a closed one (M + 1,), back to the first."""
    return np.append(0.0, np.cumsum(step_lengths(ring_of(points, closed))))


def length_of(points: NDArray, closed: bool) -> float:
    """The length of the line, of a closed one back to the first point."""
    return float(step_lengths(ring_of(points, closed)).sum())


def interpolated(wanted: NDArray, at: NDArray, places: NDArray) -> Array:
    """(n, D) places at the wanted parameters (n,), on straight lines between places (m, D)."""
    return np.column_stack([np.interp(wanted, at, column) for column in places.T])


def nearest_to(place: ArrayLike, points: NDArray) -> int:
    """Which of points (N, 2) is nearest to a place."""
    return int(np.hypot(*(points - np.asarray(place, float)).T).argmin())


def distance_to(place: ArrayLike, points: NDArray) -> float:
    """How far a place is from the nearest of points (N, 2)."""
    return float(np.hypot(*(points - np.asarray(place, float)).T).min())


def on_segments(places: Array, start: Array, end: Array) -> Array:
    """(M, d) nearest place of each straight line from `start` to `end` (M, d) to its place."""
    along = end - start
    square = np.maximum((along**2).sum(axis=1), np.finfo(float).tiny)
    share = np.clip(((places - start) * along).sum(axis=1) / square, 0.0, 1.0)
    return start + share[:, None] * along


def evenly(points: NDArray, closed: bool, step: float = 1.0) -> Array:
    """The line at equal steps of about this length; its ends stay where they are."""
    ring = ring_of(points, closed)
    arc = arc_lengths(points, closed)
    count = max(4, round(arc[-1] / step))
    even = interpolated(np.linspace(0.0, arc[-1], count + 1), arc, ring)
    return even[:-1] if closed else even


def normals(points: NDArray, closed: bool) -> Array:
    """(M, 2) unit normals of a line in the plane."""
    around = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    step = around if closed else np.gradient(points, axis=0)
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


def gaussian(values: Array, sigma: float, mode: str = "symmetric") -> Array:
    """Values (N, ...) smoothed by a Gaussian that ends at four times `sigma`.

    `mode` says how `np.pad` carries the values on beyond both ends.
    """
    reach = int(4 * sigma + 0.5)
    weight = np.exp(-0.5 / sigma**2 * np.arange(-reach, reach + 1) ** 2)
    weight /= weight.sum()
    padded = np.pad(values, [(reach, reach)] + [(0, 0)] * (values.ndim - 1), mode)
    count = len(values)
    smooth = weight[reach] * values
    for k in range(reach):
        smooth = smooth + weight[k] * (padded[k : k + count] + padded[2 * reach - k :][:count])
    return smooth


def windows(values: NDArray, size: int, mode: str = "symmetric", **beyond: Any) -> NDArray:
    """(N, size) what lies around each of values (N,); `np.pad` carries them on beyond both ends."""
    before = size // 2
    return sliding_window_view(np.pad(values, (before, size - 1 - before), mode, **beyond), size)


def running_median(values: Array, size: int, mode: str = "symmetric", **beyond: Any) -> Array:
    """(N,) the median of `windows`; of an even size, the upper one of the two in the middle."""
    return np.partition(windows(values, size, mode, **beyond), size // 2, axis=1)[:, size // 2]


# Rows of a banded system that are solved at once: few enough for arithmetic to cost no more than
# NumPy's call does.
BLOCK = 32

# Points of a ring that are repeated beyond its seam. A point's effect on a spline falls to a
# quarter from each point to the next, so none is left after 40.
RING_REACH = 40


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
        piece = np.clip(np.searchsorted(self.knots, at, side="right") - 1, 0, len(self.knots) - 2)
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
    before, diagonal, after = np.moveaxis(rows.reshape(blocks, BLOCK, 3, BLOCK), 2, 0)
    right = np.pad(right, [(0, blocks * BLOCK - count), (0, 0)]).reshape(blocks, BLOCK, -1)
    carried, solution = np.zeros_like(diagonal), np.zeros_like(right)
    for k in range(blocks):
        matrix = diagonal[k] - before[k] @ carried[k - 1]
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


def unit_normal(axes: Array) -> Array:
    """The same, of length 1."""
    normal = plane_normal(axes)
    return normal / np.linalg.norm(normal)


# Number of places on the spline, from one measured point to the next, where its error is taken.
PLACES_A_STEP = 8
# Smallest turn of a corner over that of its neighbours. A smooth bend is shared with them.
ISOLATED = 2.0
# Smallest turn of a corner over the median turn. Of 10^4 normal deviates the largest is 5.8.
OUTSTANDING = 6.0


@dataclass(frozen=True, eq=False)
class Arcs:
    """A stroke as lines and arcs.

    Parameters
    ----------
    vertices
        (K, 2), in the unit of the points.
    bulges
        (K,) tan(sweep / 4) of the piece from each vertex on; 0 at the last one of an open stroke.
    closed
        Whether the last piece leads back to the first vertex.
    error
        The largest distance of what they were fitted to from them, in the same unit.
    """

    vertices: Array
    bulges: Array
    closed: bool
    error: float

    def distance(self, x: Array) -> Array:
        """(T,) distance of the positions x (T, 2) from the pieces."""
        vertices, places = np.insert(self.vertices, 2, 0, 1), np.insert(x, 2, 0, 1)
        stroke, closed = np.zeros_like(self.bulges, np.int32), np.uint8([self.closed])
        settings = _core.Parameters(stiffness=np.ones(3), ignore_axis=np.eye(3)[2])
        return _core.Engine(vertices, self.bulges, stroke, closed, settings).distance(places)


def fit_arcs(points: Array, closed: bool, tolerance: float) -> Arcs:
    """Lines and arcs through a measured curve.

    Parameters
    ----------
    points
        (M, 2) in order, M of 2 or more; a cubic spline runs through them from corner to corner.
    closed
        Whether the last point joins the first.
    tolerance
        How far the spline may lie from the pieces, in the unit of the points. A bend too tight
        for it between two places looked at may lie further away.

    Raises
    ------
    CurveError
        Two neighbours coincide, so that no direction leads from one to the other.
    """
    coincide = (points == np.roll(points, -1, axis=0)).all(axis=1)
    if not closed:
        coincide[-1] = False
    if coincide.any():
        index = int(np.argmax(coincide))
        raise CurveError(
            f"Point {index} of {len(points)} lies where the next one does. Leave one of them out.",
            code="points-coincide", numbers={"index": index, "points": len(points)},
        )  # fmt: skip
    corners = find_corners(points, closed, tolerance)
    periodic = closed and len(corners) == 0
    if closed:  # It begins at a corner, if it has any.
        first = next(iter(corners), 0)
        points = ring_of(np.roll(points, -first, axis=0), True)
        corners = corners - first
    vertices, bulges, errors = [], [], []
    for start, stop in pairwise(np.unique([0, *corners, len(points) - 1])):
        run = points[start : stop + 1]
        spline = spline_through(run, periodic and len(run) > 3)
        t = np.linspace(0, len(run) - 1, PLACES_A_STEP * (len(run) - 1) + 1)
        velocity = spline(t, 1)
        tangents = velocity / row_lengths(velocity)[:, None]
        arcs = _core.arcs_along(spline(t), tangents, tolerance, PLACES_A_STEP)
        vertices.append(arcs[0][:-1])
        bulges.append(arcs[1])
        errors.append(arcs[2])
    if not closed:
        vertices.append(arcs[0][-1:])
        bulges.append(np.zeros(1))
    return Arcs(np.vstack(vertices), np.concatenate(bulges), closed, max(errors))


def find_corners(points: Array, closed: bool, tolerance: float) -> Indices:
    """Indices of points that no smooth curve within the tolerance turns at.

    An arc that rounds off a point's turn θ half-way to its neighbours, h away, leaves it by
    h/2 tan(θ/4). Where that is more than the tolerance, and the turn is neither shared with the
    neighbours as in a bend nor of the size of the others' noise, it is a corner.
    """
    if len(points) < 3:
        return np.zeros(0, np.intp)
    ring = np.pad(points, [(1, 1), (0, 0)], "wrap") if closed else points
    # As complex numbers, of which a quotient has the turn from one step to the next.
    steps = np.diff(ring, axis=0) @ [1, 1j]
    turn = np.abs(np.angle(steps[1:] * steps[:-1].conj()))
    error = np.minimum(abs(steps[:-1]), abs(steps[1:])) / 2 * np.tan(turn / 4)
    neighbours = np.pad(turn, 1, mode="wrap" if closed else "constant")
    isolated = turn > ISOLATED * np.maximum(neighbours[:-2], neighbours[2:])
    isolated &= turn > OUTSTANDING * np.median(turn)
    corners = np.flatnonzero((error > tolerance) & isolated)
    # The first point of an open curve has no turn.
    return corners if closed else corners + 1


def plane(axis: Array) -> Array:
    """(2, 3) two unit vectors across an axis; seen against it, the second points to the left."""
    first = np.eye(3)[np.argmin(np.abs(axis))]
    first = first - axis * (first @ axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)])
