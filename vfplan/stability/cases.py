"""Extreme motion of the HIP, and passivity, on what a bundle renders or on a flat patch.

Extreme motion: at rest for ever, at any speed and rate, by denormals, with no number, and for 10^8
ticks. Each case was written with its limit before it was run. Extreme clouds and settings, which no
bundle changes, are tests (tests/engine/test_extremes.py).

Passivity: over a closed HIP cycle, a fixture may not give more than sampling lets it. With
U = ½ (p - x)ᵀ K (p - x) and a proxy that is never farther from the new HIP than the old proxy was,
each tick gives at most F_k·Δx <= U_k - U_{k+1} + ½ Δxᵀ K Δx. Over a cycle,

    W <= U_0 - U_N + ½ Σ Δxᵀ K Δx.

A proxy that recedes, farther from the new HIP than the old proxy was, puts energy in. The robust
rule guarantees that it never recedes by more than the band. docs/stability.md has the derivation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from vfplan.engine.parameters import Rule, Vector, check_axis
from vfplan.engine.proxy import ProxyEngine, Status, Trace, best_rule
from vfplan.fixture import Fixture, Pieces
from vfplan.geometry.lines import flattened, length_of, plane, row_lengths
from vfplan.stability import contacts
from vfplan.stability.closed_loop import engine_for
from vfplan.stability.contacts import RADIUS, ROUNDING_M, CaseResult, Contact, outcome_of

# Number of ticks that the engine is given at once, so that a long run needs little memory.
BLOCK_TICKS = 100_000

# Length of the long runs [ticks], 28 hours at 1 kHz.
LONG_TICKS = 1000 * BLOCK_TICKS

# Half of the width of the box in which the long walk stays [m]. It is more than R on either side,
# and in a wider box the walk may miss the cloud for many ticks.
WANDER_M = 1.6 * RADIUS

# Standard deviation of a step of the long walk along each axis [m], 0.1 m/s at 1 kHz.
WANDER_STEP_M = RADIUS / 50


@dataclass(frozen=True)
class ExtremeCase:
    """One case.

    Parameters
    ----------
    name
        Its name in the report, after "extreme/".
    expected
        What is expected, in words.
    measure
        Gives the figure that must be at most `limit`, for a contact and its engine, whose proxy
        starts clear of it.
    limit, unit
        The limit of the figure, and the unit of both.
    full
        Whether the case runs with `--full` only.
    at_origin
        Whether the touch is moved to 0, where the smallest steps change a coordinate.
    """

    name: str
    expected: str
    measure: Callable[[Contact, ProxyEngine], float]
    limit: float = ROUNDING_M
    unit: str = "m inside the free distance R - band"
    full: bool = False
    at_origin: bool = False


def run_extreme_cases(cases: list[ExtremeCase], fixture: Fixture | None = None) -> list[CaseResult]:
    """The results at the first place of the bundle that a ball can touch, or on the patch.

    None where no ball fits beside the bundle's cloud.
    """
    rule, band, places = "robust", None, [contacts.patch()]
    if fixture is not None:
        rule = best_rule(fixture)
        _, places, band = contacts.contacts_on(fixture, rule)
        if not places:
            return []
    results = []
    for case in cases:
        place = at_origin(places[0]) if case.at_origin else places[0]
        engine = engine_for(place, rule, band)
        engine.reset(place.start)
        figure = case.measure(place, engine)
        detail = f"expected {case.expected}; {figure:.3g} {case.unit}"
        # A figure that is no number fails.
        outcome = outcome_of(figure <= case.limit)
        name = f"extreme/{case.name}"
        results.append(CaseResult(name, outcome, detail, case.limit, figure, case.unit))
    return results


def at_origin(contact: Contact) -> Contact:
    """The contact with its touch at 0."""
    shape = contact.exact_shape
    if isinstance(shape, Pieces):
        shape = replace(shape, vertices=shape.vertices - contact.touch)
    points = contact.points - contact.touch
    return replace(contact, points=points, touch=np.zeros(3), exact_shape=shape)


def breach(engine: ProxyEngine, trace: Trace) -> float:
    """How far the proxy came inside R - band of what is rendered, at most over the ticks [m].

    It is 0 where the proxy never did. It is infinite where an answer is not finite, or where the
    path never touched the cloud and so showed nothing.
    """
    is_finite = all(np.isfinite(rows).all() for rows in (trace.proxy, trace.normal, trace.force))
    if not is_finite or not trace.force.any():
        return float("inf")
    least = engine.parameters.R - engine.parameters.band
    return max(0.0, least - float(engine.distance(trace.proxy).min()))


def surface_direction(contact: Contact) -> Vector:
    """(3,) a unit vector along the surface, across an ignored axis."""
    axis = check_axis(contact.ignore_axis)
    return plane(contact.normals[0])[1] if axis is None else np.cross(contact.normals[0], axis)


def random_path(contact: Contact, ticks: int) -> Vector:
    """(T, 3) a random HIP path around the touch, up to 2 R into the cloud and off it [m]."""
    s = np.linspace(0.0, 1.0, ticks)[:, None]
    wave = random_wave(np.random.default_rng(7), s, 11)
    ramp = np.minimum(1.0, 20 * s)  # The path leaves the free start smoothly.
    return contact.start + ramp * contact.radius * (0.8 * wave - 0.7 * contact.normals[0])


def random_wave(rng: np.random.Generator, s: Vector, harmonics: int) -> Vector:
    """(T, 3) a sum of harmonics of s (T, 1), of one period from 0 to 1, each of a random phase."""
    wave = np.zeros((len(s), 3))
    for k in range(1, harmonics + 1):
        phase = rng.uniform(0.0, 2 * np.pi, 3)
        wave += rng.normal(size=3) / k * np.cos(2 * np.pi * k * s + phase)
    return wave


def drift_at_rest(contact: Contact, engine: ProxyEngine, ticks: int) -> float:
    """How far the proxy moves over `ticks` with the HIP at rest R/4 deep, after 1000 ticks [m]."""
    offset = 0.1 * surface_direction(contact) - 0.25 * contact.normals[0]
    hip = contact.touch + contact.radius * offset
    settled = engine.run(np.tile(hip, (1000, 1))).proxy[-1]
    drift = 0.0
    block = np.tile(hip, (BLOCK_TICKS, 1))
    for done in range(0, ticks, BLOCK_TICKS):
        proxy = engine.run(block[: ticks - done]).proxy
        drift = max(drift, float(np.abs(proxy - settled).max()))
    return drift


def breach_by_jump(contact: Contact, engine: ProxyEngine, distance: float) -> float:
    """Breach while the HIP jumps `distance` [m] through the cloud, and back [m].

    The HIP presses before each jump. A jump alone may show no force, because the proxy reaches the
    far side within the tick where it can go around the end of a line.
    """
    start = contact.start
    pressed = contact.touch - 0.25 * contact.radius * contact.normals[0]
    beyond = -distance * contact.normals[0]
    hips = np.array([start, pressed, beyond, start, -beyond, start, pressed, beyond, beyond, start])
    return breach(engine, engine.run(hips))


def breach_by_piercing(contact: Contact, engine: ProxyEngine, speed: float, rate: float) -> float:
    """Breach while the HIP goes through the cloud and back, and slides along it [m].

    `speed` [m/s] and `rate` [Hz] say how many ticks that takes, at least 8 and at most
    `BLOCK_TICKS`.
    """

    def path(ticks: int) -> Vector:
        s = np.linspace(0, 1, ticks)[:, None]
        across = 3 * np.cos(2 * np.pi * s) * contact.normals[0]
        return contact.touch + contact.radius * (across + 0.5 * s * surface_direction(contact))

    length = length_of(path(2000), closed=False)
    hips = path(min(max(int(length / speed * rate), 8), BLOCK_TICKS))
    engine.reset(hips[0])
    return breach(engine, engine.run(hips))


def breach_by_denormals(contact: Contact, engine: ProxyEngine) -> float:
    """Breach while the HIP moves by the smallest numbers there are, around 0 and at a touch [m]."""
    normal = contact.normals[0]
    tiny = np.arange(-500, 500)[:, None] * 5e-324 * np.ones(3)
    hips = np.concatenate([tiny, tiny - 1e-310 * normal, tiny - 1e-3 * normal])
    return breach(engine, engine.run(hips))


def breach_on_points(contact: Contact, engine: ProxyEngine) -> float:
    """Breach with the HIP exactly on the nearest point, and on the next ones [m]."""
    nearest = np.argsort(row_lengths(contact.points - contact.touch))[:50]
    return breach(engine, engine.run(np.repeat(contact.points[nearest], 3, axis=0)))


def difference_by_bad_ticks(contact: Contact, engine: ProxyEngine) -> float:
    """Largest difference that NaN, infinity and 1e7 m between good ticks make [m].

    A bad tick must keep proxy and force, and say so in its status; else the figure is infinite.
    """
    good_hips = random_path(contact, 300)
    undisturbed = engine.run(good_hips)
    bad_hips = np.array([[np.nan] * 3, [np.inf, 0, 0], [0, -np.inf, 0], [0, 0, 1e7]])
    engine.reset(contact.start)
    largest = 0.0
    for tick, hip in enumerate(good_hips):
        good = engine.step(hip)
        largest = max(largest, float(np.abs(good.proxy - undisturbed.proxy[tick]).max()))
        bad = engine.step(bad_hips[tick % 4])
        stays = np.array_equal(bad.proxy, good.proxy) and np.array_equal(bad.force, good.force)
        if not stays or not bad.status & Status.BAD_HIP:
            return float("inf")
    return largest


def breach_by_long_walk(contact: Contact, engine: ProxyEngine, ticks: int) -> float:
    """Breach in a long random walk around the contact [m]."""
    rng = np.random.default_rng(11)
    hip = contact.start
    largest = 0.0
    for _ in range(ticks // BLOCK_TICKS):
        hips = hip + np.cumsum(rng.normal(scale=WANDER_STEP_M, size=(BLOCK_TICKS, 3)), axis=0)
        # Mirrors around the contact keep the walk within a box.
        folded = np.arcsin(np.sin((hips - contact.touch) / WANDER_M))
        hips = contact.touch + WANDER_M * (2 / np.pi) * folded
        largest = max(largest, breach(engine, engine.run(hips)))
        hip = hips[-1]
    return largest


OUTSIDE = "the proxy stays outside"
FINITE = f"finite answers, and {OUTSIDE}"
# Every case, in the order of the report.
CASES = (
    ExtremeCase("hip/at rest for 1e7 ticks", "no drift at all",
                partial(drift_at_rest, ticks=10_000_000), 0.0, "m of drift"),
    ExtremeCase("hip/jumps 1000 km and back", OUTSIDE, partial(breach_by_jump, distance=9e5)),
    ExtremeCase("hip/1000 m/s through the wall", OUTSIDE,
                partial(breach_by_piercing, speed=1e3, rate=1000.0)),
    *(ExtremeCase(f"hip/{rate:g} Hz", OUTSIDE, partial(breach_by_piercing, speed=0.2, rate=rate))
      for rate in (10.0, 100.0, 1e3, 1e4, 4e4)),
    ExtremeCase("hip/moves by denormals", FINITE, breach_by_denormals, at_origin=True),
    ExtremeCase("hip/exactly on a point", FINITE, breach_on_points),
    ExtremeCase("hip/NaN, Inf, 1e7 m, then back", "the same as without the bad ticks",
                difference_by_bad_ticks, 0.0, "m of difference"),
    ExtremeCase("long/1e8 ticks of random motion", OUTSIDE,
                partial(breach_by_long_walk, ticks=LONG_TICKS), full=True),
)  # fmt: skip


def random_cycle(contact: Contact, rng: np.random.Generator) -> Vector:
    """(T, 3) a closed random path at 1 kHz that starts and ends clear of the contact [m].

    A sum of four harmonics under a window, up to about two radii each way: in and out of the
    fixture, through thin walls and around points, at 0.02 to 2 m/s.
    """
    seconds = 10 ** rng.uniform(-0.8, 0.8)
    s = np.linspace(0.0, 1.0, round(seconds * 1000.0))[:, None]
    way = random_wave(rng, s, 4) + contact.push_direction
    path = contact.start + contact.radius * np.sin(np.pi * s) ** 2 * way
    path[-1] = path[0]
    return path


def energy_balance(
    trace: Trace, hips: Vector, stiffness: float, axis: Vector | None = None
) -> tuple[float, float, float]:
    """The energy balance of one closed cycle of the HIP.

    Returns the work Σ F_k·(x_{k+1} - x_k) that the fixture gave the hand, less the bound of this
    module for a proxy that does not recede [J]; the largest growth of |proxy - HIP| in one tick
    beyond what the HIP's own step explains [m]; and the largest U along the cycle [J]. Where the
    first is above 0 the fixture was active.

    Parameters
    ----------
    trace
        The engine's answers to `hips`.
    hips
        (T, 3) [m], the last row equal to the first.
    stiffness
        K [N/m], the same along every axis.
    axis
        (3,) the ignored axis. A movement along it does no work.
    """
    movement = flattened(np.diff(hips, axis=0), axis)
    # The vector from the HIP to the proxy, without its part along an ignored axis.
    stretch = trace.force / stiffness
    length = row_lengths(stretch)
    length_before = row_lengths(stretch[:-1] - movement)
    stored = 0.5 * stiffness * length * length
    bound = stored[0] - stored[-1] + 0.5 * stiffness * (movement * movement).sum()
    work = (trace.force[:-1] * movement).sum()
    recede = (length[1:] - length_before).max(initial=0.0)
    return float(work - bound), float(recede), float(stored.max())


def passivity_cases(on: Fixture | str, rule: Rule, cycles: int = 20) -> list[CaseResult]:
    """The results of a named scene, or of a bundle's own points, lines and arcs, or triangles.

    Two results: the work over random cycles against its bound, and the largest step away from the
    HIP against the band. None where no ball fits beside the cloud.
    """
    scene, places, band = contacts.contacts_on(on, rule)
    if not places:
        return []
    rng = np.random.default_rng(9)
    engine = engine_for(places[0], rule, band)
    axis, engine_band = engine.parameters.ignore_axis, engine.parameters.band
    cycles_per_place = -(-cycles // len(places))
    excesses, recede = [], 0.0
    for contact in places:
        for _ in range(cycles_per_place):
            hips = random_cycle(contact, rng)
            engine.reset(hips[0])
            excess, growth, stored = energy_balance(engine.run(hips), hips, 1.0, axis)
            excesses.append(excess / stored if stored > 0 else 0.0)
            recede = max(recede, growth)

    count = len(excesses)
    active = sum(excess > 0 for excess in excesses)
    energy = CaseResult(
        case=f"passivity/{scene}/{rule}",
        outcome=outcome_of(active == 0, rule),
        detail=f"net work above the sampled-data bound in {active} of {count} random closed "
        f"cycles; largest (work - bound) / stored energy {max(excesses):+.2g}",
        limit=0.0,
        measured=max(excesses),
        unit="of the energy stored",
        values={
            "scene": scene, "rule": rule, "cycles": count, "active_cycles": active,
            "excess": excesses,
        },
    )  # fmt: skip
    outcome = outcome_of(recede <= engine_band + ROUNDING_M, rule)
    detail = f"|proxy - HIP| grew in one tick by at most {recede / engine_band:.2f} bands"
    case, values = f"recede/{scene}/{rule}", {"scene": scene, "rule": rule}
    return [energy, CaseResult(case, outcome, detail, engine_band, recede, "m", values)]
