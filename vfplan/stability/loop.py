"""A hand pushes a point mass against a fixture through the real engine, and what theory says of it.

A tick has five steps. The robot measures its position, the engine answers, the force is delayed,
filtered and limited, the robot holds it, and the mass moves by the exact solution of its motion. A
robot without quantum, delay, filter, limits or friction skips that step.

The plant is a mass with viscous damping, and with the spring of a hand where a scene needs one:
m ẍ + b ẋ + k_h x = F. The robot holds F over each tick (zero-order hold). The motion from tick to
tick is therefore a matrix exponential, and no integrator's error can pass for an instability.
docs/stability.md derives the bounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from vfplan.engine.parameters import Vector, number
from vfplan.engine.proxy import ProxyEngine, Status, Step
from vfplan.errors import SettingError
from vfplan.geometry.lines import Array
from vfplan.robot import Robot

# Smallest decay b T / m of a tick. float64 cannot tell the bound of a smaller one from 0.
MIN_DECAY = 1e-9

# Largest decay b T / m of a tick. The exponential of a larger one overflows float64.
MAX_DECAY = 1e12

# Smallest cutoff of a robot's filter, over the smaller of b / m and 1 / T [Hz s]. With a lower one
# a hand that holds the mass comes to rest at every K, so that there is no largest one.
MIN_FILTER = 0.1

# Largest spectral radius that counts as stable.
#
# One minus the radius reaches the rounding of an eigenvalue long before K reaches 0, so that a
# radius of exactly 1 would be met by rounding alone.
STABLE_RADIUS = 1.0 - 1e-13

# Width, relative to K, at which the bisection of the exact bound ends.
BOUND_RESOLUTION = 1e-10


def worst_delay(robot: Robot) -> int:
    """The longest delay of the robot [ticks]."""
    return robot.delay_ticks + robot.delay_jitter_ticks


def filter_share(robot: Robot) -> float:
    """Share of a change of force that passes the robot's filter in one tick; 1 without a filter.

    It is the first-order filter of libfranka. A cutoff of 0 means none.
    """
    age = 1 / (2 * math.pi * robot.filter_hz) if robot.filter_hz else 0.0
    period = 1 / robot.rate_hz
    return period / (period + age)


def transition(robot: Robot, hand: float = 0.0, seconds: float | None = None) -> Array:
    """(2, 2) the exact motion of the mass along one axis from x = 0.

    The rows are the displacement [m] and the velocity [m/s] afterwards. The columns are the
    velocity [m/s] and the net force at x [N] at the beginning. The net force is the held force
    less k_h x. Friction and limits do not act.

    Parameters
    ----------
    hand
        k_h [N/m] >= 0, stiffness of a hand that holds the mass.
    seconds
        How long it moves [s]; `None`: one tick.
    """
    from scipy.linalg import expm

    t = 1 / robot.rate_hz if seconds is None else seconds
    # With t as the unit of time: y' = w, w' = r - alpha w - kappa y, r' = 0. Every entry is then a
    # number without a unit.
    alpha = robot.damping_n_s_per_m * t / robot.mass_kg
    kappa = hand * t * t / robot.mass_kg
    rate = np.array([[0.0, 1.0, 0.0], [-kappa, -alpha, 1.0], [0.0, 0.0, 0.0]])
    return expm(rate)[:2, 1:] * [[t, t * t / robot.mass_kg], [1.0, t / robot.mass_kg]]


def loop_matrix(robot: Robot, stiffness: float, hand: float = 0.0) -> Array:
    """One tick of mass and sampled spring F_k = -K x_{k-d}, a square matrix.

    The state is (x, v), the d older positions, the youngest first, and the force of the tick before
    where the robot filters it. `stiffness` is K [N/m], d the longest delay, and `hand` k_h [N/m].
    """
    (xv, xf), (vv, vf) = transition(robot, hand)
    d, share = worst_delay(robot), filter_share(robot)
    has_filter = share < 1.0
    matrix = np.zeros((2 + d + has_filter, 2 + d + has_filter))
    matrix[0, :2] = 1.0 - xf * hand, xv
    matrix[1, :2] = -vf * hand, vv

    # The held force acts on the position of d ticks ago, and keeps a part of the force before it.
    held_force = np.zeros(len(matrix))
    held_force[1 + d if d > 0 else 0] = -share * stiffness
    if has_filter:
        held_force[-1] = 1.0 - share
        matrix[-1] = held_force
    matrix[0] += xf * held_force
    matrix[1] += vf * held_force

    # The positions move on by one place.
    if d > 0:
        matrix[2, 0] = 1.0
        matrix[3 : 2 + d, 2 : 1 + d] = np.eye(d - 1)
    return matrix


def spectral_radius(robot: Robot, stiffness: float, hand: float = 0.0) -> float:
    """The largest absolute eigenvalue of one tick. The loop is stable below 1."""
    return float(np.abs(np.linalg.eigvals(loop_matrix(robot, stiffness, hand))).max())


def linear_bound(robot: Robot) -> float:
    """The bound K < b / (T/2 + d T + filter) [N/m], of first order in T (Gil et al. 2004).

    A filter makes the force older by T (1 / share - 1).
    """
    age_ticks = worst_delay(robot) - 0.5 + 1 / filter_share(robot)
    return robot.damping_n_s_per_m * robot.rate_hz / age_ticks


def exact_bound(robot: Robot, hand_share: float = 0.0) -> float:
    """The K [N/m] at which the spectral radius reaches 1; 0 without damping.

    The relative error is at most 1e-10, or 2e-13 m / (b T) where that is more.

    Parameters
    ----------
    hand_share
        k_h / K of a hand whose spring is scaled with K.

    Raises
    ------
    SettingError
        A decay b T / m of a tick outside `MIN_DECAY` to `MAX_DECAY`, or a filter so slow that a
        hand that holds the mass bears every K.
    """
    if robot.damping_n_s_per_m == 0.0:
        return 0.0
    decay = robot.damping_n_s_per_m / robot.rate_hz / robot.mass_kg
    number("damping * period / mass", decay, "", least=MIN_DECAY, most=MAX_DECAY)
    slowest_hz = MIN_FILTER * robot.rate_hz * min(decay, 1.0)
    if robot.filter_hz and robot.filter_hz < slowest_hz:
        raise SettingError(
            f"filter_hz is {robot.filter_hz:g} Hz, and behind so slow a filter there is no largest "
            f"stable K. Give at least {slowest_hz:.4g} Hz, or 0 for none.",
            code="filter-slow", numbers={"filter_hz": robot.filter_hz, "least_hz": slowest_hz},
        )  # fmt: skip

    def is_stable(stiffness: float) -> bool:
        return spectral_radius(robot, stiffness, hand_share * stiffness) < STABLE_RADIUS

    return stable_edge(linear_bound(robot), is_stable, BOUND_RESOLUTION)


def stable_edge(
    guess: float,
    is_stable: Callable[[float], bool],
    resolution: float,
    *,
    least: float = 0.0,
    most: float = math.inf,
) -> float:
    """The largest stable K found by doubling and halving a guess, then by bisection [N/m].

    It is `resolution`, relative to K, from one that is not stable; 0 where none above `least` is
    stable. The search ends with the first K of at least `most` that is stable.
    """
    low = guess
    if is_stable(low):
        while is_stable(2 * low):
            low *= 2
            if low >= most:
                return low
    else:
        low /= 2
        while not is_stable(low):
            if low <= least:
                return 0.0
            low /= 2
    high = 2 * low
    while high > (1 + resolution) * low:
        middle = math.sqrt(low * high)
        if is_stable(middle):
            low = middle
        else:
            high = middle
    return low


class FlatWall:
    """An engine of 1 N/m whose forbidden region is y < 0, and whose tool is a point."""

    def reset(self, hip: Vector) -> None:
        """A flat wall remembers nothing."""

    def step(self, hip: Vector) -> Step:
        """Answer to the tool's point at `hip` (3,) [m]."""
        proxy = np.array([hip[0], max(hip[1], 0.0), hip[2]])
        return Step(proxy, np.array([0.0, 1.0, 0.0]), proxy - hip, 1, Status.OK)


Engine = ProxyEngine | FlatWall


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
    x
        (T, 3) position at the beginning of the tick [m].
    held_force
        (T, 3) the force that the robot held over the tick [N].
    energy
        (T,) the sum of kinetic energy, the fixture's spring and the hand's potential [J].
    limited_ticks
        How often the force limit or the limit of its change acted. A tick in which both acted
        counts twice. `None` for a robot without limits.
    """

    x: Vector
    held_force: Vector
    energy: Vector
    limited_ticks: int | None = None


def simulate(
    engine: Engine, robot: Robot, hand: SimulatedHand, stiffness: float, x: Vector, v: Vector,
    ticks: int,
) -> LoopMotion:  # fmt: skip
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
    (xv, xf), (vv, vf) = transition(robot, hand.stiffness)
    passing_share = filter_share(robot)
    limits = robot.force_limit_n, robot.force_step_limit_n
    filtered = limited_ticks = 0
    # How many ticks old the position is that each tick's force answers.
    jitter = np.random.default_rng(1).integers(0, robot.delay_jitter_ticks, ticks, endpoint=True)
    ages = robot.delay_ticks + jitter

    positions, velocities, proxies, spring_forces, held_forces = np.empty((5, ticks, 3))
    for tick in range(ticks):
        measured = x if robot.quantum_m is None else np.round(x / robot.quantum_m) * robot.quantum_m

        step = engine.step(measured)
        spring_forces[tick] = stiffness * step.force

        # Before the first tick the force was what it is at the first.
        force = spring_forces[max(tick - ages[tick], 0)]
        if passing_share < 1.0:
            share = passing_share if tick > 0 else 1.0
            force = filtered = filtered + share * (force - filtered)
        # The first tick has no force before it.
        bases = [np.zeros(3), *held_forces[tick - 1 : tick]]
        for base, limit in zip(bases, limits, strict=False):
            if limit is None:
                continue
            # The force nearest to it on the way from the base.
            change = force - base
            length = float(np.sqrt(change @ change))
            if length > limit:
                force = base + change * (limit / length)
                limited_ticks += 1

        positions[tick], velocities[tick], proxies[tick] = x, v, step.proxy
        held_forces[tick] = force

        net = force + hand.force_at(x)
        if robot.friction_n is None:
            displacement = xv * v + xf * net
            v = vv * v + vf * net
        else:
            axes = [slide(robot, hand.stiffness, float(v[k]), float(net[k])) for k in range(3)]
            displacement, v = np.transpose(axes)
        x = x + displacement

    # The spring's energy at x is F·(proxy - x)/2, which counts no ignored axis.
    spring_energy = 0.5 * (spring_forces * (proxies - positions)).sum(axis=1)
    kinetic_energy = 0.5 * robot.mass_kg * (velocities * velocities).sum(axis=1)
    energy = kinetic_energy + spring_energy + hand.potential_at(positions)
    if limits == (None, None):
        limited_ticks = None
    return LoopMotion(positions, held_forces, energy, limited_ticks)


def run_until_still(engine: Engine, hand: SimulatedHand, stiffness: float, start: Vector) -> Vector:
    """(3,) the place where hand and fixture balance [m].

    A mass-less point descends from `start` (3,) [m], half of the way to the balance in each of 300
    steps.
    `stiffness` is K [N/m], and the engine's own stiffness is 1 N/m.
    """
    engine.reset(start)
    x = start
    for _ in range(300):
        force = stiffness * engine.step(x).force + hand.force_at(x)
        x = x + 0.5 * force / (stiffness + hand.stiffness)
    return x


def slide(robot: Robot, hand: float, v: float, net: float) -> tuple[float, float]:
    """One tick along one axis with Coulomb friction, as a robot's joints have it.

    Exact up to each halt and past it. Takes the hand's stiffness [N/m], the velocity [m/s] and the
    force without friction [N] at the beginning of the tick; gives the displacement [m] and the
    velocity after it.
    """
    from scipy.optimize import brentq

    friction = robot.friction_n
    remaining = 1 / robot.rate_hz
    displacement = 0.0
    while remaining > 0:
        force = net - hand * displacement
        if v == 0.0 and abs(force) <= friction:
            # The mass sticks: held force and hand together cannot move it.
            return displacement, 0.0
        direction = np.sign(v or force)
        drive = force - direction * friction
        moved, v_after = transition(robot, hand, remaining) @ [v, drive]
        if v_after * direction >= 0.0 or v == 0.0:
            return displacement + moved, v_after

        # The mass halts before the tick ends. The rest of the tick begins at rest.
        halt = brentq(lambda t, v=v, drive=drive: (transition(robot, hand, t) @ [v, drive])[1],
                      0.0, remaining, xtol=1e-16 * remaining, rtol=1e-15)  # fmt: skip
        displacement += (transition(robot, hand, halt) @ [v, drive])[0]
        v = 0.0
        remaining -= halt
    return displacement, v
