"""Drawn outlines as chains of straight segments and circular arcs.

Nodes with tangents are joined by biarcs: two arcs that meet with one tangent. Length, curvature
and every offset of such a chain are known exactly, and points can be set at exact arc lengths.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vfplan import fixture as curve
from vfplan.engine.parameters import Vector
from vfplan.scenes.primitives import Arcs, Pieces, Segments

STRAIGHT = 1e-12  # an arc that bends less than this share of its chord is a segment


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
        angle = self.start + share * self.sweep
        return self.centre + self.radius * np.column_stack([np.cos(angle), np.sin(angle)])

    def distance(self, x: Vector) -> Vector:
        """(T,) distance of the positions x (T, 2) [m]."""
        if not self.sweep:
            along = self.b - self.a
            t = np.clip((x - self.a) @ along / (along @ along), 0, 1)
            return np.hypot(*(x - self.a - t[:, None] * along).T)
        away = x - self.centre
        turned = (np.arctan2(away[:, 1], away[:, 0]) - self.start) * np.sign(self.sweep)
        beside = turned % (2 * np.pi) <= abs(self.sweep)
        ends = np.minimum(np.hypot(*(x - self.a).T), np.hypot(*(x - self.b).T))
        return np.where(beside, np.abs(np.hypot(*away.T) - self.radius), ends)


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
        """(N, 2) points at equal arc lengths, as near to `spacing` as both ends allow."""
        count = max(1, round(self.length / spacing))
        s = np.arange(count if self.closed else count + 1) * (self.length / count)
        edges = np.concatenate([[0.0], np.cumsum([link.length for link in self.links])])
        which = np.clip(np.searchsorted(edges, s, side="right") - 1, 0, len(self.links) - 1)
        points = np.empty((len(s), 2))
        for i, link in enumerate(self.links):
            points[which == i] = link.at(np.clip(s[which == i] - edges[i], 0, link.length))
        return points


def distance(runs: tuple[Run, ...], x: Vector) -> Vector:
    """(T,) distance of the positions x (T, 2) from all runs [m]."""
    links = [link for run in runs for link in run.links]
    return np.min([link.distance(x) for link in links], axis=0)


def sample(runs: tuple[Run, ...], spacing: float) -> Vector:
    """(N, 2) points of all runs; a corner that two runs share stands once."""
    points = np.vstack([run.sample(spacing) for run in runs])
    step = np.round(points / (1e-6 * spacing)).astype(np.int64)
    _, first = np.unique(step, axis=0, return_index=True)
    return points[np.sort(first)]


def pieces(runs: tuple[Run, ...]) -> tuple[Pieces, ...]:
    """The exact geometry of an outline in the plane z = 0; arcs are cut at π / 4."""
    links = [link for run in runs for link in run.links]
    straight = [link for link in links if not link.sweep]
    out: list[Pieces] = []
    if straight:
        a, b = (np.array([[*getattr(link, end), 0.0] for link in straight]) for end in "ab")
        out.append(Segments(a, b, endless=True))
    cut = [part for link in links if link.sweep for part in _cut(link)]
    if cut:
        centre, radius, start, sweep = zip(*cut, strict=True)
        out.append(Arcs(np.array(centre), np.array(radius), np.array(start), np.array(sweep)))
    return tuple(out)


def lines_and_arcs(runs: tuple[Run, ...]) -> curve.Pieces:
    """The outline as a fixture's pieces, a stroke a run; arcs are cut at a half circle."""
    vertices, bulges, stroke = [], [], []
    for i, run in enumerate(runs):
        for link in run.links:
            count = max(1, int(np.ceil(abs(link.sweep) / np.pi - 1e-9)))
            vertices += list(link.at(np.arange(count) * (link.length / count)))
            bulges += [np.tan(link.sweep / count / 4)] * count
        if not run.closed:
            vertices.append(run.links[-1].b)
            bulges.append(0.0)
        stroke += [i] * (len(vertices) - len(stroke))
    flat = np.array(vertices)
    return curve.Pieces(
        np.column_stack([flat, np.zeros(len(flat))]),
        np.array(bulges),
        np.array(stroke, np.int32),
        np.array([run.closed for run in runs]),
    )


def _cut(link: Link):
    count = int(np.ceil(abs(link.sweep) / (np.pi / 4)))
    sweep = link.sweep / count
    return [(link.centre, link.radius, link.start + i * sweep, sweep) for i in range(count)]


def segment(a: Vector, b: Vector) -> Link:
    """A straight link from a to b (2,) [m]."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    return Link(a, b, np.zeros(2), 0.0, 0.0, 0.0)


def arc(centre: Vector, radius: float, start: float, sweep: float) -> Link:
    """A circular link: from the angle `start` on by `sweep` [rad]."""
    centre = np.asarray(centre, float)
    a, b = (
        centre + radius * np.array([np.cos(angle), np.sin(angle)])
        for angle in (start, start + sweep)
    )
    return Link(a, b, centre, radius, start, sweep)


def polyline(*corners: Vector) -> tuple[Run, ...]:
    """Straight runs from corner to corner (2,) [m]."""
    return tuple(Run((segment(a, b),)) for a, b in pairwise(corners))


def smooth(nodes: Vector) -> Run:
    """Biarcs through nodes (K, 2) [m], tangent at each to the circle through it and its two."""
    links = []
    for start, end in pairwise(zip(nodes, _tangents(nodes), strict=True)):
        links += biarc(*start, *end)
    return Run(tuple(links))


def _tangents(nodes: Vector) -> Vector:
    """Unit tangents (K, 2): at a node, of the circle through it and its neighbours."""
    before, after = np.roll(nodes, 1, axis=0), np.roll(nodes, -1, axis=0)
    to, on = nodes - before, after - nodes
    to_square, on_square = (to**2).sum(axis=1), (on**2).sum(axis=1)
    tangent = to / to_square[:, None] + on / on_square[:, None]
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    for end, inner, chord in ((0, 1, on[0]), (-1, -2, to[-1])):  # mirrored about the chord
        unit = chord / np.linalg.norm(chord)
        tangent[end] = 2 * (tangent[inner] @ unit) * unit - tangent[inner]
    return tangent


def biarc(p0: Vector, t0: Vector, p1: Vector, t1: Vector) -> list[Link]:
    """Two arcs from p0 with tangent t0 to p1 with tangent t1, of equal tangent lengths.

    The joint is where the tangent lengths d solve |p1 - d t1 - p0 - d t0| = 2 d (Bolton, "Biarc
    curves", 1975).
    """
    v, t = p1 - p0, t0 + t1
    a, b = 2 * (1 - t0 @ t1), v @ t
    d = (v @ v) / (b + np.sqrt(b * b + a * (v @ v)))
    joint = (p0 + p1 + d * (t0 - t1)) / 2
    first = _arc_from(p0, t0, joint)
    second = _arc_from(p1, -t1, joint)
    return [first, Link(second.b, second.a, second.centre, second.radius,
                        second.start + second.sweep, -second.sweep)]  # fmt: skip


def _arc_from(p: Vector, tangent: Vector, q: Vector) -> Link:
    """The arc that leaves p along the tangent and ends in q."""
    left = np.array([-tangent[1], tangent[0]])
    chord = q - p
    side = chord @ left
    if abs(side) < STRAIGHT * np.hypot(*chord):
        return Link(p, q, np.zeros(2), 0.0, 0.0, 0.0)
    signed = (chord @ chord) / (2 * side)
    centre = p + signed * left
    start = float(np.arctan2(*(p - centre)[::-1]))
    sweep = 2 * float(np.arctan2(side, chord @ tangent))
    return Link(p, q, centre, abs(signed), start, sweep)
