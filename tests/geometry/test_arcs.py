"""Lines and arcs fitted to measured curves: within the tolerance, without kinks, few."""

from __future__ import annotations

import numpy as np
import pytest
from refusals import refuses
from scipy.interpolate import CubicSpline

from vfplan.errors import CurveError
from vfplan.geometry.lines import find_corners, fit_arcs, ring_of

TOLERANCE = 1e-6


def turns(arcs):
    """(K,) how far the direction jumps at each joint of two pieces [rad]."""
    chord = np.roll(arcs.vertices, -1, axis=0) - arcs.vertices
    along, half = np.arctan2(chord[:, 1], chord[:, 0]), 2 * np.arctan(arcs.bulges)
    count = len(arcs.vertices) - (not arcs.closed)
    begins, ends = (along - half)[:count], (along + half)[:count]
    jump = np.roll(begins, -1) - ends if arcs.closed else begins[1:] - ends[:-1]
    return np.abs((jump + np.pi) % (2 * np.pi) - np.pi)


def ellipse(count=240):
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.column_stack([0.03 * np.cos(turn), 0.02 * np.sin(turn)])


def wave(noise=0.0):
    x = np.arange(0, 0.1, 5e-4)
    line = np.column_stack([x, 0.01 * np.sin(90 * x)])
    return line + np.random.default_rng(1).normal(size=line.shape) * noise


@pytest.mark.parametrize(
    "points, closed, most",
    [(ellipse(), True, 64), (wave(), False, 70), (wave(5e-6), False, 320)],
)
def test_smooth_curves_are_followed_without_a_kink(points, closed, most):
    arcs = fit_arcs(points, closed, TOLERANCE)
    assert arcs.distance(points).max() <= TOLERANCE
    kind = "periodic" if closed else "not-a-knot"
    ring = ring_of(points, closed)
    spline = CubicSpline(np.arange(len(ring)), ring, bc_type=kind)
    between = arcs.distance(spline(np.linspace(0, len(ring) - 1, 8 * (len(ring) - 1) + 1))).max()
    assert between <= arcs.error * (1 + 1e-9) <= TOLERANCE * (1 + 1e-9)
    assert turns(arcs).max() < 1e-9
    assert len(arcs.bulges) <= most
    assert np.abs(arcs.bulges).max() <= 1


@pytest.mark.parametrize("noise", [0.0, 5e-6])
def test_a_corner_stays_one(noise):
    leg = np.arange(1, 61) * 5e-4
    points = np.vstack([
        np.column_stack([-leg[::-1], 0 * leg]), [[0, 0]], np.column_stack([0 * leg, leg]),
    ])  # fmt: skip
    points = points + np.random.default_rng(2).normal(size=points.shape) * noise
    assert find_corners(points, False, TOLERANCE).tolist() == [60]
    arcs = fit_arcs(points, False, TOLERANCE)
    assert np.sort(turns(arcs))[-2:] == pytest.approx([0, np.pi / 2], abs=0.05)
    assert arcs.distance(points).max() <= TOLERANCE


def test_a_closed_outline_begins_at_a_corner():
    side = np.arange(40) * 1e-3
    zero = 0 * side
    square = np.vstack([
        np.column_stack([side, zero]), np.column_stack([zero + 0.04, side]),
        np.column_stack([0.04 - side, zero + 0.04]), np.column_stack([zero, 0.04 - side]),
    ])  # fmt: skip
    arcs = fit_arcs(np.roll(square, 7, axis=0), True, TOLERANCE)
    assert arcs.distance(square).max() < 1e-12
    assert (turns(arcs) > 1.5).sum() == 4
    assert len(arcs.bulges) <= 8


def test_two_points_are_a_line():
    arcs = fit_arcs(np.array([[0.0, 0], [0.1, 0.02]]), False, TOLERANCE)
    assert np.array_equal(arcs.bulges, 0 * arcs.bulges)
    assert arcs.vertices[[0, -1]] == pytest.approx(np.array([[0, 0], [0.1, 0.02]]), abs=1e-15)


def test_neighbours_that_coincide_are_refused():
    line = np.array([(0, 0), (1, 0), (1, 0), (2, 0), (3, 1.0)])
    with refuses(CurveError, "points-coincide", index=1, points=5):
        fit_arcs(line, False, 1e-6)
    with refuses(CurveError, "points-coincide", index=3, points=4):
        fit_arcs(np.array([(0, 0), (1, 0), (1, 1), (0, 0.0)]), True, 1e-6)
