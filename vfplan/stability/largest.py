"""The largest stable stiffness, found by bisection on an energy criterion.

A mass at rest against the fixture is struck lightly. The energy above rest (kinetic, spring and
hand together) dies down in a stable loop and grows in an unstable one. The loop counts as stable
when the mean energy over the last eighth of the run is neither above the mean over the first
eighth nor above twice the energy of the blow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from vfplan.engine.parameters import Rule
from vfplan.engine.proxy import ProxyEngine
from vfplan.fixture import Pieces
from vfplan.robot import Robot
from vfplan.stability.contacts import Contact
from vfplan.stability.loop import Engine, SimulatedHand, run_until_still, simulate
from vfplan.stability.theory import Plant, exact_bound, spectral_radius

PRESS_DEPTH = 0.05
"""Depth of the hand's press, as a share of R. The contact stays closed under the blow."""

BLOW = 0.2
"""Way that the blow carries the mass, as a share of the depth of the press."""

HAND_SHARE = 0.2
"""Stiffness of a hand that also holds the mass sideways, as a share of K."""

RESOLUTION = 2.5e-3
"""Width, relative to K, at which the bisection ends. A K below this share of the bound is none."""

FIRST_GUESS = 0.61
"""The first K that is tried, as a share of the exact bound.

The bisection halves and doubles it, so that it never tries the bound itself. An agreement with
theory is then found and not put in.
"""

MAX_RATIO = 16.0
"""Largest K that is tried, over the exact bound. A contact that bears more is far from it."""

MAX_TICKS = 20_000
"""Longest run of one trial or press [ticks], 20 s at 1 kHz."""


@dataclass(frozen=True)
class LargestStiffness:
    """The largest stable stiffness of one contact.

    Parameters
    ----------
    measured
        The largest K that was stable, within `RESOLUTION` [N/m].
    exact
        The K at which the spectral radius of plant and spring reaches 1 [N/m].
    is_above_search
        Whether the loop was still stable at `MAX_RATIO` times `exact`, where the search ended.
    """

    measured: float
    exact: float
    is_above_search: bool = False

    @property
    def ratio(self) -> float:
        """The measured K over the exact bound."""
        return self.measured / self.exact


class EngineMaker:
    """Makes the engines of one rule, and gives the last one again on the same cloud.

    Parameters
    ----------
    rule
        The rule of the engines.
    band
        Their band [m]; `None`: the engine chooses it.
    """

    def __init__(self, rule: Rule, band: float | None = None) -> None:
        self.rule = rule
        self.band = band
        self.contact: Contact | None = None
        self.engine: ProxyEngine | None = None

    def __call__(self, contact: Contact) -> ProxyEngine:
        """An engine of 1 N/m on the contact's cloud."""
        if self.contact is None or self.contact.points is not contact.points:
            self.engine = engine_for(contact, self.rule, self.band)
            self.contact = contact
        return self.engine


def engine_for(contact: Contact, rule: Rule, band: float | None = None) -> ProxyEngine:
    """An engine of 1 N/m on the contact's cloud, or on its lines and arcs, or triangles."""
    if rule != "exact":
        return ProxyEngine(
            contact.points,
            contact.radius,
            band,
            stiffness=1.0,
            rule=rule,
            ignore_axis=contact.ignore_axis,
        )
    if isinstance(contact.exact_shape, Pieces):
        return ProxyEngine.along(
            contact.exact_shape, contact.radius, stiffness=1.0, ignore_axis=contact.ignore_axis
        )
    return ProxyEngine.on(contact.points, contact.exact_shape, contact.radius, stiffness=1.0)


def largest_stiffness(contact: Contact, robot: Robot, engine: Engine) -> LargestStiffness:
    """Bisect for the largest K at which a struck mass comes to rest.

    Parameters
    ----------
    engine
        An engine of stiffness 1 N/m on the contact's cloud.
    """
    hand_share = HAND_SHARE if contact.needs_spring else 0.0
    exact = exact_bound(Plant.of(robot), robot.delay_ticks, hand_share)
    if exact == 0.0:
        return LargestStiffness(0.0, 0.0)
    ticks = run_length(robot, exact)
    low, high = bracket(contact, robot, engine, exact, ticks)
    if high == 0.0:
        return LargestStiffness(0.0, exact)
    if math.isinf(high):
        return LargestStiffness(low, exact, is_above_search=True)
    while high > (1 + RESOLUTION) * low:
        middle = math.sqrt(low * high)
        if is_stable(contact, robot, engine, middle, ticks):
            low = middle
        else:
            high = middle
    return LargestStiffness(low, exact)


def bracket(
    contact: Contact, robot: Robot, engine: Engine, exact: float, ticks: int
) -> tuple[float, float]:
    """A stable K and an unstable one, a factor of 2 apart [N/m].

    The second is infinite where no K up to `MAX_RATIO` is unstable. Both are 0 where none down to
    `RESOLUTION` is stable.
    """
    low = FIRST_GUESS * exact
    if is_stable(contact, robot, engine, low, ticks):
        while low < MAX_RATIO * exact:
            if not is_stable(contact, robot, engine, 2 * low, ticks):
                return low, 2 * low
            low *= 2
        return low, math.inf
    while low > RESOLUTION * exact:
        low /= 2
        if is_stable(contact, robot, engine, low, ticks):
            return low, 2 * low
    return 0.0, 0.0


def run_length(robot: Robot, exact: float) -> int:
    """Ticks in which a K half a percent above the bound raises the energy by five percent.

    At least 16 periods of the oscillation and 400 ticks, and at most `MAX_TICKS`.
    """
    growth = spectral_radius(Plant.of(robot), 1.005 * exact, robot.delay_ticks)
    ticks = math.inf
    if growth > 1:
        # The energy grows with the square of the motion.
        ticks = math.log(1.05) / (2 * math.log(growth))
    period = 2 * math.pi * math.sqrt(robot.mass_kg / exact) * robot.rate_hz
    return int(min(max(ticks, 16 * period, 400), MAX_TICKS))


def is_stable(contact: Contact, robot: Robot, engine: Engine, stiffness: float, ticks: int) -> bool:
    """Whether the energy criterion of this module holds at one K [N/m]."""
    hand = pressing_hand(contact, stiffness)
    still = run_until_still(engine, hand, stiffness, contact.start)

    # Strike the mass along the push.
    amplitude = BLOW * PRESS_DEPTH * contact.radius
    speed = amplitude * math.sqrt((stiffness + hand.stiffness) / robot.mass_kg)
    blow_energy = 0.5 * robot.mass_kg * speed * speed
    velocity = speed * contact.push_direction
    motion = simulate(engine, robot, hand, stiffness, still, velocity, ticks)

    # Energy above that of the pressed mass at rest.
    rest_energy = motion.energy[0] - blow_energy
    energy = motion.energy - rest_energy
    eighth = ticks // 8
    first = energy[:eighth].mean()
    last = energy[-eighth:].mean()
    return bool(last <= first and last <= 2 * blow_energy)


def pressing_hand(contact: Contact, stiffness: float) -> SimulatedHand:
    """A hand that presses `PRESS_DEPTH` R deep into each wall at this K [N/m]."""
    press = PRESS_DEPTH * contact.radius * contact.inward
    hand_stiffness = HAND_SHARE * stiffness if contact.needs_spring else 0.0
    return SimulatedHand(stiffness * press, hand_stiffness, contact.touch + press)
