"""Sampling by need: the union of spheres stays within its promise of the swept curve."""

from __future__ import annotations

import json

import numpy as np
import pytest
from conftest import ROOT
from scipy.interpolate import CubicSpline

from vfplan import sample_curve
from vfplan.engine.parameters import MAX_POINTS
from vfplan.errors import SettingError

R = 5e-3
PIXEL = 0.6e-3


def flat(u, v):
    return np.column_stack([u, v, np.zeros(len(u))])


def circle(radius, step=PIXEL):
    t = np.linspace(0, 2 * np.pi, max(12, round(2 * np.pi * radius / step)), endpoint=False)
    return flat(radius * np.cos(t), radius * np.sin(t)), True


def wave(amplitude, period):
    x = np.arange(0, 0.12, PIXEL)
    return flat(x, amplitude * np.sin(2 * np.pi * x / period)), False


CURVES = {"line": (flat(np.arange(0, 0.1, PIXEL), np.zeros(167)), False),
          "circle 2 mm": circle(2e-3, 2e-4), "circle 6 mm": circle(6e-3),
          "circle 20 mm": circle(20e-3), "gentle wave": wave(5e-3, 60e-3),
          "steep wave": wave(8e-3, 30e-3),
          "helix": (np.column_stack([0.01 * np.cos(T := np.linspace(0, 12, 600)), 0.01 * np.sin(T),
                                     1e-3 * T]), False)}  # fmt: skip


def dimple(fine, closed, sampled):
    """How deep a ray from the curve along its normal may end below R in the union [m]."""
    ring = np.vstack([fine, fine[:1]]) if closed else fine
    spline = CubicSpline(np.arange(len(ring)), ring, bc_type="periodic" if closed else "not-a-knot")
    at = np.linspace(0, len(ring) - 1, 4001)
    tangent = spline(at, 1)
    normal = np.cross(tangent, [0, 0, 1.0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    to_centre = sampled.points[None] - spline(at)[:, None]
    deepest = 0.0
    for side in (normal, -normal):
        along = np.einsum("mnk,mk->mn", to_centre, side)
        inside = along**2 - (to_centre**2).sum(2) + R**2
        reach = np.where(inside >= 0, along + np.sqrt(np.maximum(inside, 0)), 0.0)
        deepest = max(deepest, R - float(reach.max(1).min()))
    return deepest


def sampled_of(name, **how):
    """A curve, whether it is closed, and its samples."""
    fine, closed = CURVES[name]
    return fine, closed, sample_curve(fine, closed, radius_m=R, **how)


@pytest.mark.parametrize("tolerance", [2e-6, 1e-5, 5e-5])
@pytest.mark.parametrize("name", CURVES)
def test_the_promise_holds_and_is_not_wasteful(name, tolerance):
    fine, closed, sampled = sampled_of(name, tolerance_m=tolerance)
    assert sampled.sampling_error_m <= tolerance * (1 + 1e-9)
    measured = dimple(fine, closed, sampled)
    assert measured <= tolerance * 1.02
    assert measured >= 0.3 * tolerance


@pytest.mark.parametrize("name", ["line", "circle 20 mm", "gentle wave"])
@pytest.mark.parametrize("tolerance", [1e-5, 2e-4, 1e-3, 4e-3])
def test_the_promise_holds_where_spheres_barely_meet(name, tolerance):
    """There h²/8R is too little: at h = 1.8 R the dimple is 0.56 R deep, and h²/8R only 0.4 R."""
    fine, closed, sampled = sampled_of(name, tolerance_m=tolerance)
    assert sampled.sampling_error_m <= tolerance * (1 + 1e-9)
    assert dimple(fine, closed, sampled) <= sampled.sampling_error_m * 1.001


def test_spheres_that_do_not_meet_cost_the_whole_radius():
    sampled = sample_curve(*CURVES["line"], radius_m=R, density_per_m=1 / (3 * R))
    assert sampled.sampling_error_m == pytest.approx(R)


@pytest.mark.parametrize("asked", [{"density_per_m": 1e12}, {"tolerance_m": 1e-18}], ids=str)
def test_more_points_than_a_bundle_holds_are_refused_at_once(asked):
    sizes = json.loads((ROOT / "schemas" / "bundle-2.0.json").read_text())["sizes"]
    assert sizes["N"]["max"] == MAX_POINTS
    with pytest.raises(SettingError, match="at most 4000000"):
        sample_curve(*CURVES["line"], radius_m=R, **asked)


def test_density_overrides():
    *_, sampled = sampled_of("circle 20 mm", tolerance_m=None, density_per_m=2000)
    assert len(sampled.points) == pytest.approx(2000 * 2 * np.pi * 0.02, abs=1)
    assert sampled.spacing_m == pytest.approx(5e-4, rel=0.01)


@pytest.mark.parametrize("name", CURVES)
def test_points_lie_on_the_curve_in_order_with_both_ends(name):
    fine, closed, sampled = sampled_of(name)
    assert (np.diff(sampled.arclength) > 0).all()
    assert (np.diff(sampled.parameter) > 0).all()
    assert np.allclose(sampled.points[0], fine[0])
    if closed:
        assert sampled.parameter[-1] < len(fine)
    else:
        assert np.allclose(sampled.points[-1], fine[-1])
    if name.startswith("circle"):
        radius = float(name.split()[1]) * 1e-3
        assert np.abs(np.hypot(*sampled.points[:, :2].T) - radius).max() < 1e-6


@pytest.mark.parametrize("wrong", [
    {"radius_m": 0.0}, {"radius_m": float("inf")}, {"radius_m": R, "tolerance_m": -1.0},
    {"radius_m": R, "tolerance_m": float("nan")}, {"radius_m": R, "density_per_m": 0.0},
    {"points_m": np.zeros((1, 3))}, {"points_m": np.zeros((5, 2))},
    {"points_m": np.full((5, 3), np.nan)},
], ids=str)  # fmt: skip
def test_settings_out_of_range_and_curves_that_are_none_are_refused(wrong):
    given = {"points_m": CURVES["line"][0], "closed": False, "radius_m": R}
    with pytest.raises(SettingError):
        sample_curve(**given | wrong)


def test_two_points_are_a_line():
    sampled = sample_curve(np.array([[0, 0, 0], [0.01, 0, 0]]), False, radius_m=R)
    assert np.allclose(sampled.points[:, 1:], 0)
    assert sampled.arclength[-1] == pytest.approx(0.01)


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("rows", [1e-3, 2e-3])
def test_the_promise_holds_where_steps_are_uneven(rows, closed):
    """A point a pixel of a slice of 0.1 mm columns: a row, a bend of 1 mm, a column."""
    turn = np.linspace(0, np.pi / 2, 25)[1:]
    u = np.r_[np.arange(-300, 1) * 1e-4, 1e-3 * np.sin(turn), np.full(300, 1e-3)]
    v = np.r_[np.zeros(301), 1e-3 - 1e-3 * np.cos(turn), 1e-3 + rows * np.arange(1, 301)]
    for tolerance in (4e-6, 4e-5):
        sampled = sample_curve(flat(u, v), closed, radius_m=R, tolerance_m=tolerance)
        assert 0.5 * tolerance < sampled.sampling_error_m <= tolerance * (1 + 1e-9)
