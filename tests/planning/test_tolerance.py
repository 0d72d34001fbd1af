import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from vfplan.errors import SettingError
from vfplan.planning.tolerance import choose, iterations

R = 5e-3


@pytest.mark.parametrize("tolerance", [1e-7, 1e-6, 1e-5, 1e-4])
@pytest.mark.parametrize("radius", [1e-3, 5e-3, 12e-3])
def test_the_shares_add_up_to_the_tolerance(tolerance, radius):
    choice = choose(tolerance, radius)
    depth = choice.spacing_m**2 / (8 * radius)
    assert depth == pytest.approx(choice.sampling_tolerance_m)
    assert depth + choice.band_m < tolerance
    assert choice.band_m >= depth, "a band less than the dimples sticks in them"


def test_spacing_is_the_largest_whose_dimples_fit():
    choice = choose(1e-5, R)
    x = np.arange(-40, 41) * choice.spacing_m
    cloud = cKDTree(np.column_stack([x, 0 * x]))
    between = np.column_stack([np.linspace(0, choice.spacing_m, 999), np.full(999, R)])
    gap = cloud.query(between)[0].max() - R
    assert gap == pytest.approx(choice.sampling_tolerance_m, rel=1e-2)


def slide(n, depth=R / 2, step=1e-4, ticks=400):
    """Lag behind the exact proxy on a ball of radius R after n tangent-and-return steps a tick."""
    angle, proxy, worst = 0.0, 0.0, 0.0
    for tick in range(ticks):
        angle += step / (R - depth)
        for _ in range(n):
            hip = (R - depth) * np.array([math.cos(angle), math.sin(angle)])
            tangent = np.array([-math.sin(proxy), math.cos(proxy)])
            proxy += math.atan2(hip @ tangent, R)
        if tick > ticks // 2:
            worst = max(worst, R * abs(angle - proxy))
    return worst


@pytest.mark.parametrize("lag", [1e-5, 1e-6, 1e-7])
def test_iterations_are_as_many_as_the_lag_needs(lag):
    n = iterations(lag)
    assert slide(n) <= 1.05 * lag
    assert n == 1 or slide(n - 1) > lag


@pytest.mark.parametrize("given, says", [
    ({"tolerance_m": 0.0}, "tolerance .*0 m"),
    ({"tolerance_m": float("nan")}, "tolerance .*nan m"),
    ({"tolerance_m": 1e-5, "radius_m": -1.0}, "radius .*-1 m"),
])  # fmt: skip
def test_refuses_what_has_no_answer(given, says):
    with pytest.raises(SettingError, match=says):
        choose(**{"radius_m": R, **given})
