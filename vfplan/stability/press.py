"""A press at a given K: what the hand feels as its weight comes onto the wall and stays there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vfplan.engine.checks import Vector
from vfplan.robot import Robot
from vfplan.stability.contacts import Contact
from vfplan.stability.largest import pressing_hand
from vfplan.stability.loop import Engine, Hand, simulate

RESTING = 0.05  # of the depth: within it the mass counts as at rest
MOST_TICKS = 10_000


@dataclass(frozen=True)
class Press:
    """What a press did."""

    energy_j: float  # net work of the fixture on the hand's mass over the press, + out [J]
    limit_cycle_m: float  # peak to peak of the position along the push over the last quarter [m]
    # Until the position stays within 5 % of its final depth [s]; `None` when it does not
    rest_s: float | None
    overshoot: float  # largest depth over the final depth, less 1
    limited_ticks: int | None = None  # ticks in which a force limit acted; `None` without limits


def press(contact: Contact, robot: Robot, engine: Engine, stiffness: float) -> Press:
    """From rest at the first touch, under a constant push: a step response.

    engine: of stiffness 1 N/m, on the contact's cloud
    stiffness: K [N/m]
    """
    hand: Hand = pressing_hand(contact, stiffness)
    inward = contact.inward / np.linalg.norm(contact.inward)
    engine.reset(contact.start)
    ticks = press_length(robot, stiffness)
    start = contact.touch - 1e-6 * contact.radius * inward
    motion = simulate(engine, robot, hand, stiffness, start, np.zeros(3), ticks)
    depth: Vector = (motion.x - contact.touch) @ inward
    quarter = len(depth) // 4
    final = float(depth[-quarter:].mean())
    astray = np.flatnonzero(np.abs(depth - final) > RESTING * abs(final))
    settled = int(astray[-1]) + 1 if astray.size else 0
    work = (motion.held[:-1] * np.diff(motion.x, axis=0)).sum()
    return Press(
        energy_j=float(work),
        limit_cycle_m=float(np.ptp(depth[-quarter:])),
        rest_s=settled / robot.rate_hz if settled < len(depth) - quarter else None,
        overshoot=float(depth.max() / final - 1.0) if final > 0 else 0.0,
        limited_ticks=motion.limited_ticks,
    )


def press_length(robot: Robot, stiffness: float) -> int:
    """Ticks for the step response to die down: nine time constants of the slower mode."""
    m, b = robot.mass_kg, robot.damping_n_s_per_m
    slow = 2 * m / b if b * b < 4 * m * stiffness else b / stiffness  # [s]; b > 0 is the caller's
    return int(min(max(9 * slow * robot.rate_hz, 400), MOST_TICKS))
