"""The stability map: the largest stable K on a flat wall over damping, rate and delay."""

from __future__ import annotations

from itertools import product

from vfplan.engine.parameters import Rule
from vfplan.robot import Robot
from vfplan.stability.closedloop import FLAT_TOLERANCE
from vfplan.stability.contacts import patch
from vfplan.stability.largest import engine_for, largest_stiffness, plant_of
from vfplan.stability.rows import Row, verdict
from vfplan.stability.theory import linear_bound

# Damping [N·s/m] and rate [Hz] of the points measured, for each delay in ticks.
PLACES = ((2.0, 500.0), (5.0, 1000.0), (10.0, 2000.0), (40.0, 2000.0), (50.0, 8000.0))
DELAYS = (0, 1, 3)


def chart(rule: Rule, mass: float = 1.0) -> list[Row]:
    """One row a place of the map."""
    contact = patch()
    engine = engine_for(contact, rule)
    rows = []
    for delay, (damping, rate) in product(DELAYS, PLACES):
        robot = Robot("chart", mass, damping, rate, delay)
        found = largest_stiffness(contact, robot, engine)
        values = {
            "rule": rule,
            "damping_n_s_per_m": damping,
            "rate_hz": rate,
            "delay_ticks": delay,
            "k_exact_n_per_m": found.exact,
            "k_linear_n_per_m": linear_bound(plant_of(robot), delay),
            "ratio": found.ratio,
        }
        rows.append(
            Row(
                case=f"map/b={damping:g} rate={rate:g} delay={delay}/{rule}",
                outcome=verdict(abs(found.ratio - 1) <= FLAT_TOLERANCE, rule),
                detail=f"largest stable K {found.measured:.0f} N/m, {found.ratio:.4f} of the exact"
                f" bound {found.exact:.0f}",
                limit=(1 - FLAT_TOLERANCE) * found.exact,
                measured=found.measured,
                unit="N/m on the map",
                values=values,
            )
        )
    return rows
