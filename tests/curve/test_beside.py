"""What touches a line or lies over its end, here a circle's, whose way is known everywhere."""

from contextlib import suppress

import numpy as np
import pytest
from canvas import Canvas
from drawing import anatomy
from slices import RED, SHAPE

import vfplan
from vfplan.errors import CurveError

CENTRE, RADIUS, WIDTH = np.array([190.0, 160.0]), 90.0, 4.0


def arc(start, stop):
    turn = np.radians(np.linspace(start, stop, 1200))
    return CENTRE + RADIUS * np.column_stack([np.cos(turn), np.sin(turn)])


def told(draw, closed=False, quality=None):
    canvas = Canvas(anatomy(SHAPE, 3), "exact")
    canvas.line(arc(0, 359.7) if closed else arc(180, 340), WIDTH, RED, closed)
    draw(canvas)
    return vfplan.extract_curve(canvas.image(quality)).warnings


@pytest.mark.parametrize(
    ("closed", "quality", "side"), [(False, None, 1), (False, 85, -1), (True, None, -1)]
)
def test_a_dot_at_one_side_is_told_with_its_place(closed, quality, side):
    at = CENTRE - np.array([0, RADIUS + side * 1.2 * WIDTH])
    said = told(lambda canvas: canvas.disc(at, 1.5 * WIDTH, RED), closed, quality)
    place = [w for w in said if "wider to one side" in w]
    assert len(place) == 1
    u, v = (float(x) for x in place[0].split("(")[1].split(")")[0].split(","))
    assert np.hypot(u - at[0], v - at[1]) < 2.5 * WIDTH


def test_a_dot_is_told_where_the_line_runs_from_border_to_border():
    u = np.linspace(-20, SHAPE[1] + 20, 1200)
    line = np.column_stack([u, 150 + 40 * np.sin(u / 60)])
    canvas = Canvas(anatomy(SHAPE, 3), "exact")
    canvas.line(line, WIDTH, RED)
    canvas.disc(line[600] - [0, 1.2 * WIDTH], 1.5 * WIDTH, RED)
    found = vfplan.extract_curve(canvas.image())
    assert any("wider to one side" in w for w in found.warnings)
    assert found.mask.sum() > WIDTH * SHAPE[1]
    assert found.ink["curve"] > 0.9 * found.mask.sum()


def test_a_dot_where_a_ring_is_cut_open_is_told():
    clear = Canvas(anatomy(SHAPE, 3), "exact")
    clear.line(arc(0, 359.7), WIDTH, RED, True)
    way = vfplan.extract_curve(clear.image(None)).strokes[0].points_px[0] - CENTRE
    at = CENTRE + (1 + 1.2 * WIDTH / RADIUS) * way
    said = told(lambda canvas: canvas.disc(at, 1.5 * WIDTH, RED), True)
    assert any("wider to one side" in w for w in said)


def test_neither_a_dot_on_the_line_nor_a_clear_line_is_told():
    assert not told(lambda canvas: None)
    assert not told(lambda canvas: canvas.disc(arc(260, 261)[0], 1.3 * WIDTH, RED))


def corner(pen):
    end = arc(180, 340)[-1]
    inward = (CENTRE - end) / RADIUS
    onward = np.array([inward[1], -inward[0]])
    way = 0.5 * onward + 0.87 * inward
    return lambda canvas: canvas.line([end + 0.8 * onward, end + 16 * way], pen, RED)


def over(bottom, tone):
    def draw(canvas):
        canvas.box((290, bottom - 150), 250, 300, tone)

    return draw


def test_a_cover_that_reaches_over_the_border_is_told_by_the_ink_s_cut_or_by_its_edge():
    assert any("cut off flat" in w for w in told(over(125, (128, 128, 128))))
    (one,) = told(over(125, (250, 250, 250)))
    assert "more sharply than" in one
    thin = Canvas(np.full((*SHAPE, 3), 120.0), "exact")
    thin.line(arc(180, 340), 1.5, RED)
    over(125.3, (60, 60, 60))(thin)
    assert any("more sharply than" in w for w in vfplan.extract_curve(thin.image()).warnings)


def test_another_pen_s_line_that_goes_straight_on_is_told_and_a_point_is_not():
    end = arc(180, 340)[-1]
    ahead = np.array([0.34, 0.94])
    straight = told(lambda canvas: canvas.line([end, end + 25 * ahead], 1.2, RED))
    assert any("thinner at once" in w for w in straight)
    way = np.column_stack([np.linspace(0, 25, 60)] * 2) * ahead + end
    assert not told(lambda canvas: canvas.pressed(way, np.linspace(WIDTH, 0.3, 60), RED))


@pytest.mark.parametrize(("gap", "quality"), [(0.0, None), (2.0, 85)])
def test_a_letter_at_the_end_is_told_and_a_pen_that_is_pressed_less_is_not(gap, quality):
    end = arc(180, 340)[-1]
    turned = np.array([[0.34, 0.94], [-0.94, 0.34]])
    strokes = ([[0, 0], [12, 0]], [[7, 0], [12, 5]], [[5, 0], [0, 5]])  # a K, upside down

    def letter(canvas):
        for stroke in strokes:
            canvas.line(end + (np.array([WIDTH / 2 + gap, 0]) + stroke) @ turned, 1.8, RED)

    assert any("thinner at once" in w for w in told(letter, quality=quality))
    widths = WIDTH * np.linspace(1.5, 0.5, 1200)
    canvas = Canvas(anatomy(SHAPE, 3), "exact")
    canvas.pressed(arc(180, 340), widths, RED)
    assert not vfplan.extract_curve(canvas.image(quality)).warnings


def test_a_thinner_stroke_behind_a_corner_is_told_and_one_of_the_same_pen_is_not():
    assert any("thinner at once" in w for w in told(corner(WIDTH / 2)))
    assert not told(corner(WIDTH))


@pytest.mark.parametrize(("share", "quality"), [(0.2, 85), (0.4, None), (0.6, None), (0.6, 85)])
def test_a_second_stroke_beside_a_part_of_the_line_is_refused(share, quality):
    canvas = Canvas(anatomy(SHAPE, 3), "exact")
    canvas.line(arc(180, 340), WIDTH, RED)
    beside = arc(200, 200 + 160 * share)
    canvas.line(CENTRE + (1 + WIDTH / RADIUS) * (beside - CENTRE), WIDTH, RED)
    with pytest.raises(CurveError, match=r"times as wide|side by side"):
        vfplan.extract_curve(canvas.image(quality))


def test_a_pen_pressed_more_and_less_is_no_second_stroke():
    way = arc(180, 340)
    for swings in (1, 3):
        widths = WIDTH * (1 + 0.4 * np.sin(np.linspace(0, 2 * np.pi * swings, len(way))))
        canvas = Canvas(anatomy(SHAPE, 3), "exact")
        canvas.pressed(way, widths, RED)
        assert not vfplan.extract_curve(canvas.image()).warnings


def test_the_thin_strokes_of_a_sign_at_the_end_are_told_and_an_arrow_s_corners_are_not():
    end, before = arc(180, 340)[[-1, -30]]
    onward = (end - before) / np.hypot(*(end - before))
    inward = (CENTRE - end) / RADIUS

    def cross(canvas):
        for lean in (inward, onward):
            canvas.line([end - 5 * lean, end + 5 * lean], 1.5, RED)

    def head(canvas):
        canvas.fill([end + 10 * onward, end + 6 * inward, end - 6 * inward], RED)

    assert any("a thinner stroke leaves it" in w for w in told(cross))
    assert not told(head)


@pytest.mark.parametrize("quality", [None, 85])
def test_a_sign_of_the_same_pen_at_the_end_is_told_by_its_turn_and_the_ink_beside(quality):
    end = arc(180, 340)[-1]
    two = np.array([[-6, 3], [-2, -1], [3, 0], [4, 4], [-4, 14], [6, 14]])  # a figure 2, its neck
    said = told(lambda canvas: canvas.line(end + two, 0.9 * WIDTH, RED), quality=quality)
    assert any("shortly beyond a turn" in w for w in said)


def leaving(width, at, length=60.0):
    """A straight line from a place on the circle outwards."""
    return lambda canvas: canvas.line([at, at + length * (at - CENTRE) / RADIUS], width, RED)


@pytest.mark.parametrize("quality", [None, 85])
@pytest.mark.parametrize("closed", [False, True])
def test_a_leader_that_touches_the_curve_is_cut_off_and_told_of_in_the_account(closed, quality):
    canvas = Canvas(anatomy(SHAPE, 3), "exact")
    canvas.line(arc(0, 359.7) if closed else arc(180, 340), WIDTH, RED, closed)
    leaving(1.8, arc(260, 261)[0])(canvas)
    found = vfplan.extract_curve(canvas.image(quality))
    assert not found.warnings
    (stroke,), (aside,) = found.strokes, found.set_aside
    assert aside["kind"] == "offshoot"
    assert 45 < aside["length_px"] < 65
    assert found.ink["offshoot"] > 45
    off = np.abs(np.hypot(*(stroke.points_px - CENTRE).T) - RADIUS)
    assert off.max() < 0.5
    assert stroke.closed == closed


def test_what_leaves_the_curve_in_its_own_pen_or_near_its_end_is_no_leader():
    with pytest.raises(CurveError, match="forks"):
        told(leaving(WIDTH, arc(260, 261)[0]))
    assert told(leaving(1.8, arc(332, 333)[0]))


def test_a_dot_ahead_of_the_end_is_told_however_it_lies():
    at = arc(360, 361)[0]
    for turn in np.radians([0, 45, 90, 135]):
        way = 1.5 * np.array([np.cos(turn), np.sin(turn)])
        said = told(lambda canvas, way=way: canvas.line([at - way, at + way], WIDTH, RED))
        assert any("beyond the curve's end" in w for w in said)


def test_a_dot_as_large_as_its_ring_ends_in_no_error():
    for dot in (5.0, 6.0, 7.0):
        canvas = Canvas(anatomy((90, 90), 3), "exact")
        turn = np.linspace(0, 2 * np.pi, 200, endpoint=False)
        ring = np.column_stack([np.cos(turn), np.sin(turn)])
        canvas.line(45 + 5 * ring, 2.0, RED, True)
        for k in range(0, 200, 20):
            canvas.fill(45 + 8 * ring[k] + dot * ring, RED)
            with suppress(CurveError):
                vfplan.extract_curve(canvas.image(), accept_width=True)
