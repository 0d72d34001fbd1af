"""The closed loop: a hand pushes a point mass against a fixture through the real engine.

A tick has five steps. The robot measures its position, the engine answers, the force is delayed
and limited, the robot holds it, and the mass moves by the exact solution of its motion. A robot
without quantum, delay, limits or friction skips that step.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from vfplan.engine.answers import Step
from vfplan.engine.parameters import Vector
from vfplan.robot import Robot
from vfplan.stability.theory import Plant


class Engine(Protocol):
    """What the loop needs of an engine."""

    def reset(self, hip: Vector) -> None:
        """Put the proxy at `hip` (3,) [m]."""

    def step(self, hip: Vector) -> Step:
        """Answer to the tool's point at `hip` (3,) [m]."""


@dataclass(frozen=True, eq=False)
class SimulatedHand:
    """What pushes the mass: a constant force, or a spring that also holds it sideways.

    Parameters
    ----------
    force
        (3,) the force on the mass at `position` [N].
    stiffness
        k_h [N/m]. With 0 the force is the same everywhere.
    position
        (3,) the place at which the potential is 0 [m].
    """

    force: Vector
    stiffness: float = 0.0
    position: Vector = field(default_factory=lambda: np.zeros(3))

    def force_at(self, x: Vector) -> Vector:
        """(..., 3) the force [N] on a mass at x (..., 3) [m]."""
        if self.stiffness == 0.0:
            return np.broadcast_to(self.force, x.shape)
        return self.force - self.stiffness * (x - self.position)

    def potential_at(self, x: Vector) -> Vector:
        """(...) the potential energy [J] of a mass at x (..., 3) [m]."""
        offset = x - self.position
        return 0.5 * self.stiffness * (offset * offset).sum(axis=-1) - offset @ self.force


@dataclass(frozen=True, eq=False)
class LoopMotion:
    """The motion of the mass, one row a tick.

    Parameters
    ----------
    x, v
        (T, 3) position [m] and velocity [m/s] at the beginning of the tick.
    proxy
        (T, 3) the engine's proxy [m].
    held_force
        (T, 3) the force that the robot held over the tick [N].
    energy
        (T,) the sum of kinetic energy, the fixture's spring and the hand's potential [J].
    limited_ticks
        How often the force limit or the limit of its change acted. A tick in which both acted
        counts twice. `None` for a robot without limits.
    """

    x: Vector
    v: Vector
    proxy: Vector
    held_force: Vector
    energy: Vector
    limited_ticks: int | None = None


def simulate(
    engine: Engine,
    robot: Robot,
    hand: SimulatedHand,
    stiffness: float,
    x: Vector,
    v: Vector,
    ticks: int,
) -> LoopMotion:
    """Run the loop from (x, v); the engine goes on from its present proxy.

    Parameters
    ----------
    engine
        An engine of stiffness 1 N/m, or of the diagonal of K over its largest entry.
    stiffness
        K [N/m], the largest entry of the diagonal.
    x, v
        (3,) the first position [m] and velocity [m/s].
    """
    plant = Plant.of(robot, hand.stiffness)
    (xv, xf), (vv, vf) = plant.transition()
    forces_in_transit: deque[Vector] = deque()
    previous_force = None
    limited_ticks = 0

    positions = np.empty((ticks, 3))
    velocities = np.empty((ticks, 3))
    proxies = np.empty((ticks, 3))
    spring_forces = np.empty((ticks, 3))
    held_forces = np.empty((ticks, 3))
    for tick in range(ticks):
        measured = x
        if robot.quantum_m is not None:
            measured = np.round(x / robot.quantum_m) * robot.quantum_m

        step = engine.step(measured)
        spring_force = stiffness * step.force

        force = spring_force
        if robot.delay_ticks > 0:
            if not forces_in_transit:
                # Before the first tick the force was what it is at the first.
                forces_in_transit.extend([force] * robot.delay_ticks)
            forces_in_transit.append(force)
            force = forces_in_transit.popleft()
        if robot.force_limit_n is not None:
            force, is_limited = limit_change(force, np.zeros(3), robot.force_limit_n)
            limited_ticks += is_limited
        if robot.force_step_limit_n is not None:
            if previous_force is None:
                previous_force = force
            force, is_limited = limit_change(force, previous_force, robot.force_step_limit_n)
            limited_ticks += is_limited
            previous_force = force

        positions[tick] = x
        velocities[tick] = v
        proxies[tick] = step.proxy
        spring_forces[tick] = spring_force
        held_forces[tick] = force

        net = force + hand.force_at(x)
        if robot.friction_n is None:
            displacement = xv * v + xf * net
            v = vv * v + vf * net
        else:
            displacement, v = slide_with_friction(plant, robot.friction_n, v, net)
        x = x + displacement

    # The spring's energy at x is F·(proxy - x)/2, which counts no ignored axis.
    spring_energy = 0.5 * (spring_forces * (proxies - positions)).sum(axis=1)
    kinetic_energy = 0.5 * robot.mass_kg * (velocities * velocities).sum(axis=1)
    energy = kinetic_energy + spring_energy + hand.potential_at(positions)
    has_limits = robot.force_limit_n is not None or robot.force_step_limit_n is not None
    if not has_limits:
        limited_ticks = None
    return LoopMotion(positions, velocities, proxies, held_forces, energy, limited_ticks)


def run_until_still(
    engine: Engine, hand: SimulatedHand, stiffness: float, start: Vector, steps: int = 300
) -> Vector:
    """(3,) the place where hand and fixture balance [m].

    A mass-less point descends from `start` (3,) [m], half of the way to the balance a step.
    `stiffness` is K [N/m], and the engine's own stiffness is 1 N/m.
    """
    engine.reset(start)
    x = start
    for _ in range(steps):
        force = stiffness * engine.step(x).force + hand.force_at(x)
        x = x + 0.5 * force / (stiffness + hand.stiffness)
    return x


def limit_change(force: Vector, base: Vector, limit: float) -> tuple[Vector, bool]:
    """The force nearest to `force` (3,) on the way from `base` (3,), and whether it was limited.

    Its distance from `base` is at most `limit`. All three are in N.
    """
    change = force - base
    length = float(np.sqrt(change @ change))
    if length > limit:
        return base + change * (limit / length), True
    return force, False


def slide_with_friction(
    plant: Plant, friction: float, v: Vector, net: Vector
) -> tuple[Vector, Vector]:
    """One tick with Coulomb friction along each axis, as a robot's joints have it.

    Parameters
    ----------
    friction
        Coulomb friction along each axis [N].
    v
        (3,) velocity at the beginning of the tick [m/s].
    net
        (3,) force without friction at the beginning of the tick [N].

    Returns
    -------
    displacement, v
        (3,) displacement over the tick [m] and velocity after it [m/s].
    """
    displacement = np.empty(3)
    v_after = np.empty(3)
    for axis in range(3):
        displacement[axis], v_after[axis] = slide_along_axis(
            plant, friction, float(v[axis]), float(net[axis])
        )
    return displacement, v_after


def slide_along_axis(plant: Plant, friction: float, v: float, net: float) -> tuple[float, float]:
    """One axis of `slide_with_friction`, exact up to each halt and past it."""
    from scipy.optimize import brentq

    remaining = plant.period
    displacement = 0.0
    while remaining > 0:
        force = net - plant.hand * displacement
        if v == 0.0 and abs(force) <= friction:
            # The mass sticks: held force and hand together cannot move it.
            return displacement, 0.0
        direction = np.sign(v)
        if v == 0.0:
            direction = np.sign(force)
        drive = force - direction * friction
        moved, v_after = plant.transition(remaining) @ [v, drive]
        if v_after * direction >= 0.0 or v == 0.0:
            return displacement + moved, v_after

        # The mass halts before the tick ends. The rest of the tick begins at rest.
        halt = brentq(
            velocity_after, 0.0, remaining, args=(plant, v, drive), xtol=1e-16 * remaining,
            rtol=1e-15,
        )  # fmt: skip
        displacement += (plant.transition(halt) @ [v, drive])[0]
        v = 0.0
        remaining -= halt
    return displacement, v


def velocity_after(t: float, plant: Plant, v: float, drive: float) -> float:
    """The velocity [m/s] `t` [s] after a velocity `v` [m/s] under a driving force `drive` [N]."""
    return (plant.transition(t) @ [v, drive])[1]
