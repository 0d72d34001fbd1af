"""The closed loop: a hand pushes a point mass against a fixture through the real engine.

One tick: read the position, let the engine answer, hold its force over the tick, move the mass by
the exact solution. A robot without quantum, delay, limits or friction has no such stage in
its loop and pays nothing for it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from vfplan.engine.parameters import Vector
from vfplan.engine.ticks import Step
from vfplan.robot import Robot
from vfplan.stability.theory import Plant

Stage = Callable[[Vector], Vector]
Move = Callable[[Vector, Vector, Vector], tuple[Vector, Vector]]


class Engine(Protocol):
    """What the loop asks of an engine."""

    def reset(self, hip: Vector) -> None:
        """Put the proxy at hip (3,) [m]."""

    def step(self, hip: Vector) -> Step:
        """One tick."""


@dataclass(frozen=True, eq=False)
class Hand:
    """What pushes the mass: a constant force, or a spring that also holds it sideways.

    Parameters
    ----------
    force
        (3,) [N] at the position `at`.
    stiffness
        k_h [N/m]; 0: the force is the same everywhere.
    at
        (3,) [m].
    """

    force: Vector
    stiffness: float = 0.0
    at: Vector = field(default_factory=lambda: np.zeros(3))

    def pull(self, x: Vector) -> Vector:
        """(..., 3) the force [N] on a mass at x (..., 3) [m]."""
        if self.stiffness == 0.0:
            return np.broadcast_to(self.force, x.shape)
        return self.force - self.stiffness * (x - self.at)

    def energy(self, x: Vector) -> Vector:
        """(...) the potential [J] of x (..., 3), 0 at `at`."""
        away = x - self.at
        return 0.5 * self.stiffness * (away * away).sum(axis=-1) - away @ self.force


@dataclass(frozen=True, eq=False)
class Motion:
    """What happened, tick by tick.

    Parameters
    ----------
    x, v, proxy
        (T, 3) position [m] and velocity [m/s] as the tick began, and the engine's proxy [m].
    held
        (T, 3) force that the robot held over the tick [N].
    energy
        (T,) kinetic energy, the fixture's spring and the hand's potential together [J].
    limited_ticks
        Ticks in which a force limit acted; absent (`None`) without limits.
    """

    x: Vector
    v: Vector
    proxy: Vector
    held: Vector
    energy: Vector
    limited_ticks: int | None = None


def simulate(
    engine: Engine,
    robot: Robot,
    hand: Hand,
    stiffness: float,
    x: Vector,
    v: Vector,
    ticks: int,
) -> Motion:
    """Run the loop from (x, v); the engine goes on from its present proxy.

    Parameters
    ----------
    engine
        Made with stiffness 1 N/m, or with the diagonal of K over its largest entry.
    stiffness
        K [N/m], the largest of the diagonal.
    """
    plant = Plant.of(robot, hand.stiffness)
    sense, act, limits = _stages(robot)
    move = _frictionless(plant) if robot.friction_n is None else _rubbing(plant, robot.friction_n)
    rows = np.empty((5, ticks, 3))
    for k in range(ticks):
        read = x
        for stage in sense:
            read = stage(read)
        step = engine.step(read)
        force = held = stiffness * step.force
        for stage in act:
            held = stage(held)
        rows[:, k] = x, v, step.proxy, held, force
        dx, v = move(v, held + hand.pull(x), x)
        x = x + dx
    xs, vs, proxies, helds, forces = rows
    # The spring as it is at x: F·(proxy - x)/2 counts no ignored axis.
    spring = 0.5 * (forces * (proxies - xs)).sum(axis=1)
    energy = 0.5 * robot.mass_kg * (vs * vs).sum(axis=1) + spring + hand.energy(xs)
    limited = sum(limit.acted for limit in limits) if limits else None
    return Motion(xs, vs, proxies, helds, energy, limited)


def settle(engine: Engine, hand: Hand, stiffness: float, start: Vector, steps: int = 300) -> Vector:
    """(3,) where the hand and the fixture balance [m]: slow, massless descent from `start`."""
    engine.reset(start)
    x = start
    for _ in range(steps):
        force = stiffness * engine.step(x).force + hand.pull(x)
        x = x + 0.5 * force / (stiffness + hand.stiffness)
    return x


def _stages(robot: Robot) -> tuple[list[Stage], list[Stage], list[_Limit]]:
    sense = [] if robot.quantum_m is None else [_quantise(robot.quantum_m)]
    act = [_delay(robot.delay_ticks)] if robot.delay_ticks else []
    known = (robot.force_limit_n, False), (robot.force_step_limit_n, True)
    limits = [_Limit(limit, of_change) for limit, of_change in known if limit is not None]
    return sense, [*act, *limits], limits


def _quantise(quantum: float) -> Stage:
    return lambda x: np.round(x / quantum) * quantum


def _delay(ticks: int) -> Stage:
    waiting: deque[Vector] = deque()

    def stage(force: Vector) -> Vector:
        if not waiting:  # before the first tick the force was what it is at the first
            waiting.extend([force] * ticks)
        waiting.append(force)
        return waiting.popleft()

    return stage


class _Limit:
    """A limiter of the force, or of its change from tick to tick; counts the ticks it acted in."""

    def __init__(self, limit: float, of_change: bool = False) -> None:
        self.limit, self.acted, self.of_change = limit, 0, of_change
        self.before: Vector | None = None if of_change else np.zeros(3)

    def __call__(self, force: Vector) -> Vector:
        base = force if self.before is None else self.before  # the first change is none
        change = force - base
        length = float(np.sqrt(change @ change))
        if length > self.limit:
            self.acted += 1
            force = base + change * (self.limit / length)
        if self.of_change:
            self.before = force
        return force


def _frictionless(plant: Plant) -> Move:
    (xv, xf), (vv, vf) = plant.transition()
    return lambda v, net, x: (xv * v + xf * net, vv * v + vf * net)


def _rubbing(plant: Plant, friction: float) -> Move:
    """Coulomb friction along each axis, as in a robot's joints: exact up to and past each halt."""

    def move(v: Vector, net: Vector, x: Vector) -> tuple[Vector, Vector]:
        moved = [_rub(plant, friction, float(a), float(b)) for a, b in zip(v, net, strict=True)]
        return np.array([dx for dx, _ in moved]), np.array([w for _, w in moved])

    return move


def _rub(plant: Plant, friction: float, v: float, net: float) -> tuple[float, float]:
    """One axis over one tick: displacement [m] and velocity after [m/s].

    `net` is the force without friction [N] where the tick begins.
    """
    from scipy.optimize import brentq

    left, dx = plant.period, 0.0
    while left > 0:
        here = net - plant.hand * dx
        if v == 0.0 and abs(here) <= friction:
            return dx, 0.0  # stuck: the held force and the hand cannot move it
        sign = np.sign(v if v != 0.0 else here)

        def after(t: float, v: float = v, drive: float = here - sign * friction) -> Vector:
            return plant.transition(t) @ [v, drive]

        d, w = after(left)
        if w * sign >= 0.0 or v == 0.0:
            return dx + d, w
        halt = brentq(lambda t: after(t)[1], 0.0, left, xtol=1e-16 * left, rtol=1e-15)
        dx, v, left = dx + after(halt)[0], 0.0, left - halt
    return dx, v
