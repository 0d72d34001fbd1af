"""Extreme motion of the HIP on what a bundle renders, or on a flat patch without one.

At rest for ever, at any speed and rate, by denormals, no number, and for 10^8 ticks. A case was
written with its limit before it was run. Extreme clouds and settings, which no bundle changes, are
tests (tests/engine/test_extremes.py).
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from vfplan.engine.parameters import Vector, check_axis
from vfplan.engine.proxy import ProxyEngine
from vfplan.engine.renderable import as_rendered, best_rule
from vfplan.engine.ticks import Status, Trace
from vfplan.fixture import Fixture, Pieces
from vfplan.replaying.clearance import Clearance, CurveClearance, MeshClearance, PointClearance
from vfplan.stability import contacts
from vfplan.stability.contacts import Contact
from vfplan.stability.largest import engine_for
from vfplan.stability.rows import Row, verdict

INSIDE = "m inside the free distance R - band"
# Rounding of a distance of centimetres; the guarantee itself has no slack.
ROUNDING = 1e-12
BLOCK = 100_000  # ticks at once

Make = Callable[[Contact], ProxyEngine]


@dataclass(frozen=True)
class Extreme:
    """One case."""

    name: str  # in the report "extreme/<name>"
    expected: str  # in words
    probe: Callable[[Contact, Make], float]  # gives the figure held against `limit`
    limit: float = ROUNDING  # the figure is at most this
    unit: str = INSIDE
    full: bool = False  # runs with `--full` only


def try_cases(cases: list[Extreme], fixture: Fixture | None = None) -> list[Row]:
    """A row a case, at the first place of the bundle that a ball can touch, or on the patch."""
    if fixture is None:
        place, make = contacts.patch(), partial(engine_for, rule="robust")
    else:
        rule = best_rule(fixture)
        band = fixture.band if rule == "robust" else None
        place, make = (
            next(contacts.along(as_rendered(fixture, rule), 3), None),
            partial(engine_for, rule=rule, band=band),
        )
    return [] if place is None else [_row(case, case.probe(place, make)) for case in cases]


def _row(case: Extreme, found: float) -> Row:
    detail = f"expected {case.expected}; {found:.3g} {case.unit}"
    outcome = verdict(found <= case.limit)  # not so of a NaN
    values = {"expected": case.expected}
    return Row(f"extreme/{case.name}", outcome, detail, case.limit, found, case.unit, values)


def begun(place: Contact, make: Make) -> ProxyEngine:
    """An engine whose proxy starts clear of the contact."""
    engine = make(place)
    engine.reset(place.start)
    return engine


def breach(place: Contact, engine: ProxyEngine, trace: Trace) -> float:
    """How far the proxy came inside R - band of what is rendered, at most over the ticks [m].

    0 where it never did; infinite where an answer is not finite, or where the path never touched
    and so showed nothing.
    """
    answers = (trace.proxy, trace.normal, trace.force)
    if not (all(np.isfinite(a).all() for a in answers) and trace.force.any()):
        return float("inf")
    clearance = _clearance(place, engine.parameters.R, engine.parameters.ignore_axis)
    clearance.update(trace.proxy)
    return max(0.0, -engine.parameters.band - clearance.minimum_m)


def _clearance(place: Contact, radius: float, axis: Vector | None) -> Clearance:
    """Of proxies to what is rendered, across the axis; with no engine's code."""
    if isinstance(place.exact, Pieces):
        return CurveClearance(place.exact, radius, axis)
    if place.exact is not None:
        return MeshClearance(place.points, place.exact, radius)
    return PointClearance(place.points, radius, axis)


def side(place: Contact) -> Vector:
    """(3,) a unit vector along the surface, across an ignored axis."""
    out = place.normals[0]
    axis = check_axis(place.ignore_axis)
    along = np.cross(out, np.eye(3)[int(np.argmin(np.abs(out)))] if axis is None else axis)
    return along / np.linalg.norm(along)


def walk_path(place: Contact, ticks: int, seed: int = 7) -> Vector:
    """(T, 3) a random HIP path around the touch, up to 2 R into the cloud and off it [m]."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, ticks)[:, None]
    wave = np.zeros((ticks, 3))
    for k in range(1, 12):
        phase = rng.uniform(0, 2 * np.pi, 3)
        wave += rng.normal(size=3) / k * np.sin(2 * np.pi * k * s + phase)
    lead = np.minimum(1.0, 20 * s)  # leaves the free start smoothly
    return place.start + lead * place.radius * (0.8 * wave - 0.7 * place.normals[0])


def rest(place: Contact, make: Make, ticks: int) -> float:
    """How far the proxy moves over `ticks` with the HIP at rest R/4 deep, after 1000 ticks [m]."""
    engine = begun(place, make)
    hip = place.touch + place.radius * (0.1 * side(place) - 0.25 * place.normals[0])
    settled = engine.run(np.tile(hip, (1000, 1))).proxy[-1]
    drift, block = 0.0, np.tile(hip, (BLOCK, 1))
    for done in range(0, ticks, BLOCK):
        proxy = engine.run(block[: ticks - done]).proxy
        drift = max(drift, float(np.abs(proxy - settled).max()))
    return drift


def jump(place: Contact, make: Make, distance: float) -> float:
    """Breach while the HIP jumps `distance` through the cloud, and back [m]."""
    engine, far = begun(place, make), -distance * place.normals[0]
    near = place.start
    return breach(
        place, engine, engine.run(np.array([near, far, near, -far, near, far, far, near]))
    )


def pierce(place: Contact, make: Make, speed: float, rate: float) -> float:
    """Breach while the HIP goes through the cloud and back, and slides [m]."""
    s = np.linspace(0, 1, 2000)[:, None]
    deep = 3 * np.cos(2 * np.pi * s) * place.normals[0]
    path = place.touch + place.radius * (deep + 0.5 * s * side(place))
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    at = np.linspace(0, len(path) - 1, min(max(int(length / speed * rate), 8), BLOCK))
    hips = np.column_stack([np.interp(at, np.arange(len(path)), path[:, k]) for k in range(3)])
    engine = make(place)
    engine.reset(hips[0])
    return breach(place, engine, engine.run(hips))


def denormals(place: Contact, make: Make) -> float:
    """Breach while the HIP moves by the smallest numbers there are, around 0 and at a touch [m]."""
    exact = place.exact
    if isinstance(exact, Pieces):
        exact = replace(exact, vertices=exact.vertices - place.touch)
    place = replace(place, points=place.points - place.touch, touch=np.zeros(3), exact=exact)
    engine, out = begun(place, make), place.normals[0]
    tiny = np.arange(-500, 500)[:, None] * 5e-324 * np.ones(3)
    hips = np.concatenate([tiny, tiny - 1e-310 * out, tiny - 1e-3 * out])
    return breach(place, engine, engine.run(hips))


def on_point(place: Contact, make: Make) -> float:
    """Breach with the HIP exactly on the nearest point, and on the next ones [m]."""
    engine = begun(place, make)
    nearest = np.argsort(np.linalg.norm(place.points - place.touch, axis=1))[:50]
    return breach(place, engine, engine.run(np.repeat(place.points[nearest], 3, axis=0)))


def interrupted(place: Contact, make: Make) -> float:
    """Largest difference that NaN, Inf and 1e7 m between good ticks make [m].

    A bad tick must keep proxy and force, and say so in its status.
    """
    good = walk_path(place, 300)
    plain = begun(place, make).run(good)
    bad = np.array([[np.nan] * 3, [np.inf, 0, 0], [0, -np.inf, 0], [0, 0, 1e7]])
    engine, worst = begun(place, make), 0.0
    for k, hip in enumerate(good):
        step = engine.step(hip)
        worst = max(worst, float(np.abs(step.proxy - plain.proxy[k]).max()))
        wrong = engine.step(bad[k % 4])
        kept = np.array_equal(wrong.proxy, step.proxy) and np.array_equal(wrong.force, step.force)
        if not (kept and wrong.status & Status.BAD_HIP):
            return float("inf")
    return worst


def wander(place: Contact, make: Make, ticks: int, figure: str) -> float:
    """A figure of the long random walk."""
    return _wandered(place, make, ticks)[figure]


@lru_cache(1)
def _wandered(place: Contact, make: Make, ticks: int) -> dict[str, float]:
    """Breach [m], time of the last tenth over the first less 1, growth of memory after it [B]."""
    engine = begun(place, make)
    rng = np.random.default_rng(11)
    hip, worst = place.start, 0.0
    times, memory = [], []
    block = min(BLOCK, ticks // 10)
    for _ in range(ticks // block):
        hips = hip + np.cumsum(rng.normal(scale=1e-4, size=(block, 3)), axis=0)
        # Folded into a box around the place: a random walk between mirrors.
        hips = place.touch + 8e-3 * (2 / np.pi) * np.arcsin(np.sin((hips - place.touch) / 8e-3))
        started = time.thread_time()
        trace = engine.run(hips)
        times.append(time.thread_time() - started)
        worst = max(worst, breach(place, engine, trace))
        memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
        hip = hips[-1]
    tenth = len(times) // 10
    slower = float(np.median(times[-tenth:]) / np.median(times[:tenth]) - 1)
    return {"breach": worst, "slower": slower, "growth": float(memory[-1] - memory[tenth])}


OUTSIDE, FINITE = "the proxy stays outside", "every answer finite, the proxy outside"
LONG = 100_000_000

CASES = (
    Extreme("hip/at rest for 1e7 ticks", "no drift at all", partial(rest, ticks=10_000_000), 0.0,
            "m of drift"),
    Extreme("hip/jumps 1000 km and back", OUTSIDE, partial(jump, distance=9e5)),
    Extreme("hip/1000 m/s through the wall", OUTSIDE, partial(pierce, speed=1e3, rate=1000.0)),
    *(Extreme(f"hip/{rate:g} Hz", OUTSIDE, partial(pierce, speed=0.2, rate=rate))
      for rate in (10.0, 100.0, 1e3, 1e4, 4e4)),
    Extreme("hip/moves by denormals", FINITE, denormals),
    Extreme("hip/exactly on a point", FINITE, on_point),
    Extreme("hip/NaN, Inf, 1e7 m, then back", "as if the bad ticks had not been", interrupted, 0.0,
            "m"),
    Extreme("long/1e8 ticks of random motion", OUTSIDE,
            partial(wander, ticks=LONG, figure="breach"), full=True),
    Extreme("long/1e8 ticks, time", "the last tenth takes no longer than the first",
            partial(wander, ticks=LONG, figure="slower"), 0.5, "of the first tenth's time, more",
            full=True),
    Extreme("long/1e8 ticks, memory", "no growth", partial(wander, ticks=LONG, figure="growth"),
            4e6, "bytes", full=True),
)  # fmt: skip
"""Every case, in the order of the report."""
