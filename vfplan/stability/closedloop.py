"""The closed loop: a row a scene of contact and rule, and the press in it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass

import numpy as np

from vfplan.engine.parameters import Rule, Vector
from vfplan.fixture import Fixture
from vfplan.robot import Robot
from vfplan.stability import contacts
from vfplan.stability.contacts import Contact
from vfplan.stability.largest import (
    Largest,
    engines_for,
    is_stable,
    largest_stiffness,
    pressing_hand,
    run_length,
)
from vfplan.stability.loop import Engine, Hand, simulate
from vfplan.stability.rows import Row, verdict

FLAT_TOLERANCE = 0.02  # the flat wall's measured K against the exact bound
ELSEWHERE = 0.95  # of the exact bound, at least


def scenes_for(fixture: Fixture | None) -> tuple[list[str], dict[str, str]]:
    """The scenes of contact that a fixture can meet, and why the others are left out."""
    if fixture is None:
        return list(contacts.SCENES), {}
    out = {"omega": "another outline; the bundle's own points are run"}
    if len(fixture.points) > 2:
        out["point"] = f"the cloud has {len(fixture.points)} points"
    else:
        walls = ("flat", "convex", "corner", "three-walls", "channel", "double-sheet")
        out |= dict.fromkeys(walls, f"no walls in a cloud of {len(fixture.points)}")
    if fixture.ignore_axis is not None:
        reason = "the fixture is endless along its ignored axis"
        out |= dict.fromkeys(("three-walls", "double-sheet", "point"), reason)
    return [name for name in contacts.SCENES if name not in out], out


def weakest(
    places: Iterable[Contact], robot: Robot, make: Callable[[Contact], Engine]
) -> tuple[Largest, Contact, Engine, int] | None:
    """The place that bears the least K, its engine, and the number of places; `None` without one.

    A place that is stable at the least K so far is not bisected.
    """
    found, count = None, 0
    for count, place in enumerate(places, 1):  # noqa: B007 - the count goes out
        engine = make(place)
        if found is not None:
            largest = found[0]
            ticks = run_length(robot, largest.exact)
            if is_stable(place, robot, engine, largest.measured, ticks):
                continue
        largest = largest_stiffness(place, robot, engine)
        if found is None or largest.measured < found[0].measured:
            found = largest, place, engine
    return None if found is None else (*found, count)


def closed_loop(on: Fixture | str, rule: Rule, robot: Robot, stiffness: float) -> list[Row]:
    """The row of a named scene, or of a bundle's own points, lines and arcs, or triangles.

    stiffness: K [N/m] of the press
    """
    scene, places, band = contacts.met(on, rule)
    case = f"closed-loop/{scene}/{rule}"
    if robot.damping_n_s_per_m == 0.0:
        detail = "without damping no sampled spring is stable, however soft"
        return [Row(case, "fail", detail, 0.0, 0.0, "N/m", {"scene": scene, "rule": rule})]
    found = weakest(places, robot, engines_for(rule, band))
    if found is None:
        detail = "no ball of the contact radius fits beside any point tried"
        return [Row(case, "fail", detail, unit="N/m", values={"places": 0})]
    largest, place, engine, count = found
    felt = press(place, robot, engine, min(stiffness, 0.5 * largest.measured))
    good = largest.ratio >= ELSEWHERE
    if scene == "flat":
        good = abs(largest.ratio - 1) <= FLAT_TOLERANCE or largest.beyond
    more = " or more" if largest.beyond else ""
    rest = "no rest" if felt.rest_s is None else f"rest in {felt.rest_s:.2f} s"
    detail = (
        f"largest stable K {largest.measured:.0f} N/m{more}, {largest.ratio:.3f} of the exact bound"
        f"; pressed: overshoot {felt.overshoot:.2f}, {rest}, limit cycle"
        f" {felt.limit_cycle_m * 1e6:.2g} µm, {felt.energy_j * 1e6:.3g} µJ to the hand"
    )
    values = {
        "scene": scene,
        "rule": rule,
        "k_exact_n_per_m": largest.exact,
        "ratio": largest.ratio,
        "places": count,
        **asdict(felt),
    }
    if felt.limited_ticks is None:
        del values["limited_ticks"]
    share = 1 - FLAT_TOLERANCE if scene == "flat" else ELSEWHERE
    limit = share * largest.exact
    return [Row(case, verdict(good, rule), detail, limit, largest.measured, "N/m", values)]


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
