"""Exact geometry that scenes are made of: pieces, and drawn outlines of segments and arcs.

A set of pieces (segments, arcs, rectangles, spheres) answers `look(x)`: for each piece the distance
from x, its gradient and its Hessian. The free space of a proxy of radius R is where every distance
is at least R.

An outline is a chain of straight segments and circular arcs. Nodes with tangents are joined by
biarcs: two arcs that meet with one tangent. Length, curvature and every offset of such a chain are
known exactly, and points can be set at exact arc lengths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np

from vfplan import fixture as curve
from vfplan.engine.parameters import Vector
from vfplan.geometry import ROUNDING
from vfplan.geometry.lines import in_space, row_lengths


class Look(NamedTuple):
    """Distance to each of M pieces from one position."""

    distance: Vector  # (M,) [m]
    normal: Vector  # (M, 3) gradient of the distance: unit vector away from the piece
    hessian: Vector  # (M, 3, 3) second derivative of the distance [1/m]


class Pieces(Protocol):
    """A set of pieces of one kind."""

    def look(self, x: Vector) -> Look:
        """Distance, gradient and Hessian of every piece at x (3,)."""


# The exact geometry of a scene.
Shape = tuple[Pieces, ...]


def from_nearest(x: Vector, nearest: Vector, flat: Vector) -> Look:
    """Distance to the nearest points; `flat` (M, k, 3): directions along which it is straight."""
    offset = x - nearest
    distance = row_lengths(offset)
    normal = offset / np.where(distance > 0, distance, 1.0)[:, None]
    across = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    across = across - np.einsum("mki,mkj->mij", flat, flat)
    return Look(distance, normal, across / np.where(distance > 0, distance, 1.0)[:, None, None])


@dataclass(frozen=True, eq=False)
class Sides:
    """What sides (M, 3) span from each corner (M, 3) [m]: of one a segment, of two a rectangle.

    A side of no length leaves a point.
    """

    corner: Vector
    sides: tuple[Vector, ...]
    # Walls on segments in the plane z = 0. Without it these would let a proxy pressed deeper than
    # its radius fall off sideways: a rounding error in z grows there from step to step.
    endless: bool = False

    def look(self, x: Vector) -> Look:
        """See `Pieces.look`."""
        if self.endless:
            x = x * [1.0, 1.0, 0.0]
        nearest, flat = nearest_on_sides(self.corner, self.sides, x)
        if self.endless:
            flat = np.insert(flat, 1, [0.0, 0.0, 1.0], axis=1)
        return from_nearest(x, nearest, flat)


def nearest_on_sides(corner: Vector, sides: Sequence[Vector], x: Vector) -> tuple[Vector, Vector]:
    """(M, 3) nearest points to x of what k sides (M, 3) span from each corner (M, 3).

    Also (M, k, 3) the directions of the sides, 0 where that is an end of a side.
    """
    nearest, flat = corner, []
    for side in sides:
        square = np.maximum((side**2).sum(axis=1), np.finfo(float).tiny)
        t = ((x - corner) * side).sum(axis=1) / square
        nearest = nearest + np.clip(t, 0, 1)[:, None] * side
        inner = (t > 0) & (t < 1)
        flat.append(side / np.sqrt(square)[:, None] * inner[:, None])
    return nearest, np.stack(flat, axis=1)


@dataclass(frozen=True, eq=False)
class Spheres:
    """Spherical shells, centres (M, 3) and radii (M,) [m]: the proxy may be outside or inside."""

    centre: Vector
    radius: Vector

    def look(self, x: Vector) -> Look:
        """See `Pieces.look`."""
        outside = from_nearest(x, self.centre, np.zeros((len(self.centre), 0, 3)))
        side = np.where(outside.distance >= self.radius, 1.0, -1.0)
        return Look(
            side * (outside.distance - self.radius),
            side[:, None] * outside.normal,
            side[:, None, None] * outside.hessian,
        )


@dataclass(frozen=True, eq=False)
class Arcs:
    """Circular arcs in the plane z = 0, endless along z."""

    centre: Vector  # (M, 2) [m]
    radius: Vector  # (M,) [m], above 0
    # (M,) angle of the first end and signed angle to the second [rad], |sweep| <= π / 4: an arc
    # that long has one nearest point for a proxy that matters
    start: Vector
    sweep: Vector

    def look(self, x: Vector) -> Look:
        """See `Pieces.look`."""
        offset = x[:2] - self.centre
        middle = self.start + self.sweep / 2
        angle = np.arctan2(offset[:, 1], offset[:, 0]) - middle
        angle -= 2 * np.pi * np.round(angle / (2 * np.pi))
        half = np.abs(self.sweep) / 2
        inner = np.abs(angle) < half
        to = middle + np.clip(angle, -half, half)
        turned = np.column_stack([np.cos(to), np.sin(to)])
        nearest = in_space(self.centre + self.radius[:, None] * turned)
        flat = np.tile([0.0, 0.0, 1.0], (len(self.radius), 1, 1))
        look = from_nearest(np.array([x[0], x[1], 0.0]), nearest, flat)
        # On the arc itself the distance is that from the centre, less the radius.
        r = np.hypot(offset[:, 0], offset[:, 1])
        curved = look.distance / np.where(r > 0, r, 1.0) * np.where(r >= self.radius, 1.0, -1.0)
        return look._replace(hessian=look.hessian * np.where(inner, curved, 1.0)[:, None, None])


@dataclass(frozen=True, eq=False)
class Link:
    """A segment (`sweep` 0) or an arc from `a` to `b`, both (2,) [m]."""

    a: Vector
    b: Vector
    centre: Vector
    radius: float
    start: float
    sweep: float

    @property
    def length(self) -> float:
        """Arc length [m]."""
        return abs(self.sweep) * self.radius if self.sweep else float(np.hypot(*(self.b - self.a)))

    def at(self, s: Vector) -> Vector:
        """(K, 2) positions at the arc lengths s (K,) from `a`."""
        share = s / self.length
        if not self.sweep:
            return self.a + share[:, None] * (self.b - self.a)
        return self.centre + self.radius * unit_vectors(self.start + share * self.sweep)


@dataclass(frozen=True, eq=False)
class Run:
    """A smooth part of an outline: links that meet without a corner."""

    links: tuple[Link, ...]
    closed: bool = False

    @property
    def length(self) -> float:
        """Arc length [m]."""
        return sum(link.length for link in self.links)

    def sample(self, spacing: float) -> Vector:
        """(N, 2) points at equal arc lengths, as close to `spacing` as both ends allow."""
        count = max(1, round(self.length / spacing))
        s = np.arange(count + (not self.closed)) * (self.length / count)
        edges = np.append(0.0, np.cumsum([link.length for link in self.links]))
        which = np.clip(np.searchsorted(edges, s, side="right") - 1, 0, len(self.links) - 1)
        points = np.empty((len(s), 2))
        for i, link in enumerate(self.links):
            points[which == i] = link.at(np.clip(s[which == i] - edges[i], 0, link.length))
        return points


# An outline, run by run.
Runs = tuple[Run, ...]


def sample(runs: Runs, spacing: float) -> Vector:
    """(N, 2) points of all runs; a corner that two runs share stands once."""
    points = np.vstack([run.sample(spacing) for run in runs])
    step = np.round(points / (1e-6 * spacing)).astype(np.int64)
    _, first = np.unique(step, axis=0, return_index=True)
    return points[np.sort(first)]


def pieces(runs: Runs) -> Shape:
    """The exact geometry of an outline in the plane z = 0; arcs are cut at π / 4."""
    arcs, starts, sides = [], [], []
    for link in (link for run in runs for link in run.links):
        if not link.sweep:
            starts.append(link.a)
            sides.append(link.b - link.a)
            continue
        count = int(np.ceil(abs(link.sweep) / (np.pi / 4)))
        sweep = link.sweep / count
        arcs += [(link.centre, link.radius, link.start + i * sweep, sweep) for i in range(count)]
    exact: list[Pieces] = []
    if starts:
        exact.append(Sides(in_space(starts), (in_space(sides),), endless=True))
    if arcs:
        exact.append(Arcs(*map(np.array, zip(*arcs, strict=True))))
    return tuple(exact)


def lines_and_arcs(runs: Runs) -> curve.Pieces:
    """The outline as a fixture's pieces, a stroke a run; arcs are cut at a half circle."""
    strokes = []
    for run in runs:
        vertices, bulges = [], []
        for link in run.links:
            count = max(1, int(np.ceil(abs(link.sweep) / np.pi - 1e-9)))
            vertices += list(link.at(np.arange(count) * (link.length / count)))
            bulges += [np.tan(link.sweep / count / 4)] * count
        if not run.closed:
            vertices.append(run.links[-1].b)
            bulges.append(0.0)
        strokes.append((in_space(vertices), np.array(bulges), run.closed))
    return curve.Pieces.joined(strokes)


def unit_vectors(angle: Vector) -> Vector:
    """(..., 2) directions at angles [rad] from x."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def segment(a: Vector, b: Vector) -> Link:
    """A straight link from a to b (2,) [m]."""
    return Link(np.asarray(a, float), np.asarray(b, float), np.zeros(2), 0.0, 0.0, 0.0)


def arc(centre: Vector, radius: float, start: float, sweep: float) -> Link:
    """A circular link: from the angle `start` on by `sweep` [rad]."""
    centre = np.asarray(centre, float)
    a, b = (centre + radius * unit_vectors(angle) for angle in (start, start + sweep))
    return Link(a, b, centre, radius, start, sweep)


def polyline(*corners: Vector) -> Runs:
    """Straight runs from corner to corner (2,) [m]."""
    return tuple(Run((segment(a, b),)) for a, b in pairwise(corners))


def smooth(nodes: Vector) -> Run:
    """Biarcs through nodes (K, 2) [m], tangent at each to the circle through it and its two."""
    links = []
    for start, end in pairwise(zip(nodes, tangents(nodes), strict=True)):
        links += biarc(*start, *end)
    return Run(tuple(links))


def tangents(nodes: Vector) -> Vector:
    """Unit tangents (K, 2): at a node, of the circle through it and its neighbours."""
    arriving = nodes - np.roll(nodes, 1, axis=0)
    leaving = np.roll(nodes, -1, axis=0) - nodes
    arriving_square = (arriving**2).sum(axis=1)
    leaving_square = (leaving**2).sum(axis=1)
    tangent = arriving / arriving_square[:, None] + leaving / leaving_square[:, None]
    tangent /= row_lengths(tangent)[:, None]
    # At an end the tangent is that of its neighbour, mirrored about the chord.
    for end, inner, chord in ((0, 1, leaving[0]), (-1, -2, arriving[-1])):
        unit = chord / np.linalg.norm(chord)
        tangent[end] = 2 * (tangent[inner] @ unit) * unit - tangent[inner]
    return tangent


def biarc(p0: Vector, t0: Vector, p1: Vector, t1: Vector) -> list[Link]:
    """Two arcs from p0 with tangent t0 to p1 with tangent t1, of equal tangent lengths.

    The joint is where the tangent lengths d solve |p1 - d t1 - p0 - d t0| = 2 d (Bolton, "Biarc
    curves", 1975).
    """
    v = p1 - p0
    a = 2 * (1 - t0 @ t1)
    b = v @ (t0 + t1)
    d = (v @ v) / (b + np.sqrt(b * b + a * (v @ v)))
    joint = (p0 + p1 + d * (t0 - t1)) / 2
    first = _arc_from(p0, t0, joint)
    second = _arc_from(p1, -t1, joint)
    turned = {"start": second.start + second.sweep, "sweep": -second.sweep}
    return [first, replace(second, a=second.b, b=second.a, **turned)]


def _arc_from(p: Vector, tangent: Vector, q: Vector) -> Link:
    """The arc that leaves p along the tangent and ends in q."""
    normal = np.array([-tangent[1], tangent[0]])
    chord = q - p
    side = chord @ normal
    if abs(side) < ROUNDING * np.hypot(*chord):
        return segment(p, q)
    signed = (chord @ chord) / (2 * side)
    centre = p + signed * normal
    start = float(np.arctan2(*(p - centre)[::-1]))
    sweep = 2 * float(np.arctan2(side, chord @ tangent))
    return Link(p, q, centre, abs(signed), start, sweep)
