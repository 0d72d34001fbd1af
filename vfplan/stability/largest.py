"""The largest stable stiffness, found by bisection on an energy criterion.

A mass at rest against the fixture is struck lightly. The energy above rest (kinetic, spring and
hand together) dies down in a stable loop and grows in an unstable one: the loop counts as stable
when the mean over the last eighth of the run is no more than the mean over the first eighth and
than twice what the blow brought in.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vfplan.engine.parameters import Rule, Vector
from vfplan.engine.proxy import ProxyEngine
from vfplan.fixture import Pieces
from vfplan.robot import Robot
from vfplan.stability.contacts import Contact
from vfplan.stability.loop import Engine, Hand, settle, simulate
from vfplan.stability.theory import Plant, exact_bound, spectral_radius

DEPTH = 0.05  # how deep the hand presses, in R
BLOW = 0.2  # how far the blow carries the mass, in depths
HAND = 0.2  # stiffness of a hand that also holds sideways, in K
RESOLUTION = 2.5e-3  # of the bisection, relative
REACH = 16.0  # how far above theory the search goes


@dataclass(frozen=True)
class Largest:
    """The largest stable stiffness of one contact."""

    measured: float  # [N/m]; the last K that was stable, within `RESOLUTION`
    exact: float  # [N/m], spectral radius of plant and spring
    beyond: bool = False  # still stable at `REACH` times `exact`, where the search ended

    @property
    def ratio(self) -> float:
        """measured / exact."""
        return self.measured / self.exact


def engine_for(contact: Contact, rule: Rule, band: float | None = None) -> ProxyEngine:
    """An engine of 1 N/m on the contact's cloud, or on its lines and arcs, or triangles."""
    radius, settings = contact.radius, {"stiffness": 1.0, "ignore_axis": contact.ignore_axis}
    if rule == "exact" and isinstance(contact.exact, Pieces):
        return ProxyEngine.along(contact.exact, radius, **settings)
    if rule == "exact":
        return ProxyEngine.on(contact.points, contact.exact, radius, stiffness=1.0)
    return ProxyEngine(contact.points, radius, band, rule=rule, **settings)


def engines_for(rule: Rule, band: float | None = None) -> Callable[[Contact], ProxyEngine]:
    """`engine_for`, one engine for all contacts that follow each other on one cloud."""
    last: list[tuple[Vector, ProxyEngine]] = []

    def make(contact: Contact) -> ProxyEngine:
        if not last or last[0][0] is not contact.points:
            last[:] = [(contact.points, engine_for(contact, rule, band))]
        return last[0][1]

    return make


def largest_stiffness(contact: Contact, robot: Robot, engine: Engine) -> Largest:
    """Bisect for the largest K at which a struck mass comes to rest.

    engine: of stiffness 1 N/m, on the contact's cloud
    """
    share = HAND if contact.held else 0.0
    exact = exact_bound(Plant.of(robot), robot.delay_ticks, share)
    if exact == 0.0:
        return Largest(0.0, 0.0)
    ticks = run_length(robot, exact)
    low, high = _bracket(contact, robot, engine, exact, ticks)
    if math.isinf(high):
        return Largest(low, exact, beyond=True)
    while high > (1 + RESOLUTION) * low:
        middle = math.sqrt(low * high)
        if is_stable(contact, robot, engine, middle, ticks):
            low = middle
        else:
            high = middle
    return Largest(low, exact)


def _bracket(
    contact: Contact, robot: Robot, engine: Engine, exact: float, ticks: int
) -> tuple[float, float]:
    """A stable K and an unstable one, a factor of 2 apart; infinite where none is unstable.

    The first guess is off the theory's bound, so that agreement is found and not put in.
    """
    low = 0.61 * exact
    if is_stable(contact, robot, engine, low, ticks):
        while low < REACH * exact:
            if not is_stable(contact, robot, engine, 2 * low, ticks):
                return low, 2 * low
            low *= 2
        return low, math.inf
    while low > 1e-3 * exact:
        low /= 2
        if is_stable(contact, robot, engine, low, ticks):
            return low, 2 * low
    return 0.0, 0.0


def run_length(robot: Robot, exact: float) -> int:
    """Ticks in which a K half a percent too large raises the energy by five percent."""
    grows = spectral_radius(Plant.of(robot), 1.005 * exact, robot.delay_ticks)
    ticks = math.log(1.05) / (2 * math.log(grows)) if grows > 1 else math.inf
    period = 2 * math.pi * math.sqrt(robot.mass_kg / exact) * robot.rate_hz
    return int(min(max(ticks, 16 * period, 400), 20_000))


def is_stable(contact: Contact, robot: Robot, engine: Engine, stiffness: float, ticks: int) -> bool:
    """The energy criterion of this module at one K [N/m]."""
    hand = pressing_hand(contact, stiffness)
    rest = settle(engine, hand, stiffness, contact.start)
    inward = contact.inward / np.linalg.norm(contact.inward)
    total = stiffness + hand.stiffness
    blow = BLOW * DEPTH * contact.radius * math.sqrt(total / robot.mass_kg)
    motion = simulate(engine, robot, hand, stiffness, rest, blow * inward, ticks)
    brought = 0.5 * robot.mass_kg * blow * blow
    above = motion.energy - (motion.energy[0] - brought)
    first, last = above[: ticks // 8].mean(), above[-(ticks // 8) :].mean()
    return bool(last <= first and last <= 2 * brought)


def pressing_hand(contact: Contact, stiffness: float) -> Hand:
    """A hand that presses `DEPTH` R deep into each wall at this K [N/m]."""
    depth = DEPTH * contact.radius * contact.inward
    share = HAND if contact.held else 0.0
    return Hand(stiffness * depth, share * stiffness, contact.touch + depth)
