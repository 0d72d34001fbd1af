"""What the markers say against themselves: outliers, exchanged labels, symmetry, mirrors, reach."""

from __future__ import annotations

import json

import numpy as np
import pytest
from layouts import MODELS, PX, grid, planar, solid

from vfplan.errors import CheckFailed, MarkerError, SettingError
from vfplan.registration import fit_registration
from vfplan.registration.bounds import check_max_tre, target_error
from vfplan.registration.diagnosis import diagnose
from vfplan.registration.register import describe

NAMES = [f"x{i}" for i in range(1, 10)]


def fit(source, target, model="affine", **kwargs):
    planar_source = np.shape(source)[1] == 2
    return fit_registration(
        source,
        target,
        model=model,
        labels=NAMES[: len(source)],
        **({"pixel_spacing": PX} if planar_source else {}),
        **kwargs,
    )


@pytest.mark.parametrize(("size", "least"), [(2e-3, 0.5), (3e-3, 0.9), (5e-3, 0.99)])
def test_one_outlier_is_found_by_name(size, least):
    rng, found = np.random.default_rng(1), 0
    for _ in range(200):
        target = planar(grid(), seed=rng.integers(1 << 30))
        bad, push = rng.integers(9), rng.normal(size=3)
        target[bad] += push / np.linalg.norm(push) * size
        found += fit(grid(), target).outliers == (NAMES[bad],)
    assert found / 200 >= least


@pytest.mark.parametrize("model", MODELS)
def test_good_markers_are_flagged_once_in_twenty_sets(model):
    rng = np.random.default_rng(2)
    flagged = sum(
        bool(fit(grid(), planar(grid(), seed=rng.integers(1 << 30)), model).outliers)
        for _ in range(600)
    )
    assert 0.02 < flagged / 600 < 0.08


def test_an_exact_fit_has_no_outliers_whatever_its_rounding():
    source = np.round(grid())
    for scale in (1e-3, 1.0, 1e3):
        target = np.column_stack([source * scale + 1e3 * scale, np.zeros(9)])
        r = fit(source, target)
        assert r.outliers == ()
        assert diagnose(r).suspects == {}


@pytest.mark.parametrize("model", MODELS)
def test_exchanged_labels_are_diagnosed(model):
    rng = np.random.default_rng(3)
    for _ in range(40):
        target = planar(grid(), seed=rng.integers(1 << 30))
        i, j = sorted(rng.permutation(9)[:2])
        target[[i, j]] = target[[j, i]]
        d = diagnose(fit(grid(), target, model))
        assert d.swapped == (NAMES[i], NAMES[j])
        assert {NAMES[i], NAMES[j]} <= set(d.suspects)
        assert f"{NAMES[i]} and {NAMES[j]} are exchanged" in d.warnings[0]


def test_exchanged_labels_are_diagnosed_when_robust_left_them_out():
    target = planar(grid())
    target[[1, 6]] = target[[6, 1]]
    r = fit(grid(), target, robust=True)
    assert set(r.outliers) == {"x2", "x7"}
    assert diagnose(r).swapped == ("x2", "x7")


@pytest.mark.parametrize("model", MODELS)
def test_correct_labels_are_left_in_peace(model):
    for seed in range(60):
        d = diagnose(fit(grid(), planar(grid(), seed=seed), model))
        assert d.swapped is None
        assert d.labellings == 1


def test_outliers_that_hide_each_other_are_suspects():
    target = planar(grid())
    target[0] += [0.006, 0, 0]
    target[8] += [0.006, 0, 0.001]
    r = fit(grid(), target, "rigid")
    assert set(diagnose(r).suspects) == {"x1", "x9"}


@pytest.mark.parametrize(
    ("model", "stretch", "labellings"),
    [("affine", 1, 8), ("affine", 1.5, 4), ("similarity", 1, 8), ("rigid", 1.5, 4)],
)
def test_symmetric_layouts_are_warned_of(model, stretch, labellings):
    u, v = np.meshgrid([100.0, 400, 700], np.array([80.0, 380, 680]) * stretch)
    source = np.column_stack([u.ravel(), v.ravel()])
    d = diagnose(fit(source, planar(source), model))
    assert d.labellings == labellings
    assert any(f"{labellings} labellings fit" in line for line in d.warnings)


def test_symmetry_in_space():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * 0.1
    target = corners + np.random.default_rng(0).normal(0, 1e-4, (8, 3))
    assert diagnose(fit(corners, target, "rigid")).labellings == 24  # the cube's rotations
    source, moved = solid(8)
    assert diagnose(fit(source, moved, "rigid")).labellings == 1


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("flip", [[1, 1, -1], [-1, 1, 1], [-1, -1, -1]])
def test_mirrored_markers_in_space_are_refused(model, flip):
    source, target = solid(8)
    with pytest.raises(MarkerError, match="mirrored"):
        fit(source * flip, target, model)
    with pytest.raises(MarkerError, match="mirrored"):
        fit(source[:, [1, 0, 2]], target, model)


def test_flat_markers_in_space_are_not_called_mirrored():
    source, _ = solid(6)
    flat = source * [1, 1, 0]
    for seed in range(50):
        target = flat + np.random.default_rng(seed).normal(0, 3e-4, (6, 3))
        fit(flat, target, "rigid")
        fit(flat * [-1, 1, 1], target, "rigid")


@pytest.mark.parametrize("model", MODELS)
def test_a_mirrored_slice_is_refused_where_the_viewer_is_known(model):
    source = grid()
    flat = np.column_stack([source[:, 0], -source[:, 1], np.zeros(9)]) * PX  # seen from above
    fit(source, flat, model, seen_from=[0, 0, 1])
    with pytest.raises(MarkerError, match="mirrored"):
        fit(source, flat * [-1, 1, 1], model, seen_from=[0, 0, 1])
    for bad in ([0, 0, 0], [1, 2], [np.nan, 0, 1]):
        with pytest.raises(SettingError, match="seen_from"):
            fit(source, flat, model, seen_from=bad)


def test_scale_anisotropy_shear_normal():
    source = grid()
    angle = np.radians(80)
    u_axis, v_axis = np.array([6e-4, 0, 0]), 5e-4 * np.array([np.cos(angle), -np.sin(angle), 0])
    target = source @ np.array([u_axis, v_axis]) + [0.1, 0.2, 0.3]
    g = fit(source, target).geometry
    np.testing.assert_allclose(g.axis_scales, [6e-4, 5e-4], rtol=1e-9)
    np.testing.assert_allclose(g.shear, np.cos(angle), rtol=1e-9)
    np.testing.assert_allclose(g.normal, [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(g.scale, np.sqrt(6e-4 * 5e-4 * np.sin(angle)), rtol=1e-9)
    assert g.anisotropy == pytest.approx(g.singular_values[0] / g.singular_values[1] - 1)


@pytest.mark.parametrize("model", MODELS)
def test_departure_from_a_known_spacing_is_reported(model):
    r = fit_registration(grid(), planar(grid()), model=model, pixel_spacing=PX * 1.02)
    d = diagnose(r)
    np.testing.assert_allclose(d.spacing_departure, 1 / 1.02 - 1, atol=2e-3)
    assert any("departs" in line for line in d.warnings)
    assert diagnose(fit(grid(), planar(grid()), model)).warnings == ()
    r = fit_registration(grid(), planar(grid()), model="affine")
    assert diagnose(r).spacing_departure is None


def test_anisotropic_spacing_is_u_then_v():
    source = grid()
    spacing = (5e-4, 6e-4)
    target = np.column_stack([source * spacing, np.zeros(9)])
    for model in ("rigid", "similarity"):
        r = fit_registration(source, target, model=model, pixel_spacing=spacing)
        assert r.fre_rms_m < 1e-12
        np.testing.assert_allclose(r.geometry.axis_scales, spacing)
        wrong = fit_registration(source, target, model=model, pixel_spacing=spacing[::-1])
        assert wrong.fre_rms_m > 5e-3


def test_curve_points_beyond_the_markers():
    r = fit(grid(), planar(grid()))
    inside = target_error(r, np.array([[400.0, 380], [420, 350]]))
    assert inside.warnings == ()
    out = target_error(r, np.array([[400.0, 380], [1200, 380], [400, 1500]]))
    assert out.outside_hull.tolist() == out.extrapolated.tolist() == [False, True, True]
    assert out.worst == 2
    assert "2 of 3 curve points (67%) lie beyond the markers" in out.warnings[0]
    r = fit(*solid(8), "rigid")
    assert target_error(r, np.array([[0.0, 0, 0], [1, 1, 1]])).outside_hull.tolist() == [0, 1]


def test_the_gate():
    r = fit(grid(), planar(grid()))
    error = target_error(r, grid())
    check_max_tre(error, 2e-3)
    with pytest.raises(CheckFailed, match=r"may reach 0\.\d+ mm .* 0\.1 mm allowed") as caught:
        check_max_tre(error, 1e-4)
    assert caught.value.exit_code == 1
    assert error.curve95_m.max() > error.bound95_m.max() > error.rms_m.max()


def test_long_layouts_unchecked_and_coincident_markers_are_warned_of():
    source = np.column_stack([np.linspace(0, 900, 8), [0, 20, 5, 30, 2, 25, 10, 15.0]])
    d = diagnose(fit(source, planar(source)))
    assert any("times as long as wide" in line for line in d.warnings)
    source = np.array([[0, 0], [10, 0], [0, 10], [10, 10], [5, 5.5], [900, 950.0]])
    d = diagnose(fit(source, planar(source)))
    assert d.unchecked == ("x6",)
    assert any("no other marker checks x6" in line for line in d.warnings)
    source = grid()
    source[1] = source[0]
    d = diagnose(fit(source, planar(source)))
    assert "markers x1 and x2 stand at the same place in the source" in d.warnings


def test_a_transform_that_explains_nothing_is_refused():
    rng = np.random.default_rng(0)
    touched_once = rng.normal(0, 3e-4, (9, 3))  # one place, again and again
    shuffled = planar(grid())[rng.permutation(9)]
    thin = np.column_stack([np.linspace(0, 600, 6), [300, 301, 299.5, 300.5, 299, 300]])
    for model in MODELS:
        for source, target in ((grid(), touched_once), (grid(), shuffled), (thin, planar(thin))):
            with pytest.raises(MarkerError, match=r"does not explain the markers|collinear"):
                fit(source, target, model)
    with pytest.raises(MarkerError, match="does not explain"):
        fit_registration(grid(), planar(grid()), model="rigid", pixel_spacing=20 * PX)


def test_stated_sigmas_are_checked_against_the_residuals():
    r = fit(grid(), planar(grid()), sigma=np.full(9, 3e-4))
    assert diagnose(r).warnings == ()
    assert 0.6 < describe(r)["residuals_over_stated_sigma"] < 1.4
    r = fit(grid(), planar(grid()), sigma=np.full(9, 1e-4))
    assert any("times what the stated sigmas allow" in line for line in diagnose(r).warnings)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("robust", [False, True])
def test_the_report_is_json(model, robust):
    from vfplan.io.disk import jsonable

    for source, target in ((grid(), planar(grid())), solid(6)):
        r = fit(source, target, model, robust=robust)
        text = json.dumps(jsonable(describe(r, source)), allow_nan=False)
        report = json.loads(text)
        assert report["tre"]["curve95_max_m"] >= report["tre"]["bound95_max_m"]
        assert [m["label"] for m in report["residuals"]] == NAMES[: len(source)]
    small = fit(grid(4), planar(grid(4)))
    report = json.loads(json.dumps(jsonable(describe(small)), allow_nan=False))
    assert report["residuals"][0]["f"] is None  # no degree of freedom is left to test with


def test_robust_refuses_a_search_without_end():
    rng = np.random.default_rng(0)
    source = rng.uniform(0, 1, (100, 3))
    with pytest.raises(SettingError, match="3921225 subsets of 4 of 100 markers"):
        fit_registration(source, source, robust=True)
    many = rng.uniform(0, 1, (140, 2))
    target = np.column_stack([many, np.zeros(140)]) + rng.normal(0, 1e-3, (140, 3))
    target[7] += 0.1
    assert 7 in fit_registration(many, target, robust=True).outliers


@pytest.mark.parametrize("model", ["similarity", "rigid"])
def test_three_markers_cannot_show_their_labels(model):
    source = np.array([[100.0, 100], [700, 100], [400, 619.6]])
    d = diagnose(fit(source, planar(source), model))
    assert d.labellings > 1
    assert any("cannot show how they are labelled" in line for line in d.warnings)


@pytest.mark.parametrize("model", ["similarity", "rigid"])
def test_a_slice_stretched_along_one_axis_is_said(model):
    target = planar(grid())
    assert not any(
        "as long as wide" in line for line in diagnose(fit(grid(), target, model)).warnings
    )
    d = diagnose(fit(grid() * [1, 0.9], target, model))
    assert any("as long as wide" in line for line in d.warnings)


def test_a_column_in_another_unit_and_markers_wider_than_a_scanner_are_said():
    (warning,) = diagnose(fit_registration(grid(), planar(grid()) * [3, 1, 1])).warnings
    assert "times as long as wide" in warning
    (warning,) = diagnose(fit_registration(grid(), 10 * planar(grid()))).warnings
    assert "is the unit metres?" in warning
