"""A measured curve as lines and arcs: tangent-continuous but at its corners, within a tolerance.

Each smooth run is laid out with pairs of arcs that meet with one tangent (Bolton, "Biarc curves",
1975), each pair as long as the tolerance allows.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError

DENSE = 8  # places looked at between two measured points
# A corner turns more than a smooth bend does: more than twice as much as the points beside it, and
# more than noise does: the largest of 10^4 normal deviates is 5.8 times the median of their sizes.
ISOLATED, OUTSTANDING = 2.0, 6.0
TOGETHER = 128  # positions looked at together
STRAIGHT = 1e-12  # a bulge below it is a rounding

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Arcs:
    """A stroke as lines and arcs."""

    vertices: Vector  # (K, 2), in the unit of the points
    # (K,) tan(sweep / 4) of the piece from each vertex on; 0 at the last one of an open stroke
    bulges: Vector
    closed: bool  # whether the last piece leads back to the first vertex
    error: float  # how far what they were fitted to lies from them at most, in the same unit

    def distance(self, x: Vector) -> Vector:
        """(T,) distance of the positions x (T, 2) from the pieces; neighbours lie near in x."""
        count = max(1, len(self.vertices) - (not self.closed))  # a dot is a line of no length
        a, b = self.vertices[:count], np.roll(self.vertices, -1, axis=0)[:count]
        middle, half = (a + b) / 2, np.hypot(*(b - a).T) / 2  # of a ball around each piece
        least = np.full(len(x), np.inf)
        for first in range(0, len(x), TOGETHER):
            part = x[first : first + TOGETHER]
            reach = np.hypot(*(part - part[0]).T).max()
            away = np.hypot(*(middle - part[0]).T)
            for i in np.flatnonzero(away - half - 2 * reach <= (away + half).min()):
                off = _distance(a[i], b[i], float(self.bulges[i]), part)
                least[first : first + TOGETHER] = np.minimum(least[first : first + TOGETHER], off)
        return least


def fit_arcs(points: Vector, closed: bool, tolerance: float) -> Arcs:
    """Lines and arcs through a measured curve.

    points: (M, 2) in order, M of 2 or more; a cubic spline runs through them from corner to corner
    closed: whether the last point joins the first
    tolerance: how far the spline may lie from the pieces, in the unit of the points. A bend too
        tight for it between two places looked at may lie further off.
    Raises `CurveError` where two neighbours coincide: no direction leads from one to the other.
    """
    twice = (points == np.roll(points, -1, axis=0)).all(axis=1)
    if twice[: len(points) - (not closed)].any():
        raise CurveError(
            f"point {int(np.argmax(twice))} of {len(points)} lies where the next one does; lines "
            "and arcs want neighbours apart"
        )
    runs = [_run(*run, tolerance) for run in _smooth_runs(points, closed, tolerance)]
    vertices = np.vstack([*(run[0][:-1] for run in runs), runs[-1][0][-1:]])
    bulges, error = np.concatenate([run[1] for run in runs]), max(run[2] for run in runs)
    if closed:
        return Arcs(vertices[:-1], bulges, True, error)
    return Arcs(vertices, np.append(bulges, 0.0), False, error)


def _smooth_runs(points: Vector, closed: bool, tolerance: float) -> list[tuple[Vector, Vector]]:
    """Places and tangents from corner to corner; a closed curve begins at one, if it has any."""
    corners = find_corners(points, closed, tolerance)
    ring = np.vstack([points, points[:1]]) if closed else points
    if closed and len(corners):
        ring = np.vstack([np.roll(points, -corners[0], axis=0), points[corners[0]]])
        corners = corners - corners[0]
    smooth = closed and len(corners) == 0
    cuts = np.unique([0, *corners, len(ring) - 1])
    return [_dense(ring[first : last + 1], smooth) for first, last in pairwise(cuts)]


def _dense(points: Vector, periodic: bool) -> tuple[Vector, Vector]:
    """Places (D, 2) on the cubic spline through points, `DENSE` a step, and unit tangents there."""
    from scipy.interpolate import CubicSpline

    kind = "periodic" if periodic and len(points) > 3 else "not-a-knot"
    spline = CubicSpline(np.arange(len(points)), points, bc_type=kind)
    t = np.linspace(0, len(points) - 1, DENSE * (len(points) - 1) + 1)
    way = spline(t, 1)
    return spline(t), way / np.linalg.norm(way, axis=1)[:, None]


def find_corners(points: Vector, closed: bool, tolerance: float) -> NDArray[np.intp]:
    """Indices of points that no smooth curve within the tolerance turns at.

    An arc that rounds off a point's turn θ half-way to its neighbours, h away, leaves it by
    h/2 tan(θ/4). Where that is more than the tolerance, and the turn neither shared with the points
    beside it as in a bend nor of the size of the others' noise, it is a corner.
    """
    if len(points) < 3:
        return np.zeros(0, np.intp)
    steps = np.diff(np.vstack([points[-1:], points, points[:1]]) if closed else points, axis=0)
    length = np.linalg.norm(steps, axis=1)
    cross = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
    turn = np.abs(np.arctan2(cross, (steps[:-1] * steps[1:]).sum(axis=1)))
    off = np.minimum(length[:-1], length[1:]) / 2 * np.tan(turn / 4)
    beside = np.pad(turn, 1, mode="wrap" if closed else "constant")
    alone = turn > ISOLATED * np.maximum(beside[:-2], beside[2:])
    alone &= turn > OUTSTANDING * np.median(turn)
    return np.flatnonzero((off > tolerance) & alone) + (not closed)


def plane(axis: Vector) -> Vector:
    """(2, 3) two unit vectors, so that the second is left of the first seen against the axis."""
    first = np.eye(3)[np.argmin(np.abs(axis))]
    first = first - axis * (first @ axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)])


def _run(places: Vector, tangents: Vector, tolerance: float) -> tuple[Vector, Vector, float]:
    """Vertices (K + 1, 2) and bulges (K,) along the places of one smooth run, and their error."""
    vertices, bulges, error = [places[0]], [], 0.0
    first, last, step = 0, len(places) - 1, DENSE

    def pair(end: int) -> tuple[Vector, float, float]:
        return _biarc(places[first], tangents[first], places[end], tangents[end])

    def off(end: int) -> float:
        joint, one, two = pair(end)
        if max(abs(one), abs(two)) > 1:
            return np.inf
        x = places[first + 1 : end]
        near = _distance(places[first], joint, one, x), _distance(joint, places[end], two, x)
        return float(np.minimum(*near).max())

    while first < last:
        low, high, least = first + 1, last + 1, 0.0  # holds, does not; how far off the first is
        end = min(first + max(step, 2), last)  # twice as far each time, then halved
        while high - low > 1:
            away = off(end)
            low, high, least = (end, high, away) if away <= tolerance else (low, end, least)
            end = (low + high) // 2 if high <= last else min(2 * low - first, last)
        joint, one, two = pair(low)
        vertices += [joint, places[low]]
        bulges += [one, two]
        first, step, error = low, low - first, max(error, least)
    return np.array(vertices), np.clip(bulges, -1, 1), error


def _biarc(p: Vector, t: Vector, q: Vector, s: Vector) -> tuple[Vector, float, float]:
    """Joint and bulges of two arcs from p with tangent t to q with tangent s.

    Of equal tangent lengths d: |q - d s - p - d t| = 2 d.
    """
    chord, sum_ = q - p, t + s
    a, b, c = 2 * (1 - t @ s), chord @ sum_, chord @ chord
    d = c / (b + np.sqrt(max(b * b + a * c, 0.0)) + 1e-300)
    joint = (p + q + d * (t - s)) / 2
    return joint, _bulge(t, joint - p), -_bulge(-s, joint - q)


def _bulge(tangent: Vector, chord: Vector) -> float:
    """Of the arc that leaves along the tangent and ends at the chord's."""
    half = np.arctan2(tangent[0] * chord[1] - tangent[1] * chord[0], tangent @ chord)
    bulge = float(np.tan(np.clip(half, -3.1, 3.1) / 2))
    return bulge if abs(bulge) > STRAIGHT else 0.0


def _distance(a: Vector, b: Vector, bulge: float, x: Vector) -> Vector:
    """(T,) distance of x (T, 2) from a line or an arc of a half circle at most.

    With w = x - a: G = κ |w|²/2 - n·w and |grad G| = 1 + κ d, so d = 2 G / (1 + |grad G|).
    """
    chord, w = b - a, x - a
    length = float(np.hypot(*chord))
    ends = np.minimum(np.hypot(*w.T), np.hypot(*(x - b).T))
    if length == 0:
        return ends
    along = chord / length
    across = np.array([-along[1], along[0]])
    cos, sin = (1 - bulge**2) / (1 + bulge**2), 2 * bulge / (1 + bulge**2)
    kappa, normal = 2 * sin / length, cos * across + sin * along
    begins, arrives = cos * along - sin * across, cos * along + sin * across
    level = kappa * (w * w).sum(axis=1) / 2 - w @ normal
    off = 2 * np.abs(level) / (1 + np.hypot(*(kappa * w - normal).T))
    beside = (w @ begins >= 0) & ((x - b) @ arrives <= 0)
    return np.where(beside, off, ends)
