"""Where an extracted line begins and ends, against the truth it was drawn from."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
from canvas import Canvas
from drawing import anatomy, blend, coverage, flat, jpeg, polyline, to_uint8, wavy
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree
from slices import RED

import vfplan
from vfplan.curve.path import thin
from vfplan.curve.point import fitted as fitted_point
from vfplan.curve.tip import View, fitted


def arc(angle, bend):
    """(300, 2) px, 110 px long, at an angle to the pixels' rows, turning by `bend` rad."""
    heading = angle + bend * np.linspace(-0.5, 0.5, 300)
    path = np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0) * 110 / 300
    return path - path.mean(0) + (75.3, 75.1)


ARCS = [(0.5, -0.8), (2.2, 1.2)]


def errors_at_ends(width, cap):
    """Along the line at both ends of every arc [px], > 0 beyond the end; for each quality."""
    found = {None: [], 90: [], 75: []}
    for seed, (angle, bend) in enumerate(ARCS):
        curve = arc(angle, bend)
        share = coverage((150, 150), curve, width, cap=cap)
        picture = to_uint8(blend(anatomy((150, 150), seed), share, (255, 0, 0)))
        for quality, errors in found.items():
            image = jpeg(picture, quality) if quality else picture
            points = vfplan.extract_curve(image).strokes[0].points_px
            if np.hypot(*(points[0] - curve[0])) > np.hypot(*(points[0] - curve[-1])):
                points = points[::-1]
            for end, inner in ((0, 5), (-1, -6)):
                way = curve[end] - curve[inner]
                errors.append(float((points[end] - curve[end]) @ way / np.hypot(*way)))
    return {quality: np.array(errors) for quality, errors in found.items()}


@pytest.mark.parametrize("width", [2, 3, 5, 8, 12])
@pytest.mark.parametrize("cap", ["butt", "round", "square"])
def test_ends_of_pens_cut_round_and_flat(cap, width):
    # A square cap looks like a butt cap half a width on: beyond 5 px no picture tells which.
    hidden = width / 2 - 0.9 if cap == "square" and width > 5 else 0.0
    found = errors_at_ends(width, cap)
    assert np.abs(found[None]).max() <= max(1.5, hidden)
    # JPEG blurs colour, and at 75 so much that the form of a cap is in doubt.
    assert abs(found[90].mean()) <= max(1.5, hidden + 0.2)
    assert np.abs(found[90]).max() <= max(1.8, hidden + 0.6)
    assert abs(found[75].mean()) <= max(1.5, hidden + 0.2)
    assert np.abs(found[75]).max() <= max(2.3, hidden + 0.6)


@pytest.mark.parametrize(("quality", "share"), [(None, 1.0), (80, 0.85)])
@pytest.mark.parametrize("width", [3, 4.5])
def test_round_ends_hold_for_programs_that_run_on(width, quality, share):
    """The truth may stop by up to 2 px, the hand's last step, before the ink's own centre does."""
    good = []
    for seed, (angle, bend) in enumerate([(0.3, 0.0), (1.1, 1.0), (2.0, -1.2), (2.8, 0.6)]):
        curve, soft = arc(angle, bend), cv2.GaussianBlur(anatomy((150, 150), seed), (0, 0), 4)
        ink = coverage((150, 150), curve, width)
        picture = to_uint8(blend(soft / 4 + 180, ink, (220, 20, 60), 0.9))
        image = jpeg(picture, quality) if quality else picture
        ends = vfplan.extract_curve(image).strokes[0].points_px[[0, -1]]
        for early in (0, round(2 * 300 / 110)):
            truth = curve[[early, -1 - early]]
            good += list(np.hypot(*(ends[:, None] - truth).transpose(2, 0, 1)).min(1) <= 1.5)
    assert np.mean(good) >= share


def test_the_brightness_tells_a_flat_end_where_colour_is_coarse():
    """JPEG blurs colour by 1 px; the brightness places a broad pen's end to a few tenths."""
    for cap, short in (("round", 0.78), ("butt", 1.1)):
        for seed, (angle, bend) in enumerate(ARCS):
            curve = arc(angle, bend)
            share = coverage((150, 150), curve, 8, cap=cap)
            picture = to_uint8(blend(flat((150, 150), 200 - 20 * seed), share, (255, 0, 0)))
            ends = vfplan.extract_curve(jpeg(picture, 75)).strokes[0].points_px[[0, -1]]
            off = np.hypot(*(ends[:, None] - curve[[0, -1]]).transpose(2, 0, 1)).min(1)
            np.testing.assert_allclose(off, short, atol=0.3)


@pytest.mark.parametrize(("width", "degrees"), [(2.2, 45.0), (2.5, 44.5), (2.5, 44.0), (3, 44.0)])
def test_a_line_near_45_degrees_keeps_the_ends_that_thinning_eats(width, degrees):
    turn, along = np.radians(degrees), np.linspace(0, 110, 300)
    curve = np.column_stack([35.1 + along * np.cos(turn), 34.9 + along * np.sin(turn)])
    for cap in ("butt", "round"):
        share = coverage((150, 150), curve, width, cap=cap)
        picture = to_uint8(blend(anatomy((150, 150), 1), share, (255, 0, 0)))
        ends = vfplan.extract_curve(picture).strokes[0].points_px[[0, -1]]
        assert np.hypot(*(ends - curve[[0, -1]]).T).max() <= 1.5


@pytest.mark.parametrize(
    ("width", "degrees", "begin"),
    [(2, 45.0, 65.3), (2.2, 45.05, 64.8), (2.5, 44.9, 65.9), (4, 45.0, 65.2), (3, 45.0, 65.3)],
)
def test_a_long_line_at_45_degrees_is_whole_though_thinning_eats_it_whole(width, degrees, begin):
    turn, along = np.radians(degrees), np.linspace(0, 330, 900)
    curve = np.column_stack([begin + along * np.cos(turn), 180 + (along - 165) * np.sin(turn)])
    for cap in ("butt", "round"):
        share = coverage((360, 360), curve, width, cap=cap)
        picture = to_uint8(blend(anatomy((360, 360), 1), share, (255, 0, 0)))
        ends = vfplan.extract_curve(picture).strokes[0].points_px[[0, -1]]
        assert np.hypot(*(ends - curve[[0, -1]]).T).max() <= 1.5


@pytest.mark.parametrize("size", range(2, 9))
def test_a_skeleton_reaches_to_both_ends_of_a_slanting_band(size):
    """Of `size` diagonals; a square beside it, broader than any pen, keeps its own skeleton."""
    offset = np.subtract.outer(np.arange(200), np.arange(200))
    band = (np.abs(offset + 0.5 - 0.5 * (size % 2)) <= size / 2 - 0.25).astype(np.uint8)
    for mask in (band, band[:, ::-1]):
        away = cv2.distanceTransform((~thin(mask.copy())).view(np.uint8), cv2.DIST_L2, 5)
        assert away[mask > 0].max() <= size + 3
    both = np.hstack([band, np.pad(np.ones((60, 60), np.uint8), 70)])
    assert (thin(both)[:, 200:] == thin(both[:, 200:].copy())).all()


@pytest.mark.parametrize(("seed", "opacity"), [(1, 0.6), (8, 0.6), (20, 0.6), (2, 0.8)])
def test_a_pale_line_goes_on_straight_to_its_ends(seed, opacity):
    """What JPEG leaves of it beyond its last sure points cannot make it turn or run away."""
    shape = (360, 420)
    curve = wavy(shape, seed)
    share = coverage(shape, curve, 3)
    picture = blend(anatomy(shape, seed), share, colour=(178, 34, 34), opacity=opacity)
    (stroke,) = vfplan.extract_curve(jpeg(to_uint8(picture), 75)).strokes
    step = np.arange(0, 4, 0.02)[:, None]
    on = [a + step * (a - b) / np.hypot(*(a - b)) for a, b in (curve[[0, 40]], curve[[-1, -41]])]
    longer = np.vstack([*on, polyline(curve, False, 0.02)])
    assert cKDTree(longer).query(stroke.points_px)[0].max() < 0.8
    assert cKDTree(stroke.points_px).query(curve)[0].max() < 3.5


@pytest.mark.parametrize(("cap", "slant"), [("round", None), ("butt", 0.0)])
def test_an_end_is_fitted_where_it_was_drawn(cap, slant):
    """Of a straight line with exact coverage; what the other form leaves is many times as much."""
    path = np.column_stack([np.arange(10.0, 46), np.full(36, 20.3)])
    line = np.column_stack([np.linspace(-10, 32.4, 2000), np.full(2000, 20.3)])
    share = coverage((40, 60), line, 3, cap=cap)
    picture = to_uint8(blend(flat((40, 60), 0), share, (255, 0, 0)))
    view = View(np.array([1 / 255, 0, 0]), 1.5, 0.3, 1.0, 0.01)
    tip = fitted([view], picture, path, np.ones((36, 13), bool), 24.0)
    assert (tip.round_at if slant is None else tip.flat_at) == pytest.approx(22.4, abs=0.11)
    assert tip.flat_odds > 100 if slant == 0 else tip.flat_odds < -100


@pytest.mark.parametrize("width", [1, 1.5, 2, 3, 5])
def test_a_line_that_runs_out_of_the_picture_ends_on_its_border(width):
    for line in ([(-10, 50), (140, 90)], [(60, 40), (85, 150)], [(50, 90), (80, -20)]):
        path = np.linspace(*np.array(line, float), 400)
        share = coverage((120, 120), path, width)
        picture = to_uint8(blend(flat((120, 120), 90), share, (255, 0, 0)))
        ends = vfplan.extract_curve(picture).strokes[0].points_px[[0, -1]]
        room = np.minimum(ends + 0.5, 119.5 - ends).min(1)
        beyond = (path[[0, -1]] < 0).any(1) | (path[[0, -1]] > 119).any(1)
        if np.hypot(*(ends[0] - path[0])) > np.hypot(*(ends[0] - path[-1])):
            room = room[::-1]
        assert room[beyond].max() <= 0.5


@pytest.mark.parametrize("over", [10, 20, 40])
@pytest.mark.parametrize("width", [2.5, 4])
def test_a_pen_drawn_out_to_a_point_is_followed_to_it(width, over):
    for seed, (angle, bend) in enumerate(ARCS):
        curve = arc(angle, bend)
        along = np.hypot(*np.diff(curve, axis=0).T).cumsum()
        canvas = Canvas(anatomy((150, 150), seed), "exact")
        canvas.pressed(curve, width * np.clip(np.r_[0, along] / over, 0.05, 1), RED)
        found = vfplan.extract_curve(canvas.image())
        assert not found.warnings
        points = found.strokes[0].points_px
        assert np.hypot(*(points[[0, -1]] - curve[0]).T).min() < 1.5
        assert np.hypot(*(points[[0, -1]] - curve[-1]).T).min() < 1.5


@pytest.mark.parametrize(("over", "within"), [(10, 1.5), (20, 1.5), (40, 3.0)])
def test_a_point_is_followed_in_jpeg_or_told(over, within):
    for seed, (angle, bend) in enumerate(ARCS):
        curve = arc(angle, bend)
        along = np.r_[0, np.hypot(*np.diff(curve, axis=0).T).cumsum()]
        canvas = Canvas(anatomy((150, 150), seed), "exact")
        canvas.pressed(curve, 4 * np.clip(along / over, 0.05, 1), RED)
        for quality in (90, 80):
            found = vfplan.extract_curve(canvas.image(quality))
            ends = found.strokes[0].points_px[[0, -1]]
            assert np.hypot(*(ends - curve[0]).T).min() < within + len(found.warnings)
            assert all("is drawn out: where it ends is unsure by" in w for w in found.warnings)
            assert not any("unsure" in w and near(w, curve[-1]) for w in found.warnings)


def test_a_point_is_followed_where_the_line_comes_from_beyond_the_picture():
    curve = np.column_stack([np.linspace(-10, 130, 500), np.linspace(70, 90, 500)])
    canvas = Canvas(anatomy((150, 150), 1), "exact")
    canvas.pressed(curve, 4 * np.clip(np.linspace(140, 0, 500) / 25, 0.05, 1), RED)
    ends = vfplan.extract_curve(canvas.image()).strokes[0].points_px[[0, -1]]
    assert np.hypot(*(ends - curve[-1]).T).min() < 1.5


def near(warning, place):
    """Whether the first place that a warning names lies within 20 px."""
    found = re.search(r"\((\d+), (\d+)\)", warning)
    return np.hypot(*(np.array(found.groups(), float) - place)) < 20


@pytest.mark.parametrize(("fall", "stub"), [(10, 0.0), (20, 0.05), (40, 0.05)])
@pytest.mark.parametrize("noise", [0.003, 0.03])
def test_an_even_fall_has_its_end_with_a_true_deviation(fall, stub, noise):
    """In noise that hangs together as JPEG's; the truth lies where the course was made to end."""
    rng, s, z = np.random.default_rng(fall), np.arange(90.0), []
    for end in rng.uniform(60, 62, 25):
        mass = np.where(s < end, np.clip((end - s) / fall, stub, 1), 0)
        mass = gaussian_filter1d(mass, 0.8) + gaussian_filter1d(rng.normal(0, noise, 90), 1)
        half = 89 - np.argmax(mass[::-1] > 0.5)
        point = fitted_point(mass[half - 45 if half > 45 else 0 :], min(half, 45.0), 3.0, 0.64)
        assert point.drawn_out
        z.append((half + point.beyond - end) / np.hypot(point.sigma, 0.3))
    assert np.sqrt(np.mean(np.square(z))) < 2


def test_blunt_ends_are_no_points():
    rng, s = np.random.default_rng(7), np.arange(90.0)
    for end in rng.uniform(50, 52, 100):
        mass = gaussian_filter1d((s < end).astype(float), rng.uniform(0.6, 1.6))
        mass += gaussian_filter1d(rng.normal(0, 0.04, 90), 1) * (0.2 + mass)
        assert fitted_point(mass[5:], end - 5, 3.0, 2.0).likely < 0.2


@pytest.mark.parametrize("line", [((508, 271), (454, 256)), ((20, 3), (160, 3))])
def test_short_lines_beside_the_border_are_measured(line):
    picture = np.full((512, 512, 3), 90, np.uint8)
    cv2.line(picture, *line, RED, 5, cv2.LINE_AA)
    ends = vfplan.extract_curve(picture).strokes[0].points_px[[0, -1]]
    assert all(np.hypot(*(ends - place).T).min() < 4 for place in line)


def test_a_block_of_ink_ends_in_no_error_of_its_own():
    picture = np.full((52, 5, 3), 90, np.uint8)
    picture[:26] = RED
    assert vfplan.extract_curve(picture).strokes
