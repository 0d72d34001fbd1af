"""The contacts of a study: a cloud, a place on it, and the walls that hold the proxy there.

Also the result of one case: what was expected, and what was measured.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import numpy as np

from vfplan import scenes
from vfplan.display import Report
from vfplan.engine.parameters import Vector, check_axis
from vfplan.engine.proxy import as_rendered, exact_shape
from vfplan.fixture import Fixture, Pieces, StoredIndices
from vfplan.geometry.lines import flattened, row_lengths

# R = r_c of the scenes [m], as in the paper's experiments.
RADIUS = 5e-3

# Rounding of a distance of some centimetres [m]. The engine's guarantee itself has no slack.
ROUNDING_M = 1e-12

# Stiffness of a hand that also holds the mass sideways, as a share of K.
HAND_SHARE = 0.2

X, Y, Z = np.eye(3)

# What rule "exact" renders, where that is known: lines and arcs, or triangles.
ExactShape = Pieces | StoredIndices | None


@dataclass(frozen=True, eq=False)
class Contact:
    """One place to press against.

    Parameters
    ----------
    points
        (N, 3) the cloud [m].
    touch
        (3,) the proxy's position as it touches [m].
    normals
        (M, 3) unit normals of the walls that hold the proxy there.
    ignore_axis
        The ignored axis, as the engine takes it.
    radius
        R = r_c + r_v [m].
    hand_share
        Stiffness of the spring by which the hand also holds the mass sideways, as a share of K; 0
        where it need not. A ball that is pressed onto a convex place would roll off, and so it
        might on a place whose shape is unknown.
    start_distance
        How far from the touch the cloud is certainly free, as a share of R.
    exact_shape
        What rule "exact" renders, where that is known: lines and arcs, or triangles as (K, 3)
        rows of `points`.
    """

    points: Vector
    touch: Vector
    normals: Vector
    ignore_axis: str | Vector | None = None
    radius: float = RADIUS
    hand_share: float = 0.0
    start_distance: float = 0.2
    exact_shape: ExactShape = None

    @property
    def inward(self) -> Vector:
        """(3,) the sum of the walls' inward normals; not a unit vector."""
        return -self.normals.sum(axis=0)

    @property
    def push_direction(self) -> Vector:
        """(3,) the direction of the push, against all walls equally."""
        return self.inward / np.linalg.norm(self.inward)

    @property
    def start(self) -> Vector:
        """(3,) a place clear of the contact [m]."""
        return self.touch - self.start_distance * self.radius * self.inward


def beside(scene: scenes.Scene, touch: Vector, *normals: Vector, **more: Any) -> Iterator[Contact]:
    """The contact at one place of a scene, (3,) [m], whose walls have these normals."""
    yield Contact(scene.points, touch, np.array(normals), scene.ignore_axis, **more)


def patch() -> Contact:
    """A flat sheet, 20 mm wide, with points 0.5 mm apart: enough for one contact."""
    return Contact(scenes.grid(-0.01 * (X + Z), 0.02 * X, 0.02 * Z, 0.5e-3), RADIUS * Y, Y[None])


def omega() -> Iterator[Contact]:
    """The paper's Ω: over its top, inside its ring, and in the sharp corner at its foot."""
    scene = scenes.Omega()
    shape, axis = scene.lines_and_arcs, scene.ignore_axis
    for place in ([0.0, 74.5e-3, 0.0], [35e-3, 44e-3, 0.0]):
        yield from contacts_beside(scene.points, np.array(place), axis, RADIUS, shape)

    # At the foot the ball comes down at 30 degrees above the ground.
    foot = np.array([14e-3, 0.0, 0.0])
    outward = np.array([np.cos(np.pi / 6), 0.5, 0.0])
    touch = first_touch(scene.points, foot + 14e-3 * outward, -outward, RADIUS)
    if touch is not None:
        yield Contact(scene.points, touch, outward[None], axis, hand_share=HAND_SHARE,
                      exact_shape=shape)  # fmt: skip


# Every scene of contact by its name: a flat sheet, the outside of a cylinder of radius 30 mm,
# concave corners, a channel 5 µm wider than the proxy, a single point, two sheets 4 mm apart, and
# the paper's Ω.
SCENES = {
    "flat": partial(beside, scenes.Sheet(), scenes.Sheet.centre + RADIUS * Y, Y),
    "convex": partial(beside, scenes.Circle(radius=0.03, extrude=0.06), (0.03 + RADIUS) * X, X,
                      hand_share=HAND_SHARE),
    "corner": partial(beside, scenes.Corner(extrude=0.04), RADIUS * (X + Y), X, Y),
    "three-walls": partial(beside, scenes.ThreeWalls(), RADIUS * (X + Y + Z), X, Y, Z),
    "channel": partial(beside, scenes.Channel(), (scenes.Channel.width / 2 - RADIUS) * Y, -Y,
                       start_distance=0.0, exact_shape=scenes.Channel().lines_and_arcs),
    "point": partial(beside, scenes.Point(), RADIUS * Y, Y, hand_share=HAND_SHARE),
    "double-sheet": partial(beside, scenes.DoubleSheet(), (2e-3 + RADIUS) * Y, Y),
    "omega": omega,
}  # fmt: skip

# The scenes whose lines and arcs are known, which rule "exact" renders.
SCENES_WITH_CURVE = ("channel", "omega")


def contacts_on(on: Fixture | str, rule: str) -> tuple[str, list[Contact], float | None]:
    """The name, the contacts and the engine's band [m] of a scene by its name, or of a bundle.

    The band is `None` where the engine chooses it.
    """
    if isinstance(on, str):
        return on, list(SCENES[on]()), None
    band = on.band if rule == "robust" else None
    return "bundle", list(contacts_along(as_rendered(on, rule), 5)), band


def contacts_along(fixture: Fixture, count: int) -> Iterator[Contact]:
    """Contacts on either side of `count` points that are spread over a fixture's cloud.

    A side on which no ball of radius R fits has no contact.
    """
    radius = fixture.contact_radius + fixture.point_radius
    shape = fixture.pieces if exact_shape(fixture) == "curve" else fixture.mesh
    # Each row is the point farthest from all that come before it.
    points = fixture.points
    rows = [int(np.argmin(points @ [1.0, 1e-3, 1e-6]))]
    distance = row_lengths(points - points[rows[0]])
    while len(rows) < min(count, len(points)) and distance.max() > 0:
        rows.append(int(np.argmax(distance)))
        distance = np.minimum(distance, row_lengths(points - points[rows[-1]]))
    for row in rows:
        yield from contacts_beside(points, points[row], fixture.ignore_axis, radius, shape)


def contacts_beside(
    points: Vector, place: Vector, ignore_axis: str | Vector | None, radius: float,
    exact_shape: ExactShape,
) -> Iterator[Contact]:  # fmt: skip
    """The contacts of a ball of `radius` [m] on both sides of the cloud at `place` (3,) [m]."""
    axis = check_axis(ignore_axis)
    flat_points, flat_place = flattened(points, axis), flattened(place[None], axis)[0]
    normal = cloud_normal(flat_points[row_lengths(flat_points - flat_place) < radius], axis)
    for outward in (normal, -normal):
        touch = first_touch(flat_points, flat_place + 1.5 * radius * outward, -outward, radius)
        if touch is not None:
            touch = touch + (place - flat_place)
            yield Contact(points, touch, outward[None], ignore_axis, radius, hand_share=HAND_SHARE,
                          exact_shape=exact_shape)  # fmt: skip


def first_touch(points: Vector, start: Vector, direction: Vector, radius: float) -> Vector | None:
    """(3,) the place where a ball that moves from `start` along `direction` meets a point [m].

    `None` where the ball touches a point at the start already, or never. `direction` (3,) is a
    unit vector.
    """
    offset = points - start
    along = offset @ direction
    reach = radius * radius - (offset * offset).sum(axis=1)
    if (reach > 0).any():
        return None
    is_met = (along > 0) & (along * along + reach >= 0)
    if not is_met.any():
        return None
    # The smaller root of |offset - t direction| = R, in the form that loses no digits.
    t = -reach[is_met] / (along[is_met] + np.sqrt(along[is_met] ** 2 + reach[is_met]))
    return start + t.min() * direction


def cloud_normal(points: Vector, axis: Vector | None) -> Vector:
    """(3,) the unit vector along which the points (N, 3) spread least, across an ignored axis.

    Its largest component is above 0. For a single point it is any direction across the axis.
    """
    spread = np.cov(points.T, ddof=min(1, len(points) - 1))
    if axis is not None:
        # The cloud is endless along the axis, so that its spread there must never be the least.
        spread = spread + (1.0 + np.trace(spread)) * np.outer(axis, axis)
    normal = np.linalg.eigh(spread)[1][:, 0]
    return normal * np.sign(normal[int(np.argmax(np.abs(normal)))])


Outcome = Literal["pass", "fail", "finding"]


@dataclass(frozen=True)
class CaseResult:
    """The result of one case.

    Parameters
    ----------
    case
        The name of the case; its parts are joined by "/".
    outcome
        "pass", "fail" or "finding". A finding is a failure of rule "paper". That rule is kept as it
        was published, and no robot renders it, so its failures do not fail the study.
    detail
        What was expected and what was measured, in words.
    limit, measured
        The stated bound and the figure that is held against it, both in `unit`. `None` where the
        case was refused.
    unit
        The unit of `limit` and `measured`.
    values
        Further figures by name. The unit is part of the name.
    """

    case: str
    outcome: Outcome
    detail: str
    limit: float | None = None
    measured: float | None = None
    unit: str = ""
    values: Report = field(default_factory=dict)

    def as_dict(self) -> Report:
        """The result as `vfplan stability --json` reports it."""
        figures = dict(vars(self))
        values = figures.pop("values")
        return figures | values


def outcome_of(is_good: bool, rule: str = "robust") -> Outcome:
    """The outcome of a check of what `rule` did."""
    if is_good:
        return "pass"
    return "finding" if rule == "paper" else "fail"
