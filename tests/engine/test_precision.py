"""Rule "robust" against closed forms in 50 digits, in units in the last place.

Its path is its own. What has a closed form is where a flight meets a single point, and the distance
that it keeps.

One ulp here is that of R, 8.7e-19 m at 5 mm: positions are of that size.
"""

from decimal import Decimal, localcontext

import numpy as np
import pytest
from motion import R, play

from vfplan import ProxyEngine

ULP, DIGITS, COUNT = float(np.spacing(R)), 50, 60


def _length(x):
    return (x @ x).sqrt()


@pytest.fixture(autouse=True)
def digits():
    with localcontext() as context:
        context.prec = DIGITS
        yield


@pytest.mark.parametrize("miss", [0.9, 1 - 1e-9])
def test_a_flight_ends_right_to_some_ulps(miss):
    found = [*_flights(np.random.default_rng(5), miss)]
    assert len(found) >= COUNT
    assert max(found) <= 4


def test_among_random_points_it_keeps_its_distance_to_some_ulps():
    """R - band from every point, in exact arithmetic."""
    rng = np.random.default_rng(5)
    for _ in range(COUNT // 10):
        points = rng.uniform(-2 * R, 2 * R, (60, 3))
        engine = ProxyEngine(points)
        engine.reset([0.0, 6 * R, 0.0])
        kept = Decimal(engine.parameters.R) - Decimal(engine.parameters.band)
        for hip in rng.uniform(-2 * R, 2 * R, (10, 3)):
            proxy = _exact(engine.step(hip).proxy)
            assert max(kept - _length(_exact(p) - proxy) for p in points) <= 4 * Decimal(ULP)


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


def _exact(x):
    return np.vectorize(lambda c: Decimal(float(c)), otypes=[object])(x)
