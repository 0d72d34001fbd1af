"""What theory says of a mass that a sampled spring holds: exact discretisation and bounds on K.

The plant is a mass with viscous damping, and the spring of a hand where a scene needs one:
m ẍ + b ẋ + k_h x = F. The robot holds F over each tick (zero-order hold), so the motion from tick
to tick is a matrix exponential and no integrator's error can pass for an instability. The docs
(stability.md) derive the bounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.parameters import number
from vfplan.robot import Robot

LEAST_DECAY, MOST_DECAY = 1e-9, 1e12  # b T / m: less and more than float64 can tell from 0 and inf


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
        """A robot's moving mass, or a verdict's, as theory sees it: no friction, no limits."""
        return cls(robot.mass_kg, robot.damping_n_s_per_m, 1 / robot.rate_hz, hand)

    def transition(self, t: float | None = None) -> NDArray[np.float64]:
        """(2, 2) the exact motion over t [s] (one tick when `None`) from x = 0.

        Rows: displacement [m] and velocity [m/s] after t; columns: velocity before [m/s] and the
        net force at x [N] (held force less k_h x), both as they stood at the beginning.
        """
        from scipy.linalg import expm

        t = self.period if t is None else t
        alpha, kappa = self.damping * t / self.mass, self.hand * t * t / self.mass
        # In units of t: y' = w, w' = r - alpha w - kappa y, r' = 0; every entry is then pure.
        pure = expm(np.array([[0.0, 1.0, 0.0], [-kappa, -alpha, 1.0], [0.0, 0.0, 0.0]]))
        return pure[:2, 1:] * [[t, t * t / self.mass], [1.0, t / self.mass]]


def closed_loop(plant: Plant, stiffness: float, delay_ticks: int = 0) -> NDArray[np.float64]:
    """(2 + d, 2 + d) one tick of plant and sampled spring F_k = -K x_{k-d}.

    The state is (x, v) and the d older positions, nearest first.
    """
    (xv, xf), (vv, vf) = plant.transition()
    d, k_h = delay_ticks, plant.hand
    matrix = np.zeros((2 + d, 2 + d))
    matrix[0, :2] = 1.0 - xf * k_h, xv
    matrix[1, :2] = -vf * k_h, vv
    read = 0 if d == 0 else 1 + d  # where the position that acts now is kept
    matrix[0, read] -= xf * stiffness
    matrix[1, read] -= vf * stiffness
    if d:
        matrix[2, 0] = 1.0
        matrix[3:, 2:-1] = np.eye(d - 1)
    return matrix


def spectral_radius(plant: Plant, stiffness: float, delay_ticks: int = 0) -> float:
    """The largest |eigenvalue| of one tick: the loop is stable below 1."""
    return float(np.abs(np.linalg.eigvals(closed_loop(plant, stiffness, delay_ticks))).max())


def linear_bound(plant: Plant, delay_ticks: int = 0) -> float:
    """K < b / (T/2 + t_d) [N/m], t_d = d T: first order in T (Gil et al. 2004)."""
    return plant.damping / (plant.period * (0.5 + delay_ticks))


def exact_bound(plant: Plant, delay_ticks: int = 0, hand_share: float = 0.0) -> float:
    """The K [N/m] at which the spectral radius reaches 1; 0 without damping.

    To a relative 1e-10, or 2e-13 m / (b T) if that is more: so much is left of 1 - radius.

    Parameters
    ----------
    hand_share
        k_h / K where the hand's spring is scaled with K; 0 for the plant's own.

    Raises
    ------
    SettingError
        A decay b T / m a tick that float64 cannot tell from none, or whose exponential overflows.
    """
    if plant.damping == 0.0:
        return 0.0
    decay = plant.damping * plant.period / plant.mass
    number("damping * period / mass", decay, "", least=LEAST_DECAY, most=MOST_DECAY)

    def holds(k: float) -> bool:
        held = Plant(plant.mass, plant.damping, plant.period, hand_share * k or plant.hand)
        # 1 - rho falls to rounding long before K falls to 0, hence the margin of one part in 1e13.
        return spectral_radius(held, k, delay_ticks) < 1.0 - 1e-13

    low = high = linear_bound(plant, delay_ticks)
    while not holds(low):
        low /= 2
    while holds(high):
        high *= 2
    while high - low > 1e-10 * high:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
