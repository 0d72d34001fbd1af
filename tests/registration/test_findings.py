"""What the markers say against themselves: every finding by its code, and none of good markers."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from conftest import ROOT
from docs_modules import load
from layouts import NAMES, PX, bent, every_model, fit, grid, photograph, planar, solid
from refusals import refuses

from vfplan.errors import CheckFailed
from vfplan.registration.checks import (
    describe_checks,
    error_findings,
    label_mistake,
    perspective_test,
    refuse_wrong_markers,
    registration_findings,
    scale_departures,
    side_finding,
)
from vfplan.registration.rectify import projected
from vfplan.registration.registration import fit_registration, single_outlier, target_error

table = load(ROOT / "docs" / "make_registration_table.py")


def codes(registration):
    return [(finding.code, finding.severity) for finding in registration_findings(registration)]


@every_model
def test_good_markers_are_flagged_once_in_a_hundred_sets(model):
    seeds = np.random.default_rng(2).integers(1 << 30, size=1200)
    flagged = [bool(fit(grid(), planar(grid(), seed=seed), model).outliers) for seed in seeds]
    assert 0.003 < np.mean(flagged) < 0.02


@pytest.mark.parametrize("size, least", [(2e-3, 0.3), (3e-3, 0.8), (5e-3, 0.98)])
def test_one_outlier_is_named_with_its_place(size, least):
    rng, named = np.random.default_rng(1), 0
    for _ in range(200):
        target = planar(grid(), seed=rng.integers(1 << 30))
        bad, push = rng.integers(9), rng.normal(size=3)
        target[bad] += push / np.linalg.norm(push) * size
        r = fit(grid(), target)
        suspects = [f for f in registration_findings(r) if f.code == "marker-suspect"]
        if r.outliers == (NAMES[bad],) and len(suspects) == 1:
            named += suspects[0].place_px == tuple(grid()[bad])
    assert named / 200 >= least


def test_what_a_robust_fit_leaves_out_is_a_note():
    target = planar(grid())
    target[3] += [0, 0.006, 0]
    assert codes(fit(grid(), target)) == [("marker-suspect", "doubt")]
    r = fit(grid(), target, robust=True)
    assert r.outliers == ("x4",)
    assert codes(r) == [("marker-left-out", "note")]


def test_a_marker_that_was_left_out_is_not_named_as_the_one_to_leave_out():
    target = planar(grid(5))
    target[0] += [0, 0.2, 0]
    r = fit(grid(5), target, robust=True)
    assert r.outliers == ("x1",)
    assert single_outlier(r) is None


def test_an_exact_fit_has_no_outliers_whatever_its_rounding():
    source = np.round(grid())
    for scale in (1e-3, 1.0):
        target = np.column_stack([source * scale + 1e3 * scale, np.zeros(9)])
        r = fit_registration(source, target)
        assert r.outliers == ()
        assert "marker-suspect" not in dict(codes(r))


@every_model
def test_a_symmetric_layout_is_one_short_note(model):
    source = grid(jitter=0.0)
    for seed in range(20):
        found = [*registration_findings(fit(source, planar(source, seed=seed), model))]
        notes = [finding for finding in found if finding.code == "layout-symmetric"]
        doubts = [finding for finding in found if finding.code == "labels-doubtful"]
        assert len(notes) + len(doubts) == 1
        assert all(len(note.text.split()) <= 15 for note in notes)
    assert label_mistake(fit(grid(), planar(grid()), model)) is None


def test_three_markers_are_a_note():
    source = np.array([[100.0, 100], [700, 130], [300, 619.6]])
    for model in ("similarity", "rigid"):
        assert codes(fit(source, planar(source), model)) == [("markers-unchecked", "note")]


def test_an_unchecked_marker_is_named():
    source = np.array([[0, 0], [300, 0], [0, 300], [300, 300], [150, 155], [900, 950.0]])
    found = registration_findings(fit(source, planar(source)))
    (finding,) = [finding for finding in found if "unchecked" in finding.code]
    assert finding.place_px == (900.0, 950.0)


@every_model
def test_a_scale_that_departs_is_a_doubt(model):
    r = fit_registration(grid(), planar(grid()), model=model, pixel_spacing=PX * 1.02)
    for departure, standard_error in scale_departures(r):
        assert departure == pytest.approx(1 / 1.02 - 1, abs=2e-3)
        assert 0 < standard_error < 1e-3
    assert ("scale-departs", "doubt") in codes(r)
    assert "spacing_departure" in describe_checks(r)
    assert scale_departures(fit_registration(grid(), planar(grid()))) == []


@pytest.mark.parametrize("model", ["similarity", "affine"])
@pytest.mark.parametrize("unit", [1.0, 0.1])
def test_a_scale_that_nothing_checks_is_a_note_with_the_pixel_that_the_markers_give(model, unit):
    target = unit * planar(grid(), noise=0.0)
    found = [*registration_findings(fit_registration(grid(), target, model=model))]
    assert [(finding.code, finding.severity) for finding in found] == [("scale-unchecked", "note")]
    assert f"one pixel is {1e3 * unit * PX:.3g} mm" in found[0].text
    assert codes(fit(grid(), target, model, pixel_spacing=unit * PX)) == []
    assert "scale-unchecked" not in dict(codes(fit(*solid(), "similarity")))


@pytest.mark.parametrize("model", ["similarity", "rigid"])
def test_a_stretched_slice_is_a_doubt(model):
    r = fit(grid() * [1, 0.9], planar(grid()), model)
    assert ("pixels-stretched", "doubt") in codes(r)
    r = fit_registration(grid(), planar(grid()) * [3, 1, 1])
    assert ("pixels-stretched", "doubt") in codes(r)


def test_curve_points_beyond_the_markers():
    r = fit(grid(), planar(grid()))
    inside = np.tile([[400.0, 380], [420, 350]], (30, 1))
    assert not [*error_findings(target_error(r, inside))]
    far = np.array([[1200.0, 380]])
    error = target_error(r, np.vstack([inside, far]))
    assert error.is_extrapolated.tolist() == [False] * 60 + [True]
    assert error.worst == 60
    more = target_error(r, np.vstack([inside[:10], far]))
    for severity, of_curve in (("note", error), ("doubt", more)):
        (finding,) = error_findings(of_curve)
        assert (finding.code, finding.severity) == ("curve-extrapolated", severity)
    assert target_error(fit(*solid(8), "rigid"), np.array([[0.0, 0, 0], [1, 1, 1]])).worst == 1


def test_a_slice_seen_from_below_is_a_doubt():
    above = np.column_stack([grid()[:, 0], -grid()[:, 1], np.zeros(9)]) * PX
    assert side_finding(fit_registration(grid(), above)) is None
    mirrored = fit_registration(grid(), above[:, [1, 0, 2]])  # x and y exchanged
    finding = side_finding(mirrored)
    assert (finding.code, finding.severity) == ("faces-down", "doubt")
    assert "robot -z" in finding.text
    assert side_finding(fit_registration(*solid(8))) is None


@every_model
def test_perspective_is_a_doubt_and_blames_no_marker(model):
    found = dict(codes(fit(grid(), bent(grid()), model)))
    assert found["perspective"] == "doubt"
    assert "marker-suspect" not in found


def test_the_homography_is_that_of_opencv():
    """On exact points of a plane both find the same map, so it leaves nothing."""
    import cv2

    source = grid()
    plane = np.column_stack([source, np.ones(9)]) @ np.array(
        [[0.6, 0.02, 3], [-0.03, 0.55, 8], [2e-4, -1e-4, 1]]
    )
    target = np.column_stack([plane[:, :2] / plane[:, 2:], np.zeros(9)]) * 1e-3
    target += np.random.default_rng(2).normal(0, 1e-6, target.shape)
    h, _ = cv2.findHomography(source, target[:, :2])
    whole = np.array([[3, 4], [500, 7]])
    assert projected(h, whole) == pytest.approx(cv2.perspectiveTransform(whole[None] / 1.0, h)[0])
    assert projected(h, np.zeros((0, 2))).shape == (0, 2)
    mapped = np.column_stack([source, np.ones(9)]) @ h.T
    left = target.copy()
    left[:, :2] -= mapped[:, :2] / mapped[:, 2:]
    test = perspective_test(fit_registration(source, target))
    assert test.p_value < 1e-6
    # OpenCV does not fit the height, which is 0 for it: compare to within that freedom.
    expected = np.sqrt(3 * (left**2).sum() / (3 * 9 - 11))
    assert test.fle_rms_m == pytest.approx(expected, rel=0.2)


def test_five_markers_show_perspective_and_one_bad_of_five_or_nine_does_not():
    five = [0, 1, 2, 6, 8]
    for some, bad, seed in product((five, range(9)), range(9), range(20)):
        target = planar(grid(), seed=seed)[some]
        target[bad % len(some)] += [0.004, 0.003, 0]
        r = fit_registration(grid()[some], target)
        assert not perspective_test(r, 5).is_significant
        assert r.outliers == (bad,) or some is five
    seen = fit_registration(grid()[five], bent(grid())[five])
    assert perspective_test(seen, 5).is_significant
    assert perspective_test(seen) is None
    with refuses(CheckFailed, "residual-large") as refused:
        refuse_wrong_markers(seen, 1e-3)
    assert str(refused.value).endswith("Make it flat with vfplan rectify")


def test_good_markers_show_perspective_seldom():
    tests = [perspective_test(fit_registration(grid(), planar(grid(), seed=k))) for k in range(600)]
    assert sum(test.is_significant for test in tests) <= 9
    assert sum(test.is_possible for test in tests) / 600 == pytest.approx(0.1, abs=0.03)
    # The p value of good markers is uniform.
    assert np.mean([test.p_value for test in tests]) == pytest.approx(0.5, abs=0.04)


@pytest.mark.parametrize("sets", [100, pytest.param(600, marks=pytest.mark.full)])
@pytest.mark.parametrize("tilt_deg, expected", [(2, 0.95), (5, 0.98)])
def test_a_photograph_has_a_finding_or_its_bound_holds(tilt_deg, expected, sets):
    """6 to 12 markers with an FLE of 0.1 to 0.5 mm."""
    safe = 0
    for r, is_bound in table.photographed_sets(tilt_deg, sets):
        safe += is_bound or bool({"perspective", "marker-suspect"} & dict(codes(r)).keys())
    assert safe / sets >= expected - 0.02


@pytest.mark.parametrize("view", [0, 3])
def test_real_photographs_show_perspective(shared_data, view):
    pixels, board_mm = photograph(shared_data, view)
    test = perspective_test(fit_registration(pixels, board_mm / 1e3))
    assert test.is_significant
    # The data's own figures for a homography: 0.066 and 0.093 mm.
    assert 1e3 * test.fle_rms_m == pytest.approx({0: 0.066, 3: 0.093}[view], rel=0.03)
