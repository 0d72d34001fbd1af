"""The safety margin: a thicker fixture, or a curve moved to the side asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from layouts import MODELS, PX, R, grid, solid
from margins import CLOCKWISE, LINE, MADE, T, drawn, registered
from scipy.spatial import cKDTree

from vfplan.errors import CurveError, SettingError
from vfplan.fixture import Fixture
from vfplan.planning.margin import add_margin
from vfplan.planning.settings import FixtureSettings
from vfplan.registration import fit_registration


def moved(curve, side, registration=None):
    registration = registration or registered()
    settings = FixtureSettings(margin="tre95", margin_side=side)
    return add_margin(curve, registration, settings)


COUNTER = drawn(np.c_[400 + 150 * np.cos(T), 380 - 150 * np.sin(T)], closed=True)


def test_both_sides_is_a_larger_point_radius():
    registration = registered()
    settings = FixtureSettings(margin="tre95", point_radius=1e-3)
    curve, thicker, margin = add_margin(LINE, registration, settings)
    assert curve is LINE
    largest = np.ceil(registration.tre95_curve_m(LINE.points).max() * 1e9) / 1e9
    assert thicker.point_radius == 1e-3 + largest
    assert margin.report == {
        "kind": "tre95",
        "side": "both",
        "largest_m": largest,
        "added_point_radius_m": largest,
    }


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(("side", "up"), [("left", -1), ("right", 1)])
def test_left_and_right_are_those_of_the_drawing_hand(model, side, up):
    """A line drawn to the right: its left is up in the image, at smaller v."""
    registration = registered(model)
    curve, settings, margin = moved(LINE, side, registration)
    assert settings.point_radius == 0
    step = registration.apply(curve.points) - registration.apply(LINE.points)
    bound = registration.tre95_curve_m(LINE.points)
    np.testing.assert_allclose(np.linalg.norm(step, axis=1), bound, rtol=1e-6)
    assert (np.sign(curve.points[:, 1] - LINE.points[:, 1]) == up).all()
    assert margin.largest_m == bound.max()


@pytest.mark.parametrize("curve", [CLOCKWISE, COUNTER])
@pytest.mark.parametrize(("side", "sign"), [("inside", -1), ("outside", 1)])
def test_inside_and_outside_do_not_depend_on_the_direction(curve, side, sign):
    out, _, margin = moved(curve, side)
    radius = np.hypot(*(out.points[:, :2] - [400, 380]).T)
    assert (np.sign(radius - 150) == sign).all()
    assert margin.dropped == 0
    assert curve.curve.closed.all()


def test_a_mirrored_slice_keeps_the_sides_of_the_image():
    target = np.c_[grid() * PX * [1, -1], np.zeros(9)] @ R.T
    for flip in ([1, 1, 1], [-1, 1, 1]):
        noise = np.random.default_rng(0).normal(0, 1e-4, (9, 3))
        registration = fit_registration(grid(), target * flip + noise)
        out, _, _ = moved(LINE, "left", registration)
        assert (out.points[:, 1] < LINE.points[:, 1]).all()


def test_a_bend_tighter_than_the_margin_loses_its_inner_points():
    corner = np.r_[
        np.c_[np.linspace(300, 400, 401), np.full(401, 380.0)],
        np.c_[np.full(400, 400.0), np.linspace(380.25, 480, 400)],
    ]
    registration = registered()
    curve = drawn(corner)
    out, _, margin = moved(curve, "right", registration)  # the hollow side
    assert 0 < margin.dropped < 20
    distance, _ = cKDTree(registration.apply(corner)).query(registration.apply(out.points))
    assert distance.min() > 0.95 * registration.tre95_curve_m(corner).min()
    full, _, full_margin = moved(curve, "left", registration)  # around the corner
    assert full_margin.dropped == 0
    assert len(full.points) > len(corner)
    line = registration.apply(full.points)
    t = np.linspace(0, 1, 50)[:, None, None]
    dense = (line[:-1] * (1 - t) + line[1:] * t).reshape(-1, 3)
    distance, _ = cKDTree(registration.apply(corner)).query(dense)
    assert distance.min() > 0.995 * registration.tre95_curve_m(corner).min()


def test_a_smooth_bend_stays_smooth():
    """A circle drawn with 0.15 rad a sample moves to a circle, sample by sample."""
    t = np.linspace(0, 2 * np.pi, 42, endpoint=False)
    ring = drawn(np.c_[400 + 12 * np.cos(t), 380 + 12 * np.sin(t)], closed=True)
    registration = registered("similarity")
    out, _, _ = moved(ring, "outside", registration)
    assert len(out.points) == 42
    radius = np.hypot(*(out.points[:, :2] - [400, 380]).T) * registration.geometry.scale
    expected = 12 * registration.geometry.scale + registration.tre95_curve_m(ring.points)
    np.testing.assert_allclose(radius, expected, atol=3e-6)


def test_what_belongs_to_a_sample_stays_with_it():
    curve = replace(
        CLOCKWISE,
        sigma=np.arange(800.0),
        curve=replace(CLOCKWISE.curve, bridged=np.arange(800) % 7 == 0),
    )
    out, _, _ = moved(curve, "inside")
    assert len(out.points) == len(out.sigma) == len(out.curve.bridged) == len(out.curve.stroke)


def test_refusals():
    registration = registered()
    for settings, message in (
        ({"margin": "tre99"}, "'tre95' or none"),
        ({"margin": "tre95", "margin_side": "up"}, "both, left, right, inside, outside"),
        ({"margin": "tre95", "margin_side": "inside"}, "an open curve has no inside"),
    ):
        with pytest.raises(SettingError, match=message):
            add_margin(LINE, registration, FixtureSettings(**settings))
    for margin in (True, -1, np.inf, "1"):
        with pytest.raises(SettingError, match="metres of at least 0"):
            add_margin(LINE, registration, FixtureSettings(margin=margin))
    cloud = Fixture("image", LINE.points, MADE)
    with pytest.raises(SettingError, match="needs an ordered curve"):
        moved(cloud, "left")
    source, target = solid(8)
    space = fit_registration(source, target, model="rigid")
    with pytest.raises(SettingError, match="drawn in a plane"):
        moved(drawn(source[:, :2]), "left", space)
    dot = drawn(np.c_[400 + 0.1 * np.cos(T), 380 + 0.1 * np.sin(T)], closed=True)
    with pytest.raises(CurveError, match="leaves nothing of stroke 0"):
        moved(dot, "inside")


def test_the_protected_side_stays_protected():
    """Moved by the band, the true curve is crossed nowhere in 95 % of registrations."""
    source, rng = grid(), np.random.default_rng(1)
    flat = np.c_[source * PX, np.zeros(9)] @ R.T
    line = LINE.points[::20, :2]
    truth = np.c_[line * PX, np.zeros(len(line))] @ R.T
    up = R @ np.array([0.0, -1.0, 0.0])  # the left of a line drawn to the right
    kept = 0
    for _ in range(50):
        registration = fit_registration(source, flat + rng.normal(0, 3e-4, (9, 3)))
        out, _, _ = moved(drawn(line), "left", registration)
        gap = (registration.apply(out.points) - truth) @ up
        kept += bool((gap > 0).all())
    assert kept / 50 > 0.95  # one-sided, so more than the band's 95 %


@pytest.mark.parametrize("none", [0, 0.0])
def test_no_margin_moves_nothing(none):
    for side in ("both", "left"):
        made, _, margin = add_margin(
            LINE, registered(), FixtureSettings(margin=none, margin_side=side)
        )
        assert (margin.largest_m, margin.dropped) == (0.0, 0)
        assert np.allclose(made.points, LINE.points, atol=1e-9)
