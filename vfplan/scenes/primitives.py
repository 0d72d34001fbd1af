"""Exact geometry that scenes are made of: segments, arcs, rectangles and spheres.

A set of pieces answers `look(x)`: for each piece the distance from x, its gradient and its Hessian.
The free space of a proxy of radius R is where every distance is at least R.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from vfplan.engine.parameters import Vector


class Look(NamedTuple):
    """Distance to each of M pieces from one position."""

    distance: Vector  # (M,) [m]
    normal: Vector  # (M, 3) gradient of the distance: unit vector away from the piece
    hessian: Vector  # (M, 3, 3) second derivative of the distance [1/m]


class Pieces(Protocol):
    """A set of pieces of one kind."""

    def look(self, x: Vector) -> Look:
        """Distance, gradient and Hessian of every piece at x (3,)."""


def stack(looks: list[Look]) -> Look:
    """Several sets of pieces as one."""
    return Look(*(np.concatenate(parts) for parts in zip(*looks, strict=True)))


def from_nearest(x: Vector, nearest: Vector, flat: Vector) -> Look:
    """Distance to the nearest points; `flat` (M, k, 3): directions along which it is straight."""
    away = x - nearest
    distance = np.linalg.norm(away, axis=1)
    normal = away / np.where(distance > 0, distance, 1.0)[:, None]
    across = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    across = across - np.einsum("mki,mkj->mij", flat, flat)
    return Look(distance, normal, across / np.where(distance > 0, distance, 1.0)[:, None, None])


@dataclass(frozen=True, eq=False)
class Segments:
    """Straight segments from `a` to `b`, both (M, 3) [m]; a point where the two are equal."""

    a: Vector
    b: Vector
    # Walls on segments in the plane z = 0. Without it these would let a proxy pressed deeper than
    # its radius fall off sideways: a rounding error in z grows there from step to step.
    endless: bool = False

    def look(self, x: Vector) -> Look:
        """See `Pieces.look`."""
        if self.endless:
            x = x * [1.0, 1.0, 0.0]
        nearest, along = nearest_on_segments(self.a, self.b, x)
        flat = [along]
        if self.endless:
            flat.append(np.broadcast_to([0.0, 0.0, 1.0], along.shape))
        return from_nearest(x, nearest, np.stack(flat, axis=1))


def nearest_on_segments(a: Vector, b: Vector, x: Vector) -> tuple[Vector, Vector]:
    """(M, 3) nearest points of segments to x; (M, 3) their directions, 0 where that is an end."""
    along = b - a
    square = (along**2).sum(axis=1)
    t = ((x - a) * along).sum(axis=1) / np.where(square > 0, square, 1.0)
    inner = (t > 0) & (t < 1)
    unit = along / np.sqrt(np.where(square > 0, square, 1.0))[:, None]
    return a + np.clip(t, 0, 1)[:, None] * along, unit * inner[:, None]


@dataclass(frozen=True, eq=False)
class Rectangles:
    """Rectangles with a corner at `corner` and the sides `u` and `v`, each (M, 3) [m]."""

    corner: Vector
    u: Vector
    v: Vector

    def look(self, x: Vector) -> Look:
        """See `Pieces.look`."""
        nearest, flat = self.corner.copy(), []
        for side in (self.u, self.v):
            square = (side**2).sum(axis=1)
            t = ((x - self.corner) * side).sum(axis=1) / square
            nearest = nearest + np.clip(t, 0, 1)[:, None] * side
            inner = ((t > 0) & (t < 1))[:, None]
            flat.append(side / np.sqrt(square)[:, None] * inner)
        return from_nearest(x, nearest, np.stack(flat, axis=1))


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
        away = x[:2] - self.centre
        middle = self.start + self.sweep / 2
        angle = np.arctan2(away[:, 1], away[:, 0]) - middle
        angle -= 2 * np.pi * np.round(angle / (2 * np.pi))
        half = np.abs(self.sweep) / 2
        inner = np.abs(angle) < half
        to = middle + np.clip(angle, -half, half)
        nearest = np.zeros((len(self.radius), 3))
        nearest[:, 0] = self.centre[:, 0] + self.radius * np.cos(to)
        nearest[:, 1] = self.centre[:, 1] + self.radius * np.sin(to)
        flat = np.zeros((len(self.radius), 1, 3))
        flat[:, 0, 2] = 1.0
        look = from_nearest(np.array([x[0], x[1], 0.0]), nearest, flat)
        # On the arc itself the distance is that from the centre, less the radius.
        r = np.hypot(away[:, 0], away[:, 1])
        curved = look.distance / np.where(r > 0, r, 1.0) * np.where(r >= self.radius, 1.0, -1.0)
        return look._replace(hessian=look.hessian * np.where(inner, curved, 1.0)[:, None, None])
