"""Doubt about which curve is meant: who names a line is believed, and each refusal shows a way."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from drawing import blend, compare, coverage, flat, to_uint8

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
    around = vfplan.extract_curve(drawn(BOX[[0, 1, 2, 3, 0]], 0.5 * WAVE + np.array([100, 75])))
    assert not around.warnings  # a panel's frame, as many slices have
