"""Ink of the same pen that touches the line, here a circle, whose way is known everywhere."""

import numpy as np
import pytest
from canvas import Canvas
from drawing import anatomy
from slices import RED, SHAPE

import vfplan

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


def test_a_thinner_stroke_behind_a_corner_is_told_and_one_of_the_same_pen_is_not():
    assert any("turns a corner into thinner ink" in w for w in told(corner(WIDTH / 2)))
    assert not told(corner(WIDTH))
