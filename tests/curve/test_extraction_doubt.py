"""Doubt about which curve is meant: who names a line is believed, and each refusal shows a way."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
from drawing import blend, compare, coverage, flat, jpeg, normal_errors, to_uint8, wavy

import vfplan
from vfplan.errors import CurveError

RED = (255, 0, 0)
SHAPE = (300, 400)
T = np.linspace(0, 1, 2000)
WAVE = np.column_stack([60 + 280 * T, 150 + 40 * np.sin(6 * T)])
BOX = np.array([[100.3, 80.2], [300.3, 80.2], [300.3, 220.2], [100.3, 220.2]])


def drawn(*parts, width=3.0, closed=False, background=None):
    """A picture of lines drawn with a red pen, each (points, whether it is closed)."""
    picture = flat(SHAPE, 90.0) if background is None else background
    for part in parts:
        picture = blend(picture, coverage(SHAPE, part, width, closed), RED)
    return to_uint8(picture)


def pointer():
    """A straight cut at which the pen dwelt: a line with a dot at one end, as an arrow has."""
    image = drawn(np.array([[60.3, 60.2], [330.1, 210.4]]))
    cv2.circle(image, (330, 210), 9, RED, -1, cv2.LINE_AA)
    return image


def test_a_frame_that_is_named_is_taken_and_warned_of():
    image = drawn(BOX, closed=True)
    with pytest.raises(CurveError, match=r"frame at \(99, 79\) \[1\]; --stroke with its number"):
        vfplan.extract_curve(image)
    for choice in ("all", "longest", 2):
        with pytest.raises(CurveError, match="no planned curve"):
            vfplan.extract_curve(image, stroke=choice)
    found = vfplan.extract_curve(image, stroke=1)
    (stroke,) = found.strokes
    assert stroke.closed
    assert stroke.length_px == pytest.approx(680, rel=0.01)
    assert "looks like a frame, and is taken" in found.warnings[0]
    assert not found.set_aside


def test_an_arrow_that_is_named_is_taken_or_its_fork_is_named():
    with pytest.raises(CurveError, match=r"arrow at .* \[1\]"):
        vfplan.extract_curve(pointer())
    found = vfplan.extract_curve(pointer(), stroke=1)
    assert np.allclose(found.strokes[0].points_px[0], [60.3, 60.2], atol=2)
    assert "looks like an arrow" in found.warnings[0]
    barbed = to_uint8(flat(SHAPE, 90.0))
    cv2.arrowedLine(barbed, (60, 60), (330, 210), RED, 3, cv2.LINE_AA, 0, 0.1)
    with pytest.raises(CurveError, match=r"forks, touches or crosses itself at \(3\d\d, 2\d\d\)"):
        vfplan.extract_curve(barbed, stroke=1)


def test_numbers_go_on_from_the_candidates_to_what_was_set_aside():
    image = drawn(WAVE)
    cv2.rectangle(image, (20, 20), (70, 60), RED, 2)
    found = vfplan.extract_curve(image)
    (frame,) = found.set_aside
    assert (frame["kind"], frame["stroke"]) == ("frame", 2)
    assert not found.warnings
    assert compare(found.strokes[0], WAVE).rms < 0.03
    (taken,) = vfplan.extract_curve(image, stroke=2).strokes
    assert taken.closed
    with pytest.raises(CurveError, match="no candidate number 3: there are 1 and 1 set aside"):
        vfplan.extract_curve(image, stroke=3)


def test_what_was_set_aside_though_it_is_longer_is_warned_of():
    short = WAVE[:600] + np.array(
        [0, 110]
    )  # beside the rectangle, which may as well be the planned cut
    found = vfplan.extract_curve(drawn(BOX[[0, 1, 2, 3, 0]], short))
    assert len(found.strokes) == 1
    assert found.strokes[0].length_px < 200
    assert any("a frame at (99, 79), 677 px long" in warning for warning in found.warnings)
    inside = 0.5 * WAVE + np.array([100, 75])
    (around,) = vfplan.extract_curve(drawn(BOX[[0, 1, 2, 3, 0]], inside)).warnings
    assert "a frame at (99, 79), 677 px long" in around
    window = np.array([[5, 5], [394, 5], [394, 294], [5, 294], [5, 5]])
    assert not vfplan.extract_curve(drawn(window, inside)).warnings  # the viewer's own


def test_a_small_piece_ahead_of_a_long_line_is_told_from_afar():
    ahead = WAVE[0] - WAVE[1]
    ahead /= np.hypot(*ahead)
    piece = WAVE[0] + np.array([43.0, 48.0])[:, None] * ahead
    (warning,) = vfplan.extract_curve(drawn(WAVE, piece)).warnings
    assert "beyond the curve's end and is not part of it" in warning
    assert not vfplan.extract_curve(drawn(WAVE[800:], piece - WAVE[0] + WAVE[800])).warnings


@pytest.mark.parametrize("slant", [20, 30, 35, 50])
def test_a_ring_that_another_pen_cuts_on_a_slant_stays_closed(slant):
    turn = np.linspace(0, 2 * np.pi, 900, endpoint=False)
    ring = [200, 150] + 90 * np.column_stack([np.cos(turn), np.sin(turn)])
    along = 60 * np.array([np.cos(np.radians(slant)), np.sin(np.radians(slant))])
    picture = blend(flat(SHAPE, 90.0), coverage(SHAPE, ring, 5.0, True), RED)
    cut = coverage(SHAPE, np.add([200, 60], [-along, along]), 3.0, False)
    found = vfplan.extract_curve(to_uint8(blend(picture, cut, (255, 165, 0))))
    assert found.strokes[0].closed
    assert compare(found.strokes[0], ring, True).worst < 1.0


@pytest.mark.parametrize("quality", [70, 76, 80, 85, 90, 94])
def test_the_edges_of_orange_bars_are_no_red_line(quality):
    picture = np.full((*SHAPE, 3), 90, np.uint8)
    for k, height in enumerate((70, 45, 120, 95)):
        picture[250 - height : 250, 103 + 27 * k : 119 + 27 * k] = (255, 140, 0)
    with pytest.raises(CurveError, match=r"no line in red|other colour"):
        vfplan.extract_curve(jpeg(picture, quality))


def ring_by_hand(drift):
    """Drawn 6 % past its beginning, beside it; and the ring that lies midway."""
    turn = np.linspace(0, 2 * np.pi * 1.06, 2000)
    axes = np.array([110, 90]) + drift * turn[:, None] / (2 * np.pi)
    return [200, 150] + axes * np.column_stack([np.cos(turn), np.sin(turn)])


@pytest.mark.parametrize("width", [2, 3, 5])
def test_runs_a_pixel_apart_are_warned_of_in_jpeg_and_their_doubt_is_told(width):
    curve = ring_by_hand(1.0)
    found = vfplan.extract_curve(jpeg(drawn(curve, width=width), 75))
    (stroke,) = found.strokes
    assert any("as wide as elsewhere" in warning for warning in found.warnings)
    z = np.abs(normal_errors(stroke.points_px, curve, False)) / stroke.sigma_px
    assert z.max() < 6  # without the doubt, 10 to 14


@pytest.mark.parametrize("quality", [None, 90, 75, 50])
@pytest.mark.parametrize(("count", "width"), [(2, 2.0), (2, 3.0), (3, 2.0), (3, 3.0)])
def test_lines_half_a_pixel_apart_all_along_are_refused_or_told(count, width, quality):
    share = [coverage(SHAPE, WAVE + np.array([0, k * (width + 0.5)]), width) for k in range(count)]
    image = to_uint8(blend(flat(SHAPE, 150.0), np.max(share, axis=0), RED))
    try:
        found = vfplan.extract_curve(jpeg(image, quality) if quality else image)
    except CurveError as error:
        assert "two lines run side by side" in str(error)  # noqa: PT017 - one of two right answers
    else:
        assert quality == 50
        assert "if it is two lines side by side" in found.warnings[0]


def test_a_spiral_with_its_turns_against_each_other_is_refused():
    turn = np.linspace(0, 6 * np.pi, 4000)[:, None]
    curve = [200, 150] + (20 + 4 * turn / (2 * np.pi)) * np.hstack([np.cos(turn), np.sin(turn)])
    for image in (drawn(curve), jpeg(drawn(curve), 75)):
        with pytest.raises(CurveError, match="two lines run side by side"):
            vfplan.extract_curve(image)


@pytest.mark.parametrize("width", [5, 9, 14])
@pytest.mark.parametrize("quality", [None, 75, 50])
def test_a_broad_pen_is_one_line(width, quality):
    image = drawn(WAVE, width=width)
    found = vfplan.extract_curve(jpeg(image, quality) if quality else image)
    assert not found.warnings
    assert compare(found.strokes[0], WAVE).rms < 0.1


def dashed(dash, gap, width=2.5):
    share, length = np.zeros(SHAPE), 333.0  # of the wave, about
    for start in np.arange(0, length, dash + gap) / length:
        part = WAVE[(start <= T) & (start + dash / length >= T)]
        share = np.maximum(share, coverage(SHAPE, part, width))
    return to_uint8(blend(flat(SHAPE, 90.0), share, RED))


@pytest.mark.parametrize(("dash", "gap"), [(3, 7), (8, 14), (18, 26)])
def test_dashes_that_are_not_joined_are_told_as_such(dash, gap):
    with pytest.raises(CurveError, match=r"dots or dashes;.*--max-gap \(20 px\); draw it"):
        vfplan.extract_curve(dashed(dash, gap))


def bone(*places):
    """Dark ground with bright round bones."""
    ground = flat(SHAPE, 40.0)
    for (u, v), radius in places:
        cv2.circle(ground, (round(u), round(v)), radius, (250, 250, 250), -1)
    return cv2.GaussianBlur(ground, (0, 0), 0.8)


def faded(curve, ground, closed=False, colour=RED, opacity=0.5):
    """A half transparent pen blended in linear light: over bone less than half as strong."""
    return to_uint8(blend(ground, coverage(SHAPE, curve, 3, closed), colour, opacity, 2.2))


@pytest.mark.parametrize("opacity", [0.5, 0.6, 0.7])
@pytest.mark.parametrize("colour", [(255, 64, 64), RED, (220, 20, 60)])
def test_a_line_that_fades_over_bone_is_followed_or_told(colour, opacity):
    for places in ([0, -1], [500], [1000]):
        ground = bone(*((WAVE[k], 28) for k in places))
        try:
            found = vfplan.extract_curve(faded(WAVE, ground, colour=colour, opacity=opacity))
        except CurveError as error:
            assert re.search(r"candidates.* end \d+ px apart at", str(error))  # noqa: PT017
            continue
        error = compare(found.strokes[0], WAVE)
        assert error.worst < 0.8
        assert found.warnings or (error.uncovered < 2 and error.ends < 1.5)


def test_a_ring_that_fades_over_bone_is_told_of():
    ring = wavy(SHAPE, 4, closed=True)
    found = vfplan.extract_curve(faded(ring, bone((ring[900], 28), (ring[2500], 9)), closed=True))
    assert any("shows through faintly" in w for w in found.warnings)
    assert any("nearly closed" in w for w in found.warnings)


def test_what_is_faint_beside_a_line_is_not_followed():
    """A weaker stroke that does not carry it on; a tinted region leaves what is meant in doubt."""
    weaker = coverage(SHAPE, [[200, 60], [200, 125]], 3)
    found = vfplan.extract_curve(drawn(WAVE, background=blend(flat(SHAPE, 90.0), weaker, RED, 0.3)))
    assert compare(found.strokes[0], WAVE).rms < 0.03
    assert compare(found.strokes[0], WAVE).ends < 1.5
    tint = np.zeros(SHAPE)
    cv2.ellipse(tint, (330, 170), (60, 40), 0, 0, 360, 1.0, -1)
    with pytest.raises(CurveError, match="as wide as elsewhere"):
        vfplan.extract_curve(drawn(WAVE, background=blend(flat(SHAPE, 90.0), tint, RED, 0.3)))


def test_an_end_under_another_colour_is_warned_of():
    image = drawn(WAVE)
    cv2.circle(image, (340, 140), 12, (0, 220, 255), -1, cv2.LINE_AA)
    (warning,) = vfplan.extract_curve(image).warnings
    assert "something of another colour begins" in warning


def test_candidates_that_end_close_by_are_told_with_the_way_round():
    image = drawn(WAVE[:900], WAVE[1100:] + np.array([0, 14]))
    with pytest.raises(CurveError, match=r"1 and 2 end \d+ px apart at .*--stroke all takes both"):
        vfplan.extract_curve(image)
    image = drawn(WAVE)
    cv2.rectangle(image, (175, 60), (225, 240), (120, 120, 120), -1)
    with pytest.raises(CurveError, match=r"1 and 2 end \d+ px apart at .*as a box is, may hide"):
        vfplan.extract_curve(image)


@pytest.mark.parametrize("missing", [24.0, 33.0, 47.0])
@pytest.mark.parametrize("turn", [0.0, 0.7, 2.4])
def test_a_curve_that_is_nearly_closed_is_told_with_what_is_missing(turn, missing):
    """Between the inked ends of a round pen, whatever thinning takes of them."""
    half = (missing + 3) / 2 / 90
    angle = turn + np.linspace(half, 2 * np.pi - half, 2000)
    ring = np.array([200.2, 150.3]) + 90 * np.column_stack([np.cos(angle), np.sin(angle)])
    (warning,) = vfplan.extract_curve(drawn(ring)).warnings
    told = float(re.search(r"nearly closed: (\d+) px are missing", warning)[1])
    assert told == pytest.approx(missing, abs=1.5)
