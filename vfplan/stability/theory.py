"""What theory says of a mass that a sampled spring holds: exact discretisation and bounds on K.

The plant is a mass with viscous damping, and with the spring of a hand where a scene needs one:
m ẍ + b ẋ + k_h x = F. The robot holds F over each tick (zero-order hold). The motion from tick to
tick is therefore a matrix exponential, and no integrator's error can pass for an instability.
docs/stability.md derives the bounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.parameters import number
from vfplan.robot import Robot

MIN_DECAY = 1e-9
"""Smallest decay b T / m of a tick. float64 cannot tell the bound of a smaller one from 0."""

MAX_DECAY = 1e12
"""Largest decay b T / m of a tick. The exponential of a larger one overflows float64."""

STABLE_RADIUS = 1.0 - 1e-13
"""Largest spectral radius that counts as stable.

One minus the radius reaches the rounding of an eigenvalue long before K reaches 0, so that a
radius of exactly 1 would be met by rounding alone.
"""

BOUND_RESOLUTION = 1e-10
"""Width, relative to K, at which the bisection of the exact bound ends."""


@dataclass(frozen=True)
class Plant:
    """The moving mass along one axis.

    Parameters
    ----------
    mass
        m [kg] > 0.
    damping
        b [N·s/m] >= 0.
    period
        T [s] > 0, one tick.
    hand
        k_h [N/m] >= 0, stiffness of a hand that holds the mass.

    Raises
    ------
    SettingError
        A parameter outside its range.
    """

    mass: float = 1.0
    damping: float = 5.0
    period: float = 1e-3
    hand: float = 0.0

    def __post_init__(self) -> None:
        number("mass", self.mass, "kg", above=0.0)
        number("damping", self.damping, "N·s/m", least=0.0)
        number("period", self.period, "s", above=0.0)
        number("hand", self.hand, "N/m", least=0.0)

    @classmethod
    def of(cls, robot: Robot, hand: float = 0.0) -> Plant:
        """The moving mass of a robot, or of a verdict, without friction and limits."""
        return cls(robot.mass_kg, robot.damping_n_s_per_m, 1 / robot.rate_hz, hand)

    def transition(self, t: float | None = None) -> NDArray[np.float64]:
        """(2, 2) the exact motion over `t` [s] from x = 0; over one tick where `t` is `None`.

        The rows are the displacement [m] and the velocity [m/s] after t. The columns are the
        velocity [m/s] and the net force at x [N] at the beginning. The net force is the held force
        less k_h x.
        """
        from scipy.linalg import expm

        if t is None:
            t = self.period
        # With t as the unit of time: y' = w, w' = r - alpha w - kappa y, r' = 0. Every entry is
        # then a number without a unit.
        alpha = self.damping * t / self.mass
        kappa = self.hand * t * t / self.mass
        rate = np.array([[0.0, 1.0, 0.0], [-kappa, -alpha, 1.0], [0.0, 0.0, 0.0]])
        units = [[t, t * t / self.mass], [1.0, t / self.mass]]
        return expm(rate)[:2, 1:] * units


def loop_matrix(plant: Plant, stiffness: float, delay_ticks: int = 0) -> NDArray[np.float64]:
    """(2 + d, 2 + d) one tick of plant and sampled spring F_k = -K x_{k-d}.

    The state is (x, v) and the d older positions, the youngest first. `stiffness` is K [N/m].
    """
    (xv, xf), (vv, vf) = plant.transition()
    d = delay_ticks
    matrix = np.zeros((2 + d, 2 + d))
    matrix[0, :2] = 1.0 - xf * plant.hand, xv
    matrix[1, :2] = -vf * plant.hand, vv

    # The spring acts on the position of d ticks ago, which is the last one of the state.
    sampled = 1 + d if d > 0 else 0
    matrix[0, sampled] -= xf * stiffness
    matrix[1, sampled] -= vf * stiffness

    # The positions move on by one place.
    if d > 0:
        matrix[2, 0] = 1.0
        matrix[3:, 2:-1] = np.eye(d - 1)
    return matrix


def spectral_radius(plant: Plant, stiffness: float, delay_ticks: int = 0) -> float:
    """The largest absolute eigenvalue of one tick. The loop is stable below 1."""
    return float(np.abs(np.linalg.eigvals(loop_matrix(plant, stiffness, delay_ticks))).max())


def linear_bound(plant: Plant, delay_ticks: int = 0) -> float:
    """The bound K < b / (T/2 + d T) [N/m], which is of first order in T (Gil et al. 2004)."""
    return plant.damping / (plant.period * (0.5 + delay_ticks))


def exact_bound(plant: Plant, delay_ticks: int = 0, hand_share: float = 0.0) -> float:
    """The K [N/m] at which the spectral radius reaches 1; 0 without damping.

    The relative error is at most 1e-10, or 2e-13 m / (b T) where that is more.

    Parameters
    ----------
    hand_share
        k_h / K of a hand whose spring is scaled with K. With 0 the plant's own hand holds the mass.

    Raises
    ------
    SettingError
        A decay b T / m of a tick outside `MIN_DECAY` to `MAX_DECAY`.
    """
    if plant.damping == 0.0:
        return 0.0
    decay = plant.damping * plant.period / plant.mass
    number("damping * period / mass", decay, "", least=MIN_DECAY, most=MAX_DECAY)

    def is_stable(stiffness: float) -> bool:
        hand = hand_share * stiffness
        if hand == 0.0:
            hand = plant.hand
        held = Plant(plant.mass, plant.damping, plant.period, hand)
        return spectral_radius(held, stiffness, delay_ticks) < STABLE_RADIUS

    # A stable and an unstable K around the linear bound, then the edge between them.
    low = linear_bound(plant, delay_ticks)
    high = low
    while not is_stable(low):
        low /= 2
    while is_stable(high):
        high *= 2
    while high - low > BOUND_RESOLUTION * high:
        middle = math.sqrt(low * high)
        if is_stable(middle):
            low = middle
        else:
            high = middle
    return low
