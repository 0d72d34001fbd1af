"""A box over a line's end is told by its outline, whatever it holds; nothing else makes one."""

from __future__ import annotations

import numpy as np
import pytest

from vfplan.curve.boxes import boxed
from vfplan.curve.covers import BORDER_PX, BOXED
from vfplan.curve.pen import Pen

PEN = Pen.of_colour("red")
V, U = np.mgrid[:240, :240]
HOLDS = {
    "white": np.full(V.shape, 255.0),
    "stripes": np.where((U + V) // 5 % 2, 255.0, 0.0),
    "a shade": 230.0 - V / 4,
    "noise": np.random.default_rng(1).uniform(0, 255, V.shape),
}


def picture(held=None, rows=(120, 180), columns=(90, 150)):
    """A red line down column 120 to row 120, and the box, if any, that hides the rest."""
    grey = 110 + 25 * np.sin(U / 17) * np.cos(V / 23)
    grey += np.random.default_rng(0).normal(0, 3, V.shape)
    rgb = np.repeat(grey[..., None], 3, 2)
    rgb[60:120, 119:122] = 255, 0, 0
    if held is not None:
        box = np.s_[rows[0] : rows[1], columns[0] : columns[1]]
        rgb[box] = held[box][..., None]
    return np.clip(rgb, 0, 255).astype(np.uint8)


def found(rgb, turn=0):
    """The outline's and the border's score, with the whole picture turned by so many quarters."""
    way = np.array([0.0, 1.0])
    at = np.array([120.0, 119.5]) - 119.5
    for _ in range(turn):
        at, way = (np.array([x[1], -x[0]]) for x in (at, way))
    return boxed(np.ascontiguousarray(np.rot90(rgb, turn)), PEN, at + 119.5, way)


def score(rgb, turn=0):
    return found(rgb, turn)[0]


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("held", HOLDS)
def test_a_box_is_told_by_its_outline(held, turn):
    assert score(picture(HOLDS[held]), turn) > 0.8


@pytest.mark.parametrize(("rows", "columns"), [((120, 180), (119, 150)), ((120, 240), (90, 240))])
def test_at_its_corner_and_at_the_picture_s_border(rows, columns):
    assert score(picture(HOLDS["white"], rows, columns)) > BOXED[0]


def test_nothing_else_is_one():
    ring = np.hypot(U - 120, V - 170)
    assert score(picture()) < BOXED[0] / 2
    for shape in (ring < 50, (ring < 50) & (ring > 44), V - U / 9 > 107, np.abs(V - 124) < 4):
        rgb = picture()
        rgb[shape & (V > 119)] = 250
        assert score(rgb) < BOXED[0], shape.sum()
    beside = picture(HOLDS["stripes"], (135, 190))  # too far ahead to end a line
    assert score(beside) < BOXED[0]


@pytest.mark.parametrize("turn", range(4))
def test_a_long_sharp_border_needs_no_corner(turn):
    """As of a grey scale, or of another view beside this one."""
    view = picture()
    view[120:] = (90 + 20 * np.cos(U / 11))[120:, :, None]
    outline, border = found(view, turn)
    assert border > 2 * BORDER_PX
    assert outline < BOXED[0]


def test_what_is_smooth_or_slants_is_no_such_border():
    grey = picture().astype(float)
    ramp = np.clip((V - 117) / 6, 0, 1)[..., None]
    for rgb in (picture(), grey * (1 - ramp) + 220 * ramp):
        assert found(rgb.round().astype(np.uint8))[1] < BORDER_PX / 2
    slanting = picture()
    slanting[V - U / 5 > 96] = 230
    assert found(slanting)[1] < BORDER_PX
