"""A measured curve as lines and arcs: tangent-continuous but at its corners, within a tolerance.

Each smooth run is laid out with pairs of arcs that meet with one tangent (Bolton, "Biarc curves",
1975), each pair as long as the tolerance allows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError
from vfplan.geometry import ROUNDING
from vfplan.geometry.lines import spline_through

PLACES_A_STEP = 8
"""Number of places on the spline, from one measured point to the next, where its error is taken."""
ISOLATED = 2.0
"""Smallest turn of a corner over that of its neighbours. A smooth bend is shared with them."""
OUTSTANDING = 6.0
"""Smallest turn of a corner over the median turn. Of 10^4 normal deviates the largest is 5.8."""
POSITIONS_AT_ONCE = 16 * PLACES_A_STEP
"""Number of positions whose distance is computed together. They lie close to each other."""

Vector = NDArray[np.float64]


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

    vertices: Vector
    bulges: Vector
    closed: bool
    error: float

    def distance(self, x: Vector) -> Vector:
        """(T,) distance of the positions x (T, 2) from the pieces.

        It is fast where positions that follow each other in x lie close together.
        """
        count = len(self.vertices)
        if not self.closed:
            count = max(1, count - 1)  # A dot is a line of no length.
        start = self.vertices[:count]
        stop = np.roll(self.vertices, -1, axis=0)[:count]
        # Each piece lies in a ball around the middle of its chord.
        middle = (start + stop) / 2
        radius = np.hypot(*(stop - start).T) / 2
        nearest = np.full(len(x), np.inf)
        for first in range(0, len(x), POSITIONS_AT_ONCE):
            part = x[first : first + POSITIONS_AT_ONCE]
            reach = np.hypot(*(part - part[0]).T).max()
            to_middle = np.hypot(*(middle - part[0]).T)
            may_be_nearest = to_middle - radius - 2 * reach <= (to_middle + radius).min()
            best = nearest[first : first + POSITIONS_AT_ONCE]
            for i in np.flatnonzero(may_be_nearest):
                distance = _distance(start[i], stop[i], float(self.bulges[i]), part)
                np.minimum(best, distance, out=best)
        return nearest


@dataclass(frozen=True, eq=False)
class SmoothRun:
    """A part of a curve without corners: (D, 2) places on it, and the unit tangents there."""

    places: Vector
    tangents: Vector

    @classmethod
    def through(cls, points: Vector, periodic: bool) -> SmoothRun:
        """The run along the cubic spline through (M, 2) points."""
        spline = spline_through(points, periodic and len(points) > 3)
        t = np.linspace(0, len(points) - 1, PLACES_A_STEP * (len(points) - 1) + 1)
        velocity = spline(t, 1)
        return cls(spline(t), velocity / np.linalg.norm(velocity, axis=1)[:, None])

    def biarc(self, first: int, last: int) -> tuple[Vector, float, float]:
        """Joint and bulges of the two arcs from one of its places to another.

        Of equal tangent lengths d: |q - d s - p - d t| = 2 d, from p with tangent t to q with
        tangent s.
        """
        p, t = self.places[first], self.tangents[first]
        q, s = self.places[last], self.tangents[last]
        chord = q - p
        a = 2 * (1 - float(t @ s))
        b = float(chord @ (t + s))
        c = float(chord @ chord)
        d = c / (b + math.sqrt(max(b * b + a * c, 0.0)) + 1e-300)
        joint = (p + q + d * (t - s)) / 2
        return joint, _bulge(t, joint - p), -_bulge(-s, joint - q)

    def error(self, first: int, last: int) -> float:
        """The largest distance of its places from the two arcs; infinite beyond a half circle."""
        joint, bulge, next_bulge = self.biarc(first, last)
        if max(abs(bulge), abs(next_bulge)) > 1:
            return np.inf
        x = self.places[first + 1 : last]
        to_first = _distance(self.places[first], joint, bulge, x)
        to_second = _distance(joint, self.places[last], next_bulge, x)
        return float(np.minimum(to_first, to_second).max())

    def longest_pair(self, first: int, step: int, tolerance: float) -> tuple[int, float]:
        """The last place of the longest pair of arcs from `first` within the tolerance; its error.

        `step` places are tried at the beginning, then twice as many each time, then half-way
        between what fits and what does not.
        """
        end = len(self.places) - 1
        fits = first + 1
        fails = end + 1
        error = 0.0
        last = min(first + max(step, 2), end)
        while fails - fits > 1:
            tried = self.error(first, last)
            if tried <= tolerance:
                fits = last
                error = tried
            else:
                fails = last
            last = (fits + fails) // 2 if fails <= end else min(2 * fits - first, end)
        return fits, error

    def arcs(self, tolerance: float) -> tuple[Vector, Vector, float]:
        """Vertices (K + 1, 2) and bulges (K,) along the run, and their error."""
        vertices = [self.places[0]]
        bulges = []
        error = 0.0
        first = 0
        step = PLACES_A_STEP
        while first < len(self.places) - 1:
            last, pair_error = self.longest_pair(first, step, tolerance)
            joint, bulge, next_bulge = self.biarc(first, last)
            vertices += [joint, self.places[last]]
            bulges += [bulge, next_bulge]
            error = max(error, pair_error)
            step = last - first
            first = last
        return np.array(vertices), np.clip(bulges, -1, 1), error


def fit_arcs(points: Vector, closed: bool, tolerance: float) -> Arcs:
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
            code="points-coincide",
            numbers={"index": index, "points": len(points)},
        )
    vertices = []
    bulges = []
    error = 0.0
    for run in smooth_runs(points, closed, tolerance):
        run_vertices, run_bulges, run_error = run.arcs(tolerance)
        vertices.append(run_vertices[:-1])
        bulges.append(run_bulges)
        error = max(error, run_error)
    if closed:
        return Arcs(np.vstack(vertices), np.concatenate(bulges), True, error)
    vertices.append(run_vertices[-1:])
    return Arcs(np.vstack(vertices), np.append(np.concatenate(bulges), 0.0), False, error)


def find_corners(points: Vector, closed: bool, tolerance: float) -> NDArray[np.intp]:
    """Indices of points that no smooth curve within the tolerance turns at.

    An arc that rounds off a point's turn θ half-way to its neighbours, h away, leaves it by
    h/2 tan(θ/4). Where that is more than the tolerance, and the turn is neither shared with the
    neighbours as in a bend nor of the size of the others' noise, it is a corner.
    """
    if len(points) < 3:
        return np.zeros(0, np.intp)
    ring = points
    padding = "constant"
    if closed:
        ring = np.vstack([points[-1:], points, points[:1]])
        padding = "wrap"
    steps = np.diff(ring, axis=0)
    length = np.linalg.norm(steps, axis=1)
    cross = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
    turn = np.abs(np.arctan2(cross, (steps[:-1] * steps[1:]).sum(axis=1)))
    error = np.minimum(length[:-1], length[1:]) / 2 * np.tan(turn / 4)
    neighbours = np.pad(turn, 1, mode=padding)
    isolated = turn > ISOLATED * np.maximum(neighbours[:-2], neighbours[2:])
    isolated &= turn > OUTSTANDING * np.median(turn)
    corners = np.flatnonzero((error > tolerance) & isolated)
    if not closed:
        corners += 1  # The first point of an open curve has no turn.
    return corners


def plane(axis: Vector) -> Vector:
    """(2, 3) two unit vectors across an axis; seen against it, the second points to the left."""
    first = np.eye(3)[np.argmin(np.abs(axis))]
    first = first - axis * (first @ axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)])


def smooth_runs(points: Vector, closed: bool, tolerance: float) -> list[SmoothRun]:
    """The runs from corner to corner; a closed curve begins at one, if it has any."""
    corners = find_corners(points, closed, tolerance)
    periodic = closed and len(corners) == 0
    if closed:
        first = corners[0] if len(corners) else 0
        points = np.roll(points, -first, axis=0)
        points = np.vstack([points, points[:1]])
        corners = corners - first
    cuts = np.unique([0, *corners, len(points) - 1])
    return [SmoothRun.through(points[i : j + 1], periodic) for i, j in pairwise(cuts)]


def _bulge(tangent: Vector, chord: Vector) -> float:
    """The bulge of the arc that leaves along the tangent and ends at the chord's end."""
    tu, tv = tangent.tolist()
    cu, cv = chord.tolist()
    half = float(np.arctan2(tu * cv - tv * cu, tangent @ chord))
    bulge = float(np.tan(min(max(half, -3.1), 3.1) / 2))
    return 0.0 if abs(bulge) <= ROUNDING else bulge


def _distance(a: Vector, b: Vector, bulge: float, x: Vector) -> Vector:
    """(T,) distance of x (T, 2) from a line or an arc of a half circle at most.

    With w = x - a: G = κ |w|²/2 - n·w and |grad G| = 1 + κ d, so d = 2 G / (1 + |grad G|).
    What is one number is a Python float here: it costs a tenth of an array of one number.
    """
    w = x - a
    to_b = x - b
    wu, wv = w.T
    to_ends = np.minimum(np.hypot(wu, wv), np.hypot(*to_b.T))
    cu, cv = (b - a).tolist()
    length = float(np.hypot(cu, cv))
    if length == 0:
        return to_ends
    along_u, along_v = cu / length, cv / length
    cos = (1 - bulge**2) / (1 + bulge**2)
    sin = 2 * bulge / (1 + bulge**2)
    kappa = 2 * sin / length
    nu, nv = cos * -along_v + sin * along_u, cos * along_u + sin * along_v
    first_tangent = np.array([cos * along_u - sin * -along_v, cos * along_v - sin * along_u])
    last_tangent = np.array([cos * along_u + sin * -along_v, cos * along_v + sin * along_u])
    level = kappa * (wu * wu + wv * wv) / 2 - w @ np.array([nu, nv])
    gradient = np.hypot(kappa * wu - nu, kappa * wv - nv)
    to_circle = 2 * np.abs(level) / (1 + gradient)
    between = (w @ first_tangent >= 0) & (to_b @ last_tangent <= 0)
    return np.where(between, to_circle, to_ends)
