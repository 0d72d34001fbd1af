"""Predicted errors against what happens: refits with fresh noise, thousands of them."""

from __future__ import annotations

import numpy as np
import pytest
from layouts import MODELS, PX, R, every_model, fit, flat_and_solid, grid, markers, solid
from numpy.testing import assert_allclose
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.special import fdtrc, fdtri

from vfplan.registration.models import f_exceeds, f_quantile, homogeneous
from vfplan.registration.registration import fit_registration

LAYOUTS = {
    "grid": grid(),
    "kite": np.array([[100.0, 100], [700, 150], [300, 600], [420, 380]]),
    "strip": np.array([[100.0, 305], [220, 270], [340, 320], [460, 290], [580, 310], [700, 285]]),
    "triangle": np.array([[100.0, 100], [700, 150], [300, 600]]),
}
# Inside, at a corner, beyond the markers.
TARGETS = np.array([[420.0, 390], [100, 400], [300, 200], [850, 800]])
SOLID = solid(7)[0]
SOLID_TARGETS = np.array([[0.0, 0, 0], [0.2, 0.1, 0], [0, 0, 0.3]])
QUICK_CASES = [(model, "grid", 3e-4) for model in MODELS] + [("rigid", "solid", 1e-3)]
MORE_CASES = [
    (model, layout, noise)
    for model in MODELS
    for layout, noise in (("kite", 1e-3), ("strip", 1e-4), ("triangle", 5e-4))
    if (model, layout) != ("affine", "triangle")  # three markers leave it no residual
] + [("affine", "solid", 1e-3), ("similarity", "solid", 1e-3)]
CASES = QUICK_CASES + [pytest.param(*case, marks=pytest.mark.slow) for case in MORE_CASES]


def truth(points):
    flat = np.column_stack([points * PX, np.zeros(len(points))]) if points.shape[1] == 2 else points
    return flat @ R.T + [0.4, -0.1, 0.02]


def judged(source, targets, noises, **how):
    """Predicted over true error, and how often the bound held, over fits with every noise."""
    predicted, true, covered = [], [], []
    exact, goal = truth(source), truth(targets)
    for noise in noises:
        r = fit_registration(source, exact + noise, **how)
        error = np.linalg.norm(r.apply(targets) - goal, axis=1)
        predicted.append(r.tre_m(targets) ** 2)
        true.append(error**2)
        covered.append(error <= r.tre95_m(targets))
    return np.sqrt(np.mean(predicted) / np.mean(true)), np.mean(covered)


@pytest.mark.parametrize("model, layout, noise", CASES)
def test_predicted_tre_is_the_true_one(model, layout, noise):
    source, targets, spacing = SOLID, SOLID_TARGETS, None
    if layout != "solid":
        source, targets, spacing = LAYOUTS[layout], TARGETS, PX
    noises = np.random.default_rng(11).normal(0, noise, (2000, *source.shape[:1], 3))
    ratio, covered = judged(source, targets, noises, model=model, pixel_spacing=spacing)
    assert 0.97 < ratio < 1.03
    assert 0.94 < covered < 0.96


@every_model
@pytest.mark.parametrize("per_axis", [pytest.param(False, marks=pytest.mark.slow), True])
def test_predicted_tre_with_unequal_markers(model, per_axis):
    source, targets = grid(), TARGETS
    rng = np.random.default_rng(12)
    sigma = np.exp(rng.normal(np.log(3e-4), 0.6, (9, 3) if per_axis else 9))
    spread = np.broadcast_to(sigma.reshape(9, -1), (9, 3))
    noises = rng.normal(0, 1, (1200, 9, 3)) * spread
    # Only the ratios count: state all of them five times too small.
    known = {"pixel_spacing": PX, "sigma": sigma / 5}
    ratio, covered = judged(source, targets, noises, model=model, **known)
    assert 0.97 < ratio < 1.03
    assert 0.935 < covered < 0.965


@every_model
@pytest.mark.parametrize("layout", ["grid", pytest.param("kite", marks=pytest.mark.slow)])
def test_the_band_covers_the_whole_curve(model, layout):
    source, rng = LAYOUTS[layout], np.random.default_rng(13)
    t = np.linspace(0, 1, 120)
    curve = np.column_stack([150 + 500 * t, 350 + 150 * np.sin(6 * t)])
    noise = rng.normal(0, 3e-4, (2500, len(source), 3))
    fits = [fit(source, truth(source) + error, model) for error in noise]
    widths = [(r.tre95_curve_m(curve) / r.tre95_m(curve))[0] for r in fits[:3]]
    assert_allclose(widths, widths[0], rtol=1e-2)  # the draw does not matter
    goal = truth(curve)
    ratio = np.array(
        [(np.linalg.norm(r.apply(curve) - goal, axis=1) / r.tre95_m(curve)).max() for r in fits]
    )
    assert 0.94 < (ratio <= widths[0]).mean() < 0.96
    assert (ratio <= 1).mean() < 0.93  # what the pointwise bound covers


def test_rigid_tre_is_the_formula_of_fitzpatrick_west_and_maurer():
    source, target = solid(9)
    r = fit_registration(source, target, model="rigid")
    centre = source.mean(axis=0)
    _, axes = np.linalg.eigh(np.cov((source - centre).T))

    def squared_distance(points, axis):
        along = (points - centre) @ axis
        return ((points - centre) ** 2).sum(axis=1) - along**2

    f2 = [squared_distance(source, axes[:, k]).mean() for k in range(3)]
    d2 = [squared_distance(SOLID_TARGETS, axes[:, k]) for k in range(3)]
    expected = r.fle_rms_m**2 / 9 * (1 + sum(d / f for d, f in zip(d2, f2, strict=True)) / 3)
    assert_allclose(r.tre_m(SOLID_TARGETS), np.sqrt(expected), rtol=1e-9)


@every_model
@flat_and_solid
def test_covariance_of_the_transform_predicts_the_same_error(model, kind):
    source, target, spacing = markers(kind)
    r = fit_registration(source, target, model=model, pixel_spacing=spacing)
    x = homogeneous(source[:3])
    k = x.shape[1]
    c = r.covariance.reshape(3, k, 3, k)
    expected = np.einsum("mi,aibj,mj->mab", x, c, x)
    squares = np.trace(expected, axis1=1, axis2=2)
    assert_allclose(r.tre_m(source[:3]) ** 2, squares, rtol=1e-9)


@every_model
@flat_and_solid
@pytest.mark.parametrize("origin", [0.0, 1e3])
def test_no_unit_origin_or_rotation_changes_anything(model, kind, origin):
    """Target in another unit, far from its origin, turned: errors scale, nothing else moves."""
    source, target, spacing = markers(kind)
    base = fit_registration(source, target, model=model, pixel_spacing=spacing)
    turn = R @ R
    shift = np.array([origin, -origin, origin / 3])
    moved = fit_registration(source, target @ turn.T + shift, model=model, pixel_spacing=spacing)
    curve = source[:4] * 0.9
    for name in ("residuals_m", "loo_m", "studentised_f"):
        assert_allclose(getattr(moved, name), getattr(base, name), rtol=1e-8)
    assert_allclose(moved.fre_rms_m, base.fre_rms_m, rtol=1e-9)
    for name in ("tre_m", "tre95_m"):
        moved_m, base_m = (getattr(r, name)(curve) for r in (moved, base))
        assert_allclose(moved_m, base_m, rtol=1e-9)
    expected = base.apply(curve) @ turn.T + shift
    assert_allclose(moved.apply(curve), expected, atol=1e-12 * max(1, origin))
    if (kind == "solid" and model != "rigid") or kind == "planar":
        self_scale = 1e3 if spacing is None else 1.0
        in_mm = {"model": model, "pixel_spacing": spacing and spacing * 1e3}
        mm = fit_registration(source * self_scale, target * 1e3, **in_mm)
        assert_allclose(mm.residuals_m / 1e3, base.residuals_m, rtol=1e-9)
        bound_m = mm.tre95_m(curve * self_scale) / 1e3
        assert_allclose(bound_m, base.tre95_m(curve), rtol=1e-9)


def test_weights_an_axis_in_space_give_the_minimum_that_scipy_finds():
    source, target = solid(6)
    sigma = np.exp(np.random.default_rng(2).normal(np.log(3e-4), 0.7, (6, 3)))
    T = fit_registration(source, target, model="rigid", sigma=sigma).T_target_source

    def left(move):
        turn = Rotation.from_rotvec(move[:3]).as_matrix() @ T[:3, :3]
        return ((target - source @ turn.T - T[:3, 3] - move[3:]) / sigma).ravel()

    best = least_squares(left, np.full(6, 1e-4), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert_allclose(best.x, 0, atol=1e-8)


def degrees_of_freedom(count):
    rng = np.random.default_rng(count)
    fractions, whole = np.linspace(1, 3, 30), np.arange(1, 61)
    return rng.choice(np.concatenate([fractions, whole]), count), rng.integers(1, 300, count)


def test_probabilities_are_scipys():
    dof, other_dof = degrees_of_freedom(2000)
    f = np.exp(np.random.default_rng(1).normal(0, 2, 2000))
    expected = fdtrc(dof, other_dof, f)
    assert f_exceeds(dof, other_dof, f) == pytest.approx(expected, rel=1e-11, abs=1e-300)


@pytest.mark.parametrize("probability", [0.01, 0.5, 0.95, 0.99, 0.999, 1 - 1e-6])
def test_quantiles_are_scipys(probability):
    dof, other_dof = degrees_of_freedom(1000)
    expected = fdtri(dof, other_dof.astype(float), probability)
    assert f_quantile(dof, other_dof, probability) == pytest.approx(expected, rel=1e-9)


def test_two_and_two_degrees_of_freedom_have_a_closed_form():
    """F of two and two degrees of freedom exceeds f with 1 / (1 + f)."""
    assert f_quantile(2, 2, 0.95) == pytest.approx(19.0, rel=1e-12)
    assert f_exceeds(2, 2, 3.0) == pytest.approx(0.25, rel=1e-14)


def test_the_ends_of_the_range():
    assert f_exceeds(3, 4, 0.0) == 1
    assert f_exceeds(3, 4, np.inf) == 0
    assert np.isnan(f_exceeds(3, 4, np.nan))
