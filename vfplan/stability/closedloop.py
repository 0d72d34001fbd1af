"""The closed loop over scenes of contact: one row a scene and rule."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from vfplan.engine.parameters import Rule
from vfplan.fixture import Fixture
from vfplan.robot import Robot
from vfplan.stability import contacts
from vfplan.stability.contacts import Contact
from vfplan.stability.largest import (
    Largest,
    engine_for,
    is_stable,
    largest_stiffness,
    run_length,
)
from vfplan.stability.loop import Engine
from vfplan.stability.press import press
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
    """The row of a named scene, or of a bundle's own points, or lines and arcs.

    stiffness: K [N/m] of the press
    """
    scene, places, band = contacts.met(on, rule)
    case = f"closed-loop/{scene}/{rule}"
    if robot.damping_n_s_per_m == 0.0:
        detail = "without damping no sampled spring is stable, however soft"
        return [Row(case, "fail", detail, 0.0, 0.0, "N/m", {"scene": scene, "rule": rule})]
    found = weakest(places, robot, lambda place: engine_for(place, rule, band))
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
        "energy_j": felt.energy_j,
        "limit_cycle_m": felt.limit_cycle_m,
        "rest_s": felt.rest_s,
        "overshoot": felt.overshoot,
    }
    if felt.limited_ticks is not None:
        values["limited_ticks"] = felt.limited_ticks
    share = 1 - FLAT_TOLERANCE if scene == "flat" else ELSEWHERE
    limit = share * largest.exact
    return [Row(case, verdict(good, rule), detail, limit, largest.measured, "N/m", values)]
