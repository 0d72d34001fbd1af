"""Splines and filters, against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from scipy.interpolate import CubicSpline, make_smoothing_spline

from vfplan.geometry.lines import (
    gaussian,
    ring_of,
    running_median,
    smoothing_spline,
    spline_through,
    windows,
)

MODES = {"symmetric": "reflect", "edge": "nearest", "wrap": "wrap"}
COUNTS = [2, 3, 4, 5, 31, 32, 33, 64, 65, 700]


def walk(count, dimension=2):
    return np.random.default_rng(count).normal(size=(count, dimension)).cumsum(axis=0)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("kind", ["not-a-knot", "periodic"])
def test_spline_through_points_is_scipys(count, kind):
    is_ring = kind == "periodic" and count > 2
    points = ring_of(walk(count, 3), is_ring)
    at = np.linspace(0 if is_ring else -1, count, 5 * count)
    theirs = CubicSpline(np.arange(len(points)), points, bc_type=kind if is_ring else "not-a-knot")
    for derivative in (0, 1, 2):
        ours = spline_through(points, is_ring)(at, derivative)
        assert ours == pytest.approx(theirs(at, derivative), abs=1e-12)


@pytest.mark.parametrize("count", COUNTS[3:])
@pytest.mark.parametrize("smoothing", [1.0, 2.0**4, 3.5**4])
def test_smoothing_spline_is_scipys(count, smoothing):
    """With gaps between the points, unequal weights, and beyond both ends."""
    rng = np.random.default_rng(count)
    knots = np.sort(rng.choice(2 * count, count, replace=False))
    points, weight = walk(count), rng.uniform(0.01, 2, count)
    at = np.linspace(knots[0] - 5, knots[-1] + 5, 5 * count)
    ours = smoothing_spline(knots, points, weight, smoothing)
    theirs = make_smoothing_spline(knots, points, w=weight, lam=smoothing)
    for derivative in (0, 1, 2):
        assert ours(at, derivative) == pytest.approx(theirs(at, nu=derivative), abs=1e-8)


@pytest.mark.parametrize("count", [3, 9, 30, 700])
@pytest.mark.parametrize("mode", MODES)
def test_filters_are_scipys_to_the_bit(count, mode):
    values = walk(count)
    for sigma in (0.5, 0.8, 2.0, 3.5, 8.0):
        expected = ndimage.gaussian_filter1d(values, sigma, axis=0, mode=MODES[mode])
        assert np.array_equal(gaussian(values, sigma, mode), expected)
    row = values[:, 0]
    for size in (3, 4, 9, 24, 25):
        largest = ndimage.maximum_filter1d(row, size, mode=MODES[mode])
        assert np.array_equal(windows(row, size, mode).max(axis=1), largest)
        median = ndimage.median_filter(row, size, mode=MODES[mode])
        assert np.array_equal(running_median(row, size, mode), median)
        mean = ndimage.uniform_filter1d(row, size, mode=MODES[mode])
        assert windows(row, size, mode).mean(axis=1) == pytest.approx(mean, abs=1e-13)
