"""The closed loop: the largest stable K of a scene and rule, and a press at the K in question."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass

import numpy as np

from vfplan.engine.parameters import Rule
from vfplan.fixture import Fixture
from vfplan.robot import Robot
from vfplan.stability import contacts
from vfplan.stability.case_result import CaseResult, outcome_of
from vfplan.stability.contacts import Contact
from vfplan.stability.largest import (
    MAX_TICKS,
    EngineMaker,
    LargestStiffness,
    is_stable,
    largest_stiffness,
    pressing_hand,
    run_length,
)
from vfplan.stability.loop import Engine, simulate

FLAT_TOLERANCE = 0.02
"""Largest difference of a flat wall's largest stable K from the exact bound, relative to it."""

MIN_RATIO = 0.95
"""Smallest share of the exact bound that any other contact must bear."""

REST_TOLERANCE = 0.05
"""Share of the final depth within which a pressed mass counts as at rest."""


@dataclass(frozen=True)
class Press:
    """What a press did.

    Parameters
    ----------
    energy_j
        Net work of the fixture on the mass over the press [J]; above 0 the mass gained energy.
    limit_cycle_m
        Peak to peak of the position along the push over the last quarter [m].
    rest_s
        Time until the position stays within `REST_TOLERANCE` of its final depth [s]; `None` where
        it does not before the last quarter.
    overshoot
        The largest depth over the final depth, less 1.
    limited_ticks
        As `LoopMotion.limited_ticks`.
    """

    energy_j: float
    limit_cycle_m: float
    rest_s: float | None
    overshoot: float
    limited_ticks: int | None = None


def scenes_for(fixture: Fixture | None) -> tuple[list[str], dict[str, str]]:
    """The scenes of contact that a fixture can meet, and why each of the others is left out."""
    if fixture is None:
        return list(contacts.SCENES), {}
    skipped = {"omega": "another outline; the bundle's own points are run"}
    count = len(fixture.points)
    if count > 2:
        skipped["point"] = f"the cloud has {count} points"
    else:
        for name in ("flat", "convex", "corner", "three-walls", "channel", "double-sheet"):
            skipped[name] = f"no walls in a cloud of {count}"
    if fixture.ignore_axis is not None:
        for name in ("three-walls", "double-sheet", "point"):
            skipped[name] = "the fixture is endless along its ignored axis"
    return [name for name in contacts.SCENES if name not in skipped], skipped


def closed_loop_case(
    on: Fixture | str, rule: Rule, robot: Robot, stiffness: float
) -> list[CaseResult]:
    """The result of a named scene, or of a bundle's own points, lines and arcs, or triangles.

    Parameters
    ----------
    stiffness
        K of the press [N/m]. A K above half of the largest stable one is lowered to that half.
    """
    scene, places, band = contacts.contacts_on(on, rule)
    case = f"closed-loop/{scene}/{rule}"
    if robot.damping_n_s_per_m == 0.0:
        detail = "without damping no sampled spring is stable, however soft"
        return [CaseResult(case, "fail", detail, 0.0, 0.0, "N/m", {"scene": scene, "rule": rule})]
    weakest = weakest_contact(places, robot, EngineMaker(rule, band))
    if weakest is None:
        detail = "no ball of the contact radius fits beside any point tried"
        return [CaseResult(case, "fail", detail, unit="N/m", values={"places": 0})]
    largest = weakest.largest
    pressed = press(weakest.contact, robot, weakest.engine, min(stiffness, 0.5 * largest.measured))

    min_ratio = MIN_RATIO
    is_good = largest.ratio >= MIN_RATIO
    if scene == "flat":
        min_ratio = 1 - FLAT_TOLERANCE
        is_good = abs(largest.ratio - 1) <= FLAT_TOLERANCE or largest.is_above_search
    values = {
        "scene": scene,
        "rule": rule,
        "k_exact_n_per_m": largest.exact,
        "ratio": largest.ratio,
        "places": weakest.places,
        **asdict(pressed),
    }
    if pressed.limited_ticks is None:
        del values["limited_ticks"]
    return [
        CaseResult(
            case,
            outcome_of(is_good, rule),
            closed_loop_detail(largest, pressed),
            min_ratio * largest.exact,
            largest.measured,
            "N/m",
            values,
        )
    ]


def closed_loop_detail(largest: LargestStiffness, pressed: Press) -> str:
    """What the search and the press found, in words."""
    or_more = " or more" if largest.is_above_search else ""
    rest = f"rest in {pressed.rest_s:.2f} s" if pressed.rest_s is not None else "no rest"
    return (
        f"largest stable K {largest.measured:.0f} N/m{or_more}, {largest.ratio:.3f} of the exact "
        f"bound; pressed: overshoot {pressed.overshoot:.2f}, {rest}, limit cycle "
        f"{pressed.limit_cycle_m * 1e6:.2g} µm, {pressed.energy_j * 1e6:.3g} µJ to the hand"
    )


@dataclass(frozen=True, eq=False)
class WeakestContact:
    """The contact that bears the least K, its engine, and how many contacts were tried."""

    largest: LargestStiffness
    contact: Contact
    engine: Engine
    places: int


def weakest_contact(
    places: Iterable[Contact], robot: Robot, make_engine: EngineMaker
) -> WeakestContact | None:
    """The contact that bears the least K; `None` without any contact.

    A contact that is stable at the least K so far is not bisected.
    """
    weakest = None
    count = 0
    for contact in places:
        count += 1
        engine = make_engine(contact)
        if weakest is not None:
            lowest = weakest.largest
            ticks = run_length(robot, lowest.exact)
            if is_stable(contact, robot, engine, lowest.measured, ticks):
                continue
        largest = largest_stiffness(contact, robot, engine)
        if weakest is None or largest.measured < weakest.largest.measured:
            weakest = WeakestContact(largest, contact, engine, count)
    if weakest is None:
        return None
    return WeakestContact(weakest.largest, weakest.contact, weakest.engine, count)


def press(contact: Contact, robot: Robot, engine: Engine, stiffness: float) -> Press:
    """Press with a constant force, from rest just inside the first touch: a step response.

    Parameters
    ----------
    engine
        An engine of stiffness 1 N/m on the contact's cloud.
    stiffness
        K [N/m].
    """
    hand = pressing_hand(contact, stiffness)
    inward = contact.push_direction
    engine.reset(contact.start)
    start = contact.touch - 1e-6 * contact.radius * inward
    ticks = press_length(robot, stiffness)
    motion = simulate(engine, robot, hand, stiffness, start, np.zeros(3), ticks)

    depth = (motion.x - contact.touch) @ inward
    quarter = len(depth) // 4
    final_depth = float(depth[-quarter:].mean())
    moving = np.flatnonzero(np.abs(depth - final_depth) > REST_TOLERANCE * abs(final_depth))
    rest_tick = int(moving[-1]) + 1 if moving.size > 0 else 0
    rest_s = rest_tick / robot.rate_hz if rest_tick < len(depth) - quarter else None
    overshoot = float(depth.max() / final_depth - 1.0) if final_depth > 0 else 0.0
    work = (motion.held_force[:-1] * np.diff(motion.x, axis=0)).sum()
    return Press(
        energy_j=float(work),
        limit_cycle_m=float(np.ptp(depth[-quarter:])),
        rest_s=rest_s,
        overshoot=overshoot,
        limited_ticks=motion.limited_ticks,
    )


def press_length(robot: Robot, stiffness: float) -> int:
    """Ticks in which the step response dies down: nine time constants of the slower mode.

    At least 400 and at most `MAX_TICKS`. The robot's damping must be above 0.
    """
    mass = robot.mass_kg
    damping = robot.damping_n_s_per_m
    if damping * damping < 4 * mass * stiffness:
        time_constant = 2 * mass / damping
    else:
        time_constant = damping / stiffness
    return int(min(max(9 * time_constant * robot.rate_hz, 400), MAX_TICKS))
