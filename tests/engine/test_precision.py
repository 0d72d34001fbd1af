"""The engine's tick against the same tick in 50 digits, in units in the last place.

The paper's tick is written once more, for one state at a time and any number type, and run in
decimal arithmetic and in mpmath's. Of the robust rule, whose path is its own, those figures are
checked that have a closed form: where a flight meets a single point, and the distance it keeps.

One ulp here is that of R, 8.7e-19 m at 5 mm: positions are of that size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from decimal import Decimal, localcontext
from typing import Any

import mpmath
import numpy as np
import pytest

from vfplan import ProxyEngine, ProxyParameters

R = 5e-3
ULP = float(np.spacing(R))
DIGITS = 50
COUNT = 60
Numbers = list[Any]


def paper_tick(
    points: Sequence[Numbers], proxy: Numbers, hip: Numbers, par: ProxyParameters, to: Callable
) -> Numbers:
    """Algorithms 1-4 of the paper for one state, in numbers of type `to` (r_v = 0, ξ = 1).

    Returns the new proxy. `to` turns a float into its exact value and must know `sqrt` as a method
    or through `_root`.
    """
    r1, rc, r2, r3 = (to(x) for x in (par.r1, par.R, par.r2, par.outer_radius))
    near = [(p, r) for p in points if (r := _root(_dot(w := _less(proxy, p), w))) < r3]
    u = _less(hip, proxy)
    if not near:
        return list(hip)
    n = _normal(near, proxy, r1, r3, to)
    entrenched = [p for p, r in near if r < r1]
    if entrenched:
        d = max(_far_root(_less(p, proxy), n, rc) for p in entrenched)
        return [x + d * c for x, c in zip(proxy, n, strict=True)]
    inside = _dot(n, u) < 0
    up = _less(u, [_dot(n, u) * c for c in n])
    if any(r <= r2 for _, r in near):  # Algorithm 3
        d = min(_root(_dot(up, up)), r1)
        return _along(proxy, up if inside else u, d)
    length = _root(_dot(u, u))
    if length == 0:
        return list(proxy)
    way = [c / length for c in u]
    d = min([length, *_near_roots(near, proxy, way, rc)])
    moved = _along(proxy, u, d)
    if d == 0 and inside:
        moved = _along(proxy, up, min(_root(_dot(up, up)), r1))
    mean_hip = sum(_root(_dot(w := _less(hip, p), w)) for p, _ in near)
    away = mean_hip > sum(r for _, r in near)
    return list(hip) if away and not inside else moved


def _root(x: Any) -> Any:
    return x.sqrt() if hasattr(x, "sqrt") else x**0.5


def _dot(a: Numbers, b: Numbers) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _less(a: Numbers, b: Numbers) -> Numbers:
    return [x - y for x, y in zip(a, b, strict=True)]


def _along(start: Numbers, way: Numbers, d: Any) -> Numbers:
    length = _root(_dot(way, way))
    if length == 0:
        return list(start)
    return [x + d * c / length for x, c in zip(start, way, strict=True)]


def _normal(near: list[tuple[Numbers, Any]], proxy: Numbers, r1: Any, r3: Any, to: Callable) -> Any:
    total = [to(0.0)] * 3
    for p, r in near:
        t = min(max((r - r1) / (r3 - r1), to(0.0)), to(1.0))
        phi = (1 + 4 * t) * (1 - t) ** 4
        total = [s + phi * c / r for s, c in zip(total, _less(proxy, p), strict=True)]
    length = _root(_dot(total, total))
    return [c / length for c in total] if length > 0 else total


def _far_root(w: Numbers, n: Numbers, rc: Any) -> Any:
    ahead = _dot(w, n)
    return ahead + _root(ahead * ahead + rc * rc - _dot(w, w))


def _near_roots(near: list, proxy: Numbers, way: Numbers, rc: Any) -> list:
    roots = []
    for p, _ in near:
        w = _less(p, proxy)
        ahead = _dot(w, way)
        square = ahead * ahead + rc * rc - _dot(w, w)
        if square >= 0 and ahead - _root(square) >= 0:
            roots.append(ahead - _root(square))
    return roots


@pytest.fixture(autouse=True)
def digits():
    with localcontext() as context:
        context.prec = DIGITS
        yield


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def test_paper_ticks_among_random_points(rng):
    assert max(_paper(_random_states(rng, COUNT))) <= 64


def test_paper_ticks_between_two_walls(rng):
    assert max(_paper(_walls(rng, COUNT))) <= 64


@pytest.mark.parametrize("miss", [0.9, 1 - 1e-9], ids=["onto a point", "grazing"])
def test_a_robust_flight_keeps_its_distance(rng, miss):
    assert max(_flights(rng, COUNT, miss)) <= 4


def test_the_robust_rule_keeps_its_distance_among_random_points(rng):
    assert max(_kept(rng, COUNT)) <= 4


def test_ticks_agree_with_mpmath():
    """The tick of `paper_tick` in mpmath: another arithmetic than decimal's."""
    rng = np.random.default_rng(4)
    worst = 0.0
    with mpmath.workdps(40):

        def exact(x):
            return [mpmath.mpf(float(c)) for c in x]

        for _ in range(100):
            points = rng.normal(size=(8, 3))
            points *= (
                5e-3 * rng.choice([0.9, 1.0, 1.3], (8, 1)) / np.linalg.norm(points, axis=1)[:, None]
            )
            hip = rng.normal(size=3) * 3e-3
            engine = ProxyEngine(points, rule="paper")
            engine.reset(np.zeros(3))
            found = engine.step(hip).proxy
            cloud = [exact(p) for p in points]
            tick = paper_tick(cloud, exact(np.zeros(3)), exact(hip), engine.parameters, mpmath.mpf)
            worst = max(
                worst, *(abs(float(a - b)) for a, b in zip(exact(found), tick, strict=True))
            )
    assert worst < 200 * np.spacing(5e-3)


State = tuple[np.ndarray, np.ndarray, np.ndarray]


def _random_states(rng: np.random.Generator, count: int) -> list[State]:
    """Clouds of 1 to 12 points around a proxy at any distance, HIP anywhere near."""
    states = []
    for _ in range(count):
        ways = rng.normal(size=(rng.integers(1, 13), 3))
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        lengths = rng.choice([0.7, 0.999, 1.0, 1.001, 1.5], len(ways)) * R
        hip = rng.normal(size=3) * R * 10 ** rng.uniform(-3, 0)
        states.append((ways * lengths[:, None], np.zeros(3), hip))
    return states


def _walls(rng: np.random.Generator, count: int) -> list[State]:
    """Two points on nearly opposite sides: the sum of eq. (1) nearly cancels."""
    states = []
    for _ in range(count):
        tilt = 10 ** rng.uniform(-3, -1)
        points = R * np.array([[1.0, 0, 0], [-np.cos(tilt), np.sin(tilt), 0]])
        states.append((points, np.zeros(3), rng.normal(size=3) * 1e-3))
    return states


def _paper(states: list[State]) -> list[float]:
    """Error of one tick of the native paper rule [ulp], over its normal's condition."""
    ulps = []
    for points, proxy, hip in states:
        engine = ProxyEngine(points, rule="paper")
        engine.reset(proxy)
        found = engine.step(hip).proxy
        exact = paper_tick(
            [_exact(p) for p in points], _exact(proxy), _exact(hip), engine.parameters, Decimal
        )
        ways = proxy - points
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        cancelled = max(1.0, len(points) / max(float(np.linalg.norm(ways.sum(axis=0))), 1e-12))
        ulps.append(_distance(found, exact) / ULP / cancelled)
    return ulps


def _flights(rng: np.random.Generator, count: int, miss: float) -> list[float]:
    """|proxy - p| against R after a free flight at a single point that passes it at `miss` R [ulp].

    The distance, not the place along the ray: at a grazing ray the place is ill-conditioned, the
    distance is not.
    """
    ulps = []
    engine = ProxyEngine(np.zeros((1, 3)))
    for _ in range(count):
        frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        side = R * miss * rng.uniform(0.5, 1.0) ** (0.0 if miss > 0.99 else 1.0)
        start = frame @ [-3 * R, side, 0.0]
        stop = frame @ [-np.sqrt(R * R - side * side) * 0.999, side, 0.0]
        engine.reset(start)
        proxy = engine.step(stop).proxy
        exact = _exact(proxy)
        gap = Decimal(engine.parameters.R - engine.parameters.band) - _root(_dot(exact, exact))
        ulps.append(max(0.0, float(gap) / ULP))
    return ulps


def _kept(rng: np.random.Generator, count: int) -> list[float]:
    """How far the robust rule's proxy is inside R - band, in exact arithmetic [ulp]."""
    ulps = []
    for _ in range(count // 10):
        points = rng.uniform(-2 * R, 2 * R, (60, 3))
        engine = ProxyEngine(points)
        engine.reset([0.0, 6 * R, 0.0])
        kept = Decimal(engine.parameters.R) - Decimal(engine.parameters.band)
        for hip in rng.uniform(-2 * R, 2 * R, (10, 3)):
            proxy = _exact(engine.step(hip).proxy)
            gaps = [kept - _root(_dot(w := _less(_exact(p), proxy), w)) for p in points]
            ulps.append(max(0.0, float(max(gaps)) / ULP))
    return ulps


def _exact(x: np.ndarray) -> Numbers:
    return [Decimal(float(c)) for c in x]


def _distance(found: np.ndarray, exact: Numbers) -> float:
    return max(abs(float(Decimal(float(a)) - b)) for a, b in zip(found, exact, strict=True))
