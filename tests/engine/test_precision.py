"""The engine's tick against the same tick in 50 digits, in units in the last place.

The paper's tick is written once more, for one state at a time and any number type, and run in
decimal arithmetic and in mpmath's. Of the robust rule, whose path is its own, those figures are
checked that have a closed form: where a flight meets a single point, and the distance it keeps.

One ulp here is that of R, 8.7e-19 m at 5 mm: positions are of that size.
"""

from decimal import Decimal, localcontext

import numpy as np
import pytest
from motion import R, play

from vfplan import ProxyEngine

ULP, DIGITS, COUNT = float(np.spacing(R)), 50, 60


def paper_tick(points, proxy, hip, par, to):
    """Algorithms 1-4 of the paper for one state, in numbers of type `to` (r_v = 0, ξ = 1).

    Arrays of objects of that type: points (N, 3), proxy and HIP (3,). Returns the new proxy. `to`
    turns a float into its exact value.
    """
    r1, rc, r2, r3 = (to(x) for x in (par.r1, par.R, par.r2, par.outer_radius))
    near = [(p, r) for p in points if (r := _length(proxy - p)) < r3]
    u = hip - proxy
    if not near:
        return hip
    n = _normal(near, proxy, r1, r3, to)
    entrenched = [p for p, r in near if r < r1]
    if entrenched:
        return proxy + max(_far_root(p - proxy, n, rc) for p in entrenched) * n
    inside = n @ u < 0
    up = u - (n @ u) * n
    if any(r <= r2 for _, r in near):  # Algorithm 3
        return _along(proxy, up if inside else u, min(_length(up), r1))
    length = _length(u)
    if length == 0:
        return proxy
    d = min([length, *_near_roots(near, proxy, u / length, rc)])
    moved = _along(proxy, u, d)
    if d == 0 and inside:
        moved = _along(proxy, up, min(_length(up), r1))
    away = sum(_length(hip - p) for p, _ in near) > sum(r for _, r in near)
    return hip if away and not inside else moved


def _root(x):
    return x.sqrt() if hasattr(x, "sqrt") else x**0.5


def _length(x):
    return _root(x @ x)


def _along(start, way, d):
    length = _length(way)
    return start if length == 0 else start + d * way / length


def _normal(near, proxy, r1, r3, to):
    total = _exact(np.zeros(3), to)
    for p, r in near:
        t = min(max((r - r1) / (r3 - r1), to(0.0)), to(1.0))
        total = total + (1 + 4 * t) * (1 - t) ** 4 / r * (proxy - p)
    length = _length(total)
    return total / length if length > 0 else total


def _far_root(w, n, rc):
    ahead = w @ n
    return ahead + _root(ahead * ahead + rc * rc - w @ w)


def _near_roots(near, proxy, way, rc):
    for p, _ in near:
        w = p - proxy
        ahead = w @ way
        square = ahead * ahead + rc * rc - w @ w
        if square >= 0 and ahead - _root(square) >= 0:
            yield ahead - _root(square)


@pytest.fixture(autouse=True)
def digits():
    with localcontext() as context:
        context.prec = DIGITS
        yield


# What is looked at, and within how many ulps it is right.
LOOKS = {
    "paper among random points": (lambda rng: _paper(_random_states(rng)), 64),
    "paper between two walls": (lambda rng: _paper(_walls(rng)), 64),
    "robust flight onto a point": (lambda rng: _flights(rng, 0.9), 4),
    "robust flight that grazes": (lambda rng: _flights(rng, 1 - 1e-9), 4),
    "robust among random points": (lambda rng: _kept(rng), 4),
}


@pytest.mark.parametrize(("ulps", "most"), LOOKS.values(), ids=LOOKS)
def test_a_tick_is_right_to_some_ulps(ulps, most):
    found = [*ulps(np.random.default_rng(5))]
    assert len(found) >= COUNT
    assert max(found) <= most


def _random_states(rng):
    """Clouds of 1 to 12 points around a proxy at any distance, HIP anywhere near."""
    for _ in range(COUNT):
        ways = rng.normal(size=(rng.integers(1, 13), 3))
        lengths = rng.choice([0.7, 0.999, 1.0, 1.001, 1.5], (len(ways), 1)) * R
        hip = rng.normal(size=3) * R * 10 ** rng.uniform(-3, 0)
        yield ways / _norms(ways) * lengths, np.zeros(3), hip


def _walls(rng):
    """Two points on nearly opposite sides: the sum of eq. (1) nearly cancels."""
    for _ in range(COUNT):
        tilt = 10 ** rng.uniform(-3, -1)
        points = R * np.array([[1.0, 0, 0], [-np.cos(tilt), np.sin(tilt), 0]])
        yield points, np.zeros(3), rng.normal(size=3) * 1e-3


def _paper(states):
    """Error of one tick of the native paper rule [ulp], over its normal's condition."""
    for points, proxy, hip in states:
        engine = ProxyEngine(points, rule="paper")
        found = play(engine, [hip], proxy).proxy[0]
        exact = paper_tick(*map(_exact, (points, proxy, hip)), engine.parameters, Decimal)
        ways = (proxy - points) / _norms(proxy - points)
        cancelled = max(1.0, len(points) / max(float(np.linalg.norm(ways.sum(axis=0))), 1e-12))
        yield float(np.abs(_exact(found) - exact).max()) / ULP / cancelled


def _flights(rng, miss):
    """|proxy - p| against R after a free flight at a single point that passes it at `miss` R [ulp].

    The distance, not the place along the ray: at a grazing ray the place is ill-conditioned, the
    distance is not.
    """
    engine = ProxyEngine(np.zeros((1, 3)))
    for _ in range(COUNT):
        frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        side = R * miss * rng.uniform(0.5, 1.0) ** (0.0 if miss > 0.99 else 1.0)
        start = frame @ [-3 * R, side, 0.0]
        stop = frame @ [-np.sqrt(R * R - side * side) * 0.999, side, 0.0]
        proxy = play(engine, [stop], start).proxy[0]
        gap = Decimal(engine.parameters.R - engine.parameters.band) - _length(_exact(proxy))
        yield max(0.0, float(gap) / ULP)


def _kept(rng):
    """How far the robust rule's proxy is inside R - band, in exact arithmetic [ulp]."""
    for _ in range(COUNT // 10):
        points = rng.uniform(-2 * R, 2 * R, (60, 3))
        engine = ProxyEngine(points)
        engine.reset([0.0, 6 * R, 0.0])
        kept = Decimal(engine.parameters.R) - Decimal(engine.parameters.band)
        for hip in rng.uniform(-2 * R, 2 * R, (10, 3)):
            proxy = _exact(engine.step(hip).proxy)
            gaps = [kept - _length(_exact(p) - proxy) for p in points]
            yield max(0.0, float(max(gaps)) / ULP)


def _exact(x, to=Decimal):
    return np.vectorize(lambda c: to(float(c)), otypes=[object])(x)


def _norms(rows):
    return np.linalg.norm(rows, axis=1, keepdims=True)
