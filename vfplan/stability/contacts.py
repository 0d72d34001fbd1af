"""Where a hand presses: a cloud, a place on it, and the walls that hold the proxy there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan import scenes
from vfplan.engine.parameters import Vector, check_axis
from vfplan.engine.renderable import as_rendered, exact_of
from vfplan.fixture import Fixture, Pieces

RADIUS = 5e-3  # R = r_c of the scenes [m]
X, Y, _ = np.eye(3)


@dataclass(frozen=True, eq=False)
class Contact:
    """One place to press against."""

    points: Vector  # (N, 3) cloud [m]
    touch: Vector  # (3,) the proxy's position as it touches [m]
    normals: Vector  # (M, 3) unit normals of the walls that hold it there
    ignore_axis: str | Vector | None = None  # as the engine takes it
    radius: float = RADIUS  # R = r_c + r_v [m]
    # The hand also holds the mass sideways: a ball pressed onto a convex place, or onto a place
    # whose shape nobody has looked at, would else roll off
    held: bool = False
    room: float = 0.2  # how far from the touch there is nothing yet, in `radius`
    # What rule "exact" presses on, where it is known: lines and arcs, or (K, 3) rows of points that
    # are triangles
    exact: Pieces | NDArray[np.int32] | None = None

    @property
    def inward(self) -> Vector:
        """(3,) the direction of the push, against all walls equally; not a unit vector."""
        return -self.normals.sum(axis=0)

    @property
    def start(self) -> Vector:
        """(3,) a place clear of the contact [m]."""
        return self.touch - self.room * self.radius * self.inward


def flat() -> Iterator[Contact]:
    """Experiment 1's sheet."""
    yield Contact(scenes.Sheet().points, scenes.Sheet.centre + RADIUS * Y, Y[None])


def patch() -> Contact:
    """A small flat sheet, 20 mm wide: enough for one contact."""
    ticks = np.arange(-20, 21) * (0.02 / 40)
    x, z = np.meshgrid(ticks, ticks)
    points = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])
    return Contact(points, RADIUS * Y, Y[None])


def convex() -> Iterator[Contact]:
    """The outside of a cylinder of radius 30 mm."""
    yield Contact(scenes.Cylinder(radius=0.03).points, (0.03 + RADIUS) * X, X[None], held=True)


def corner() -> Iterator[Contact]:
    """A concave corner of 90 degrees, in space."""
    walls = np.eye(3)[:2]
    yield Contact(scenes.Corner(extrude=0.04).points, RADIUS * walls.sum(axis=0), walls)


def three_walls() -> Iterator[Contact]:
    """A three-way concave corner, 15 mm away from the sheets' outer edges."""
    walls = np.eye(3)
    yield Contact(scenes.ThreeWalls().points, RADIUS * walls.sum(axis=0), walls)


def channel() -> Iterator[Contact]:
    """A channel 5 µm wider than the proxy, pressed against one wall."""
    scene = scenes.Channel()
    touch, pieces = (RADIUS - scene.width / 2) * -Y, scene.lines_and_arcs
    yield Contact(scene.points, touch, -Y[None], scene.ignore_axis, room=0.0, exact=pieces)


def point() -> Iterator[Contact]:
    """A single point."""
    yield Contact(scenes.Point().points, RADIUS * Y, Y[None], held=True)


def double_sheet() -> Iterator[Contact]:
    """Two sheets 4 mm apart, pressed from above."""
    scene = scenes.DoubleSheet()
    yield Contact(scene.points, (scene.gap / 2 + RADIUS) * Y, Y[None])


def omega() -> Iterator[Contact]:
    """The paper's Ω: over its top, inside its ring, and in the sharp corner at its foot."""
    scene = scenes.Omega()
    top, side = np.array([0.0, 74.5e-3, 0.0]), np.array([35e-3, 44e-3, 0.0])
    pieces = scene.lines_and_arcs
    yield from _either_side(scene.points, top, scene.ignore_axis, RADIUS, pieces)
    yield from _either_side(scene.points, side, scene.ignore_axis, RADIUS, pieces)
    foot, out = np.array([14e-3, 0.0, 0.0]), np.array([np.cos(np.pi / 6), 0.5, 0.0])
    touch = first_touch(scene.points, foot + 14e-3 * out, -out, RADIUS)
    if touch is not None:
        yield Contact(scene.points, touch, out[None], scene.ignore_axis, held=True, exact=pieces)


SCENES: dict[str, Callable[[], Iterator[Contact]]] = {
    "flat": flat,
    "convex": convex,
    "corner": corner,
    "three-walls": three_walls,
    "channel": channel,
    "point": point,
    "double-sheet": double_sheet,
    "omega": omega,
}
"""Every scene of contact by its name."""
CURVES = "channel", "omega"  # those with lines and arcs


def met(on: Fixture | str, rule: str) -> tuple[str, Iterator[Contact], float | None]:
    """A name, the contacts and the engine's band: of a scene by its name, or of a bundle."""
    if isinstance(on, str):
        return on, SCENES[on](), None
    return "bundle", along(as_rendered(on, rule)), on.band if rule == "robust" else None


def along(fixture: Fixture, count: int = 5) -> Iterator[Contact]:
    """Contacts on either side of `count` points spread over a fixture's cloud.

    A side on which no ball of radius R fits is left out.
    """
    radius = fixture.contact_radius + fixture.point_radius
    for i in spread(fixture.points, count):
        at, axis = fixture.points[i], fixture.ignore_axis
        exact = fixture.pieces if exact_of(fixture) == "curve" else fixture.mesh
        yield from _either_side(fixture.points, at, axis, radius, exact)


def spread(points: Vector, count: int) -> Vector:
    """Indices of up to `count` points far from each other: each the farthest from those before."""
    chosen = [int(np.argmin(points @ [1.0, 1e-3, 1e-6]))]
    nearest = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(points)) and nearest.max() > 0:
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)


def _either_side(
    points: Vector,
    at: Vector,
    axis: str | Vector | None,
    radius: float,
    exact: Pieces | NDArray[np.int32] | None = None,
) -> Iterator[Contact]:
    """The contacts at `at` (3,) along plus and minus the cloud's normal there."""
    a = check_axis(axis)
    flat_points = points if a is None else points - np.outer(points @ a, a)
    height = np.zeros(3) if a is None else (at @ a) * a
    distance = np.linalg.norm(flat_points - (at - height), axis=1)
    normal = _normal(flat_points[distance < radius], a)
    for n in (normal, -normal):
        touch = first_touch(flat_points, at - height + 1.5 * radius * n, -n, radius)
        if touch is not None:
            yield Contact(points, touch + height, n[None], axis, radius, held=True, exact=exact)


def first_touch(points: Vector, start: Vector, way: Vector, radius: float) -> Vector | None:
    """(3,) where a ball that moves from `start` along `way` first touches a point [m].

    `None` when it touches already at the start, or never.
    """
    w = points - start
    ahead, reach = w @ way, radius * radius - (w * w).sum(axis=1)
    if (reach > 0).any():
        return None
    hit = (ahead > 0) & (ahead * ahead + reach >= 0)
    if not hit.any():
        return None
    # The smaller root of |w - t way| = R as c / (ahead + sqrt(...)): no cancellation.
    t = -reach[hit] / (ahead[hit] + np.sqrt(ahead[hit] ** 2 + reach[hit]))
    return start + t.min() * way


def _normal(near: Vector, axis: Vector | None) -> Vector:
    """Across the cloud's thin direction; for a single point any direction across the axis."""
    spread = np.cov(near.T) if len(near) > 1 else np.zeros((3, 3))
    if axis is not None:  # the cloud is endless along it
        spread = spread + (1.0 + np.trace(spread)) * np.outer(axis, axis)
    n = np.linalg.eigh(spread)[1][:, 0]
    return n * np.sign(n[int(np.argmax(np.abs(n)))])
