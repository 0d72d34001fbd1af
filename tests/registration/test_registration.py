"""Registration against independent solvers, published figures and planted truth."""

from __future__ import annotations

import json

import numpy as np
import pytest
from layouts import NAMES, PX, R, every_model, fit, grid, markers, photograph, planar, solid
from numpy.testing import assert_allclose

import vfplan
from vfplan.errors import MarkerError, SettingError
from vfplan.io.files import to_json_types
from vfplan.registration.models import fit_model, make_problem, marker_rows
from vfplan.registration.registration import (
    describe_side,
    fit_registration,
    registration_report,
    target_error,
)


def test_affine_is_ordinary_least_squares():
    source = grid()
    target = planar(source)
    x = np.column_stack([source, np.ones(len(source))])
    b, sse, _, _ = np.linalg.lstsq(x, target, rcond=None)
    r = fit_registration(source, target)
    assert_allclose(r.T_target_source, b.T, rtol=1e-12, atol=1e-15)
    assert_allclose(r.fre_rms_m, np.sqrt(sse.sum() / 9), rtol=1e-12)
    h = np.diag(x @ np.linalg.inv(x.T @ x) @ x.T)
    assert_allclose(r.leverage, h, rtol=1e-9)
    assert_allclose(r.covariance[:3, :3], sse.sum() / 18 * np.linalg.inv(x.T @ x))
    assert_allclose(r.tre_m(source), np.sqrt(3 * sse.sum() / 18 * h), rtol=1e-9)


def test_solid_rigid_and_similarity_agree_with_scipy_and_skimage():
    from scipy.spatial.transform import Rotation
    from skimage.transform import SimilarityTransform

    source, target = solid()
    r = fit_registration(source, target, model="rigid")
    found, _ = Rotation.align_vectors(target - target.mean(0), source - source.mean(0))
    assert_allclose(r.T_target_source[:3, :3], found.as_matrix(), atol=1e-12)
    other = SimilarityTransform.from_estimate(source, target)
    s = fit_registration(source, target, model="similarity")
    assert_allclose(s.T_target_source, other.params, atol=1e-12)


@every_model
@pytest.mark.parametrize("kind", ["planar", "solid"])
def test_leave_one_out_is_what_refitting_gives(model, kind):
    source, target, spacing = markers(kind, 7)
    r = fit_registration(source, target, model=model, pixel_spacing=spacing)
    for i in range(len(source)):
        keep = np.arange(len(source)) != i
        other = fit_registration(source[keep], target[keep], model=model, pixel_spacing=spacing)
        error = np.linalg.norm(other.apply(source[i : i + 1]) - target[i])
        assert_allclose(r.loo_m[i], error, rtol=1e-9)


def test_published_rigid_registration(shared_data):
    folder = shared_data / "pelvis_phantom"
    tracker = np.loadtxt(folder / "Tracker_Fiducial_Markers.txt")
    ct = np.loadtxt(folder / "pelvis_cropped_ct_fiducial_markers.txt")
    published = np.loadtxt(folder / "Tracker_to_pelvis_cropped.txt")
    r = fit_registration(tracker / 1e3, ct / 1e3, model="rigid")
    assert abs(r.fre_rms_m * 1e3 - 0.428411) < 1e-6
    published[:3, 3] /= 1e3
    assert_allclose(r.T_target_source, published, atol=1e-12)


@pytest.mark.parametrize("view, similarity_mm, affine_mm", [(0, 0.344, 0.330), (3, 1.941, 1.520)])
def test_photographs_of_a_board(shared_data, view, similarity_mm, affine_mm):
    pixels, board_mm = photograph(shared_data, view)
    for model, rms_mm in (("similarity", similarity_mm), ("affine", affine_mm)):
        r = fit_registration(pixels, board_mm / 1e3, model=model)
        assert abs(r.fre_rms_m * 1e3 - rms_mm) < 6e-4


@pytest.mark.parametrize("name", ["a", "b", "c"])
@every_model
def test_planned_slices_stay_within_the_predicted_bound(shared_data, name, model):
    folder = shared_data / "planned"
    files = [folder / f"pelvis_{name}_markers_{side}.csv" for side in ("image", "robot")]
    read = vfplan.read_markers(*files)
    truth = json.loads((folder / f"pelvis_{name}_truth.json").read_text())
    curve = np.loadtxt(folder / f"pelvis_{name}_truth_px.csv", delimiter=",", skiprows=1)[:, -2:]
    spacing = truth["pixel_spacing_mm"] / 1e3
    r = fit(read.source, read.target, model, labels=read.labels, pixel_spacing=spacing)
    exact = np.column_stack([curve, np.ones(len(curve))]) @ np.array(truth["T_robot_image_3x3"]).T
    error = np.linalg.norm(r.apply(curve) - exact, axis=1)
    assert (error < r.tre95_curve_m(curve)).all()
    assert 0.5 < r.sigma_m / truth["marker_noise_sigma_m"] < 1.5
    assert r.outliers == ()
    assert r.labels == tuple(NAMES)


LINE = np.column_stack([np.linspace(0, 500, 6), np.linspace(0, 250, 6)])
REFUSED = [
    ("markers-collinear", LINE, planar(grid(6))),
    ("markers-collinear", grid(6), np.column_stack([LINE, LINE[:, 0]]) * 1e-3),
    ("markers-coincide", np.full((5, 2), 7.1), planar(grid(5))),
    ("markers-coincide", grid(5), np.full((5, 3), 0.3)),
    ("too-few-markers", grid(2), planar(grid(2))),
    ("too-few-markers", np.empty((0, 2)), np.empty((0, 3))),
    ("markers-not-finite", np.where(np.indices((5, 2))[0] == 2, np.nan, grid(5)), planar(grid(5))),
    ("markers-too-large", grid(5), planar(grid(5)) * 1e200),
    ("markers-shape", grid(5), planar(grid(4))),
    ("markers-shape", np.zeros((5, 4)), planar(grid(5))),
    ("markers-shape", grid(5), np.zeros((5, 2))),
    ("markers-not-numbers", [["a", "b"]] * 5, planar(grid(5))),
]


def code_of(error, *args, **kwargs):
    with pytest.raises(error) as caught:
        fit_registration(*args, **kwargs)
    return caught.value.code


@every_model
@pytest.mark.parametrize("code, source, target", REFUSED)
def test_degenerate_markers_are_refused(code, source, target, model):
    assert code_of(MarkerError, source, target, model=model, pixel_spacing=PX) == code


def test_affine_needs_a_residual_and_a_solid_one_depth():
    assert code_of(MarkerError, grid(3), planar(grid(3))) == "too-few-markers"
    assert code_of(MarkerError, *solid(4)) == "too-few-markers"
    source, _ = solid(8)
    flat = source * [1, 1, 0]
    assert code_of(MarkerError, flat, flat @ R.T) == "markers-coplanar"
    fit_registration(flat, flat @ R.T, model="rigid")
    assert code_of(SettingError, *solid(), pixel_spacing=1e-3) == "pixel-spacing-useless"


@pytest.mark.parametrize("settings, code", [
    ({"model": "homography"}, "model-unknown"),
    ({"model": "rigid"}, "pixel-spacing-missing"),
    ({"pixel_spacing": 0.0}, "pixel-spacing-range"),
    ({"pixel_spacing": (1e-3, np.nan)}, "pixel-spacing-range"),
    ({"seen_from": [0, 0, 0]}, "seen-from-range"),
    ({"seen_from": [1, 2]}, "seen-from-range"),
    ({"seen_from": "left"}, "seen-from-range"),
    ({"seen_from": [np.nan, 0, 1]}, "seen-from-range"),
    ({"source": [[1, 2], [3]]}, "markers-not-numbers"),
    ({"labels": ["a"] * 9}, "label-doubled"),
    ({"sigma": "x"}, "markers-not-numbers"),
    ({"sigma": np.ones(4)}, "sigma-shape"),
    ({"sigma": np.zeros(9)}, "sigma-range"),
])  # fmt: skip
def test_settings_are_checked(settings, code):
    names_markers = code.startswith(("markers", "sigma", "label"))
    error = MarkerError if names_markers else SettingError
    assert code_of(error, **{"source": grid(), "target": planar(grid())} | settings) == code


@pytest.mark.parametrize("points", [[[np.nan, 1]], "x", [[1, 2, 3]], [], np.zeros((2, 2, 2))])
def test_points_are_checked(points):
    with pytest.raises(SettingError) as caught:
        fit_registration(grid(), planar(grid())).tre95_m(points)
    assert caught.value.code in ("points-shape", "points-not-finite")


@every_model
def test_robust_names_what_it_leaves_out(model):
    source = grid()
    target = planar(source)
    target[2] += [0.004, -0.003, 0.0]
    target[7] += [-0.005, 0.0, 0.004]
    r = fit(source, target, model, robust=True)
    assert r.outliers == ("x3", "x8")
    assert r.used.sum() == 7
    good = np.array([i for i in range(9) if i not in (2, 7)])
    alone = fit(source[good], target[good], model)
    assert_allclose(r.T_target_source, alone.T_target_source, rtol=1e-9)
    assert r.residuals_m[2] > 0.003
    assert_allclose(r.fre_rms_m, alone.fre_rms_m, rtol=1e-9)
    # A weight that is tiny leaves a marker out as well.
    weighted = fit(source, target, model, sigma=np.where(r.used, 1e-4, 1e3))
    assert_allclose(weighted.apply(source), alone.apply(source), rtol=1e-9)


def test_robust_refuses_a_search_without_end():
    rng = np.random.default_rng(0)
    source = rng.uniform(0, 1, (100, 3))
    assert code_of(SettingError, source, source, robust=True) == "robust-too-many"
    many = rng.uniform(0, 1, (140, 2))
    target = np.column_stack([many, np.zeros(140)]) + rng.normal(0, 1e-3, (140, 3))
    target[7] += 0.1
    assert 7 in fit_registration(many, target, robust=True).outliers


@every_model
@pytest.mark.parametrize("flip", [[1, 1, -1], [-1, 1, 1], [-1, -1, -1]])
def test_mirrored_markers_in_space_are_refused(model, flip):
    source, target = solid(8)
    assert code_of(MarkerError, source * flip, target, model=model) == "mirrored"
    assert code_of(MarkerError, source[:, [1, 0, 2]], target, model=model) == "mirrored"


def test_flat_markers_in_space_are_not_called_mirrored():
    source, _ = solid(6)
    flat = source * [1, 1, 0]
    for seed in range(50):
        target = flat + np.random.default_rng(seed).normal(0, 3e-4, (6, 3))
        fit_registration(flat, target, model="rigid")
        fit_registration(flat * [-1, 1, 1], target, model="rigid")


@every_model
def test_a_mirrored_slice_is_refused_where_the_side_is_known(model):
    source = grid()
    flat = np.column_stack([source[:, 0], -source[:, 1], np.zeros(9)]) * PX  # seen from above
    known = {"model": model, "pixel_spacing": PX, "seen_from": [0, 0, 1]}
    r = fit_registration(source, flat, **known)
    assert_allclose(r.image_faces, [0, 0, 1], atol=1e-9)
    assert describe_side(r.image_faces) == "above (robot +z)"
    assert code_of(MarkerError, source, flat * [-1, 1, 1], **known) == "mirrored"
    fit_registration(source, flat, **known | {"seen_from": "above"})
    assert code_of(MarkerError, source, flat, **known | {"seen_from": "below"}) == "mirrored"


def reported(registration, points):
    error = target_error(registration, points)
    report = to_json_types(registration_report(registration, points, error))
    return json.loads(json.dumps(report, allow_nan=False))


def test_scale_anisotropy_shear_normal():
    source = grid()
    angle = np.radians(80)
    u_axis, v_axis = np.array([6e-4, 0, 0]), 5e-4 * np.array([np.cos(angle), -np.sin(angle), 0])
    target = source @ np.array([u_axis, v_axis]) + [0.1, 0.2, 0.3]
    report = reported(fit_registration(source, target), source)
    assert report["axis_scales_m_per_px"] == pytest.approx([6e-4, 5e-4], rel=1e-9)
    assert report["shear"] == pytest.approx(np.cos(angle), rel=1e-9)
    assert report["plane_normal"] == pytest.approx([0, 0, -1], abs=1e-12)
    assert report["scale_m_per_px"] == pytest.approx(np.sqrt(3e-7 * np.sin(angle)), rel=1e-9)
    largest, smallest = report["singular_values_m_per_px"]
    assert report["anisotropy"] == pytest.approx(largest / smallest - 1)
    exact = reported(fit_registration(grid(4), planar(grid(4))), grid(4))
    assert exact["residuals"][0]["f"] is None, "nothing is left to test it by"


def test_anisotropic_spacing_is_u_then_v():
    source = grid()
    spacing = (5e-4, 6e-4)
    target = np.column_stack([source * spacing, np.zeros(9)])
    for model in ("rigid", "similarity"):
        r = fit_registration(source, target, model=model, pixel_spacing=spacing)
        assert r.fre_rms_m < 1e-12
        assert reported(r, source)["axis_scales_m_per_px"] == pytest.approx(spacing)
        wrong = fit_registration(source, target, model=model, pixel_spacing=spacing[::-1])
        assert wrong.fre_rms_m > 5e-3


T_THIN = np.array([[5.9e-4, 2e-5, 0.25], [-1e-5, -5.8e-4, 0.31], [3e-5, 4e-5, 0.12]])
NINE = np.array([(u, v) for v in (-1.0, 0.1, 1.0) for u in (-1.0, -0.1, 1.0)])


def largest_error(pixels):
    """Largest error over the markers of an affine fit to exact pairs [m]."""
    target = np.column_stack([pixels, np.ones(len(pixels))]) @ T_THIN.T
    return float(np.abs(fit_registration(pixels, target).apply(pixels) - target).max())


@pytest.mark.parametrize("condition", [1e4, 1e8, 1e12])
def test_nearly_collinear_is_right_or_refused(condition):
    try:
        found = largest_error(400 + 300 * NINE @ np.array([[1.0, 0.5], [0.0, 1.0 / condition]]))
    except MarkerError:
        return
    assert found < 1e-9 * 600 * 6e-4


def test_a_hundredth_of_a_pixel_apart():
    assert largest_error(400 + 0.01 * NINE) < 1e-9 * 2 * 0.01 * 6e-4


@pytest.mark.parametrize("model", ["similarity", "rigid"])
@pytest.mark.parametrize("bend", [0.0, 1e-3])
def test_a_fit_with_unlike_sigmas_is_a_minimum(bend, model):
    """Of markers photographed askew too, and in the wrong order, where Gauss-Newton ran away."""
    rng = np.random.default_rng(3)
    for k in range(12):
        pixels = rng.uniform(0, 800, (int(rng.integers(4, 10)), 2))
        target = np.column_stack([pixels, np.ones(len(pixels))]) @ T_THIN.T
        target /= 1 + bend * pixels[:, :1]
        target += rng.normal(0, 3e-4, target.shape)
        sigma = 10 ** rng.uniform(-5, -2.5, target.shape)
        wrong = k % 2
        spacing = PX if model == "rigid" else None
        problem = make_problem(pixels, target[:: 1 - 2 * wrong], model, spacing, sigma, None)
        fit = fit_model(problem)
        root = np.sqrt(problem.weights).reshape(-1, 1)
        moves = np.linalg.qr(root * (marker_rows(problem.x) @ problem.model.tangent(fit.m)))[0]
        left = root[:, 0] * fit.vectors.ravel()
        most = 0.1 if wrong else 1e-3  # of wrong ones it is a long way, in fifty steps
        assert np.linalg.norm(moves.T @ left) < most * np.linalg.norm(left)
