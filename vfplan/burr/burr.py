"""Burring: a ball at the tip takes points away that it reaches, and deeper ones appear.

The demonstration of what editing is for; the removal is a ball's, not a bone's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from vfplan.engine.parameters import Vector
from vfplan.engine.proxy import ProxyEngine
from vfplan.engine.renderable import sampled
from vfplan.engine.ticks import Status
from vfplan.errors import SceneError, SettingError
from vfplan.fixture import Fixture
from vfplan.replaying.findings import finding
from vfplan.replaying.replay import Replay, replay
from vfplan.session import Session
from vfplan.session.events import Event

MOST = 32  # points a tick: each goes and comes, and a tick takes 64 changes
NEIGHBOURS = 12  # of a normal


@dataclass(frozen=True, eq=False)
class Burred:
    """What was burred away, and its replay."""

    replayed: Replay  # the session again with what happened; its metrics hold `burr` besides
    events: list[Event]  # the edits, each with its tick
    # The points (N, 3) [m] and the same when all was done: each that went has come back deeper
    before: Vector
    after: Vector
    tick: Vector  # (E,) ticks of the edits

    @property
    def metrics(self) -> dict[str, Any]:
        """The replay's report, with `burr`."""
        return self.replayed.metrics


class Burr:
    """The ball, and the points as it has left them.

    A point that the ball reaches by more than `least` comes back on it, straight below: against
    the normal that the cloud has there at first, on the side that its neighbours were taken from,
    and for the first on the proxy's.
    """

    def __init__(self, points: Vector, radius: float, least: float, axis: Vector | None) -> None:
        self.points = points.copy()
        self._least = radius - least
        self._first = points if axis is None else points - np.outer(points @ axis, axis)
        self._tree, self._up = cKDTree(self._first), np.zeros_like(points)
        self._numbers = np.arange(len(points))  # that the engine has for them
        self._next = len(points)
        self._radius, self._axis = radius, axis

    def bite(self, tick: int, hip: Vector, proxy: Vector) -> Event | None:
        """The edit for what the ball reaches; at most 32 points, the nearest first."""
        away = self.points - hip
        if self._axis is not None:
            away -= np.outer(away @ self._axis, self._axis)
        square = np.einsum("ij,ij->i", away, away)
        near = np.flatnonzero(square < self._least**2)
        if not len(near):
            return None
        near = near[np.argsort(square[near], kind="stable")][:MOST]
        up = self._upward(near, proxy)
        along = -np.einsum("ij,ij->i", away[near], up)  # into the fixture
        ahead = np.sqrt(along**2 + self._radius**2 - square[near]) - along
        gone = self._numbers[near].copy()
        self.points[near] -= ahead[:, None] * up
        self._numbers[near] = np.arange(self._next, self._next + len(near))
        self._next += len(near)
        return Event(tick, remove=gone, add=self.points[near].copy())

    def _upward(self, near: NDArray[np.intp], proxy: Vector) -> Vector:
        """Unit normals (n, 3) of points: across their first neighbours, towards the proxy."""
        for k in near[~self._up[near].any(axis=1)]:
            beside = self._tree.query(self._first[k], min(NEIGHBOURS, len(self._up)))[1]
            around = self._first[beside] - self._first[beside].mean(axis=0)
            spread = around.T @ around
            if self._axis is not None:  # never across the plane
                spread += np.trace(spread) * np.outer(self._axis, self._axis)
            normal = np.linalg.eigh(spread)[1][:, 0]
            taken = self._up[beside].sum(axis=0)
            side = normal @ (taken if taken.any() else proxy - self._first[k])
            self._up[k] = -normal if side < 0 else normal
        return self._up[near]


def burr(
    fixture: Fixture,
    session: Session,
    radius_m: float,
    *,
    done: Callable[[int], None] = lambda ticks: None,
) -> Burred:
    """Let the session's hand burr a fixture with a ball of `radius_m` at the tip, and replay it.

    Raises SettingError: a radius not below the fixture's contact radius: it would take away before
        it is felt
    Raises SceneError: a fixture whose points are not rendered
    """
    if fixture.rendering is None or fixture.guidance is not None:
        raise SceneError("a fixture with rendering, and without guidance, is burred")
    most = fixture.contact_radius + fixture.point_radius
    if not 0 < radius_m < most:
        raise SettingError(
            f"radius {1e3 * radius_m:g} mm: allowed is above 0 and below the contact radius, "
            f"{1e3 * most:g} mm; a larger ball takes away before it is felt"
        )
    fixture = sampled(fixture)
    engine = ProxyEngine.of(fixture, "robust", offline=True)
    engine.make_editable()
    engine.reset(session.hip[0])
    least = min(2 * engine.parameters.band, 0.1 * radius_m)
    ball = Burr(fixture.points, radius_m, least, fixture.ignore_axis)
    events, forces = [], np.empty_like(session.hip)
    changing = np.zeros(len(forces) + 1, bool)
    for k, hip in enumerate(session.hip):
        step = engine.step(hip)
        forces[k] = step.force
        changing[k + 1] = step.status & Status.CHANGING
        if not step.status & Status.INSIDE and engine.distance(hip[None])[0] < radius_m - least:
            event = ball.bite(k + 1, hip, step.proxy)
            if event is not None and k + 1 < len(session.hip):
                engine.edit(event.remove, event.add)
                events.append(event)
        if k % 1000 == 999:
            done(1000)
    replayed = replay(fixture, session, rule="robust", events=events)
    deep = np.linalg.norm(ball.points - fixture.points, axis=1)
    replayed.metrics["burr"] = {
        "radius_m": radius_m,
        "burring_ticks": len(events),
        "points_taken": sum(len(event.remove) for event in events),
        "places_lowered": int(np.count_nonzero(deep)),
        "deepest_m": float(deep.max()),
        "replayed_to_the_bit": bool(np.array_equal(replayed.trace.force, forces)),
        "margin_force_n": float(np.max(fixture.stiffness)) * (most - radius_m),
        "force_step_of_bound": _of_bound(fixture, session, forces, changing),
    }
    replayed.metrics["findings"] += _held(replayed.metrics)
    ticks = np.array([event.tick for event in events], int)
    return Burred(replayed, events, fixture.points, ball.points, ticks)


def _held(report: dict[str, Any]) -> list[dict[str, str]]:
    """A finding where the force is not that of a tool which takes away what it presses on."""
    force, margin = report["force_max_n"], report["burr"]["margin_force_n"]
    if not report["burr"]["burring_ticks"] or force <= 2 * margin:
        return []
    return [
        finding(
            "burr-held",
            "warning",
            f"the force reached {force:.3g} N, and K times the margin is {margin:.3g} N: the proxy "
            "did not follow the tool into what it took (faster than 32 points a tick, a pit "
            "narrower than the proxy, or a thin wall taken from both sides)",
        )
    ]


def _of_bound(fixture: Fixture, session: Session, forces: Vector, changing: Vector) -> float:
    """The largest step of the force under edits, as a part of K (R/256 + |step of the HIP|)."""
    steps = np.linalg.norm(np.diff(forces, axis=0), axis=1)
    moved = np.linalg.norm(np.diff(session.hip, axis=0), axis=1)
    radius = fixture.contact_radius + fixture.point_radius
    parts = steps / (float(np.max(fixture.stiffness)) * (radius / 256 + moved))
    return float(parts[(changing[1:-1] | changing[2:])].max(initial=0.0))
