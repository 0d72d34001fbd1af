"""Perspective is said, widens the bounds so that they hold, and blames no good marker."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT
from docs_modules import load
from layouts import MODELS, PX, grid, planar

from vfplan.registration import fit_registration
from vfplan.registration.bounds import perspective
from vfplan.registration.diagnosis import diagnose

plates = load(ROOT / "docs" / "make_perspective_table.py")


def bent(source, q=(2e-4, -1e-4), noise=3e-4, seed=0):
    """Markers whose picture is the homography of a plane."""
    target = planar(source, 0) / (1 + (source - [400, 380]) @ q)[:, None]
    return target + np.random.default_rng(seed).normal(0, noise, target.shape)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("robust", [False, True])
def test_it_is_said_and_no_good_marker_is_suspect(model, robust):
    r = fit_registration(grid(), bent(grid()), model=model, robust=robust, pixel_spacing=PX)
    assert r.perspective is not None
    assert r.used.all()
    found = diagnose(r)
    assert found.suspects == {}
    assert any("perspective" in warning for warning in found.warnings)


def test_the_homography_is_found():
    source = grid()
    seen = perspective(fit_registration(source, bent(source, noise=1e-9)).fit)
    s = fit_registration(source, bent(source)).normalised(np.array([[333.0, 222], [650, 500]]))
    exact = bent(np.array([[333.0, 222], [650, 500]]), noise=0)
    centre = bent(source, noise=1e-9).mean(axis=0)
    np.testing.assert_allclose(seen.apply(s) + centre, exact, atol=2e-8)


def test_a_bad_marker_is_not_called_perspective():
    for bad in range(9):
        target = planar(grid(), seed=bad)
        target[bad] += [0.004, 0.003, 0]
        r = fit_registration(grid(), target)
        assert r.perspective is None
        assert r.outliers == (bad,)


def test_good_markers_show_it_seldom():
    seen = [fit_registration(grid(), planar(grid(), seed=k)).perspective for k in range(400)]
    assert np.mean([one is not None and one.sure for one in seen]) < 0.02
    assert np.mean([one is not None for one in seen]) < 0.14


@pytest.mark.parametrize("tilt", [0, 2, 5, 20])
def test_the_bounds_hold_whatever_the_tilt(tilt):
    point = []
    for source, touched, curve, true in plates.plates(9, tilt, 60):
        r = fit_registration(source, touched)
        error = np.linalg.norm(r.apply(curve) - true, axis=1)
        point.append((error <= r.tre95_m(curve)).mean())
    assert np.mean(point) > 0.9


@pytest.mark.parametrize("sets", [4, pytest.param(1000, marks=pytest.mark.full)])
@pytest.mark.parametrize("tilt", [0, 1, 2, 5, 20])
@pytest.mark.parametrize("n", [6, 9])
def test_a_whole_curve_is_bound_whatever_the_tilt(n, tilt, sets):
    held = []
    for source, touched, curve, true in plates.plates(n, tilt, sets):
        r = fit_registration(source, touched)
        whole = r.tre95_curve_m(curve)
        assert (whole >= r.tre95_m(curve)).all()
        held.append((np.linalg.norm(r.apply(curve) - true, axis=1) <= whole).all())
    assert np.mean(held) >= (0.94 if sets > 100 else 0.5)
    if sets > 100 and tilt == 0:
        assert np.mean(held) < 0.98


@pytest.mark.parametrize("view", [0, 3])
def test_the_bounds_hold_in_real_photographs(shared_data, view):
    point, whole, said = [], [], []
    for source, touched, curve, true in plates.photos(shared_data / "photo_px_to_mm", view, 9, 40):
        r = fit_registration(source, touched)
        error = np.linalg.norm(r.apply(curve) - true, axis=1)
        point.append((error <= r.tre95_m(curve)).mean())
        whole.append((error <= r.tre95_curve_m(curve)).all())
        said.append(r.perspective is not None and r.perspective.sure)
    assert np.mean(said) > 0.95
    assert np.mean(point) > 0.94
    assert np.mean(whole) >= 0.93
