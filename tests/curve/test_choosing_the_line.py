"""What a person may say about the line: where it begins and ends, what to leave out, its width."""

from __future__ import annotations

import numpy as np
import pytest
from canvas import Canvas, rectangle
from drawing import blend, compare, flat, to_uint8, wavy

import vfplan
from vfplan.curve.candidates import Candidate
from vfplan.curve.kinds import tell_apart
from vfplan.curve.marks import Mark
from vfplan.curve.path import Branch
from vfplan.curve.pen import Pen
from vfplan.errors import CurveError, SettingError

SHAPE, RED = (240, 320), (255, 0, 0)
WAVE = np.column_stack([np.linspace(50, 270, 900), 120 + 30 * np.sin(np.linspace(0, 6, 900))])

LOWER = np.add(WAVE, [0, 70])


def drawn(*lines, width=3.0):
    canvas = Canvas(flat(SHAPE, 90.0), "exact")
    for points in lines:
        canvas.line(points, width, RED)
    return canvas


def test_a_start_turns_the_curve_and_an_end_cuts_it():
    image = drawn(WAVE).image()
    (whole,) = vfplan.extract_curve(image).strokes
    (turned,) = vfplan.extract_curve(image, start=tuple(WAVE[-1])).strokes
    assert np.allclose(turned.points_px, whole.points_px[::-1])
    (cut,) = vfplan.extract_curve(image, start=(50, 120), end=tuple(WAVE[600])).strokes
    assert np.hypot(*(cut.points_px[-1] - WAVE[600])) < 1
    assert compare(cut, WAVE[:601]).ends < 1.5
    (back,) = vfplan.extract_curve(image, end=tuple(WAVE[10])).strokes
    assert np.hypot(*(back.points_px[-1] - WAVE[10])) < 1
    assert back.points_px[0, 0] > 260


def test_a_place_chooses_among_candidates_and_must_lie_on_one():
    image = drawn(WAVE, LOWER).image()
    with pytest.raises(CurveError, match="2 candidates"):
        vfplan.extract_curve(image)
    (stroke,) = vfplan.extract_curve(image, start=(50, 190)).strokes
    assert compare(stroke, LOWER).rms < 0.03
    with pytest.raises(CurveError, match=r"--end 270,20 lies \d+ px off the curve; at most 10 px"):
        vfplan.extract_curve(drawn(WAVE).image(), end=(270, 20))


def test_a_ring_begins_where_it_is_told_and_has_no_end():
    ring = wavy(SHAPE, 3, closed=True)
    canvas = Canvas(flat(SHAPE, 90.0), "exact")
    canvas.line(ring, 3.0, RED, closed=True)
    (stroke,) = vfplan.extract_curve(canvas.image(), start=tuple(ring[700])).strokes
    assert np.hypot(*(stroke.points_px[0] - ring[700])) < 1
    assert compare(stroke, ring, True).rms < 0.03
    with pytest.raises(CurveError, match="closed and has no end"):
        vfplan.extract_curve(canvas.image(), end=tuple(ring[700]))


def test_what_is_excluded_is_not_looked_at_and_a_cut_end_is_told():
    image = drawn(WAVE, LOWER).image()
    found = vfplan.extract_curve(image, exclude=[(0, 155, 320, 80)])
    assert compare(found.strokes[0], WAVE).rms < 0.03
    assert not found.warnings
    cut = vfplan.extract_curve(drawn(WAVE).image(), exclude=[(200, 60, 120, 120)])
    assert any("on the border of the excluded 200,60,120,120" in w for w in cut.warnings)
    with pytest.raises(SettingError, match="does not lie in"):
        vfplan.extract_curve(image, exclude=[(300, 0, 40, 10)])
    for odd in ((0.0, 0.0, 40.0, 10.0), (0, 0, 40), (0, 0, np.nan, 10)):
        with pytest.raises(SettingError, match="in whole pixels"):
            vfplan.extract_curve(image, roi=odd)


def test_a_run_that_is_wider_is_taken_when_its_width_is_accepted():
    canvas = drawn(WAVE)
    canvas.line(WAVE[300:500], 5.0, RED)
    with pytest.raises(CurveError, match="--accept-width takes it"):
        vfplan.extract_curve(canvas.image())
    found = vfplan.extract_curve(canvas.image(), accept_width=True)
    assert compare(found.strokes[0], WAVE).worst < 0.8
    assert any("as wide as elsewhere" in w for w in found.warnings)


def test_the_outline_of_a_filled_region():
    turn = np.linspace(0, 2 * np.pi, 700, endpoint=False)
    radius = 50 + 6 * np.sin(3 * turn)
    edge = [160, 120] + radius[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    canvas = Canvas(flat(SHAPE, 90.0), "exact")
    canvas.fill(edge, RED)
    found = vfplan.extract_curve(canvas.image(), outline=True)
    (stroke,) = found.strokes
    assert stroke.closed
    assert not found.warnings
    assert found.ink["curve"] == found.mask.sum()
    error = compare(stroke, edge, True)
    assert error.rms < 0.1
    assert 0.3 < error.z_rms < 1.6
    canvas.fill(rectangle((40, 40), 30, 30), RED)
    with pytest.raises(CurveError, match="one filled region, found 2"):
        vfplan.extract_curve(canvas.image(), outline=True)
    with pytest.raises(CurveError, match="one filled region, found 0"):
        vfplan.extract_curve(drawn(WAVE).image(), outline=True)


@pytest.mark.parametrize(
    ("middle", "cut"),
    [
        (160, {"roi": (160, 0, 160, 240)}),
        (160, {"exclude": [(0, 0, 160, 240)]}),
        (20, {}),
        (160, {"roi": (50, 20, 200, 200), "exclude": [(150, 60, 20, 12)]}),
    ],
)
def test_an_outline_that_follows_a_border_is_warned_of(middle, cut):
    v, u = np.mgrid[:240, :320]
    inside = np.clip(60.5 - np.hypot(u - middle, v - 120), 0, 1)
    picture = to_uint8(blend(flat(SHAPE, 90.0), inside, RED))
    (warning,) = vfplan.extract_curve(picture, outline=True, **cut).warnings
    (box,) = cut.get("exclude", [cut.get("roi", (0, 0, 320, 240))])
    name = "excluded" if "exclude" in cut else "region" if "roi" in cut else "picture"
    assert f"runs along the border of the {name} {','.join(map(str, box))} for" in warning


def test_a_border_along_a_line_is_warned_of():
    crest = round(WAVE[:, 1].min())
    for cut in ({"roi": (0, crest, 320, 240 - crest)}, {"exclude": [(0, 0, 320, crest)]}):
        (warning,) = vfplan.extract_curve(drawn(WAVE).image(), **cut).warnings
        assert "the curve runs along the border of the" in warning
    assert not vfplan.extract_curve(drawn(WAVE).image(), roi=(0, crest - 5, 320, 150)).warnings
    left = WAVE[np.argmin(WAVE[:, 1]) + 40 :]  # beyond the stretch along the border
    places = {"start": tuple(left[0]), "end": tuple(left[-1])}
    above = np.array([(0, 0, 320, crest)])
    assert not vfplan.extract_curve(drawn(WAVE).image(), exclude=above, **places).warnings


def test_the_whole_picture_as_a_region_cuts_nothing_off():
    out = np.array([[-5.0, 100], [200, 130]])
    found = vfplan.extract_curve(drawn(out).image(), roi=(0, 0, 320, 240))
    assert not found.warnings
    assert compare(found.strokes[0], out[[0, 1]]).rms < 0.1
    with pytest.raises(CurveError, match="nothing in red is a line"):
        vfplan.extract_curve(drawn(out).image(), roi=np.array([0, 0, 320, 20]))


def test_ink_beside_one_of_several_lines_is_not_told_as_beside_another():
    at = LOWER[450]
    image = drawn(WAVE, LOWER, [at, np.add(at, [0, 6])]).image()
    found = vfplan.extract_curve(image, stroke="all")
    assert len(found.strokes) == 2
    assert found.ink["own"] >= 3
    assert not any("hangs together" in w for w in found.warnings)


def test_an_end_that_was_cut_away_is_not_told_of():
    picture = drawn(WAVE).image()
    picture[60:180, 262:] = 255
    told = [
        vfplan.extract_curve(picture, roi=(0, 0, 300, 240), **places).warnings
        for places in ({}, {"end": tuple(WAVE[600])}, {"start": tuple(WAVE[600]), "end": (50, 120)})
    ]
    assert any("the curve's end" in w for w in told[0])
    assert told[1:] == [(), ()]


@pytest.mark.parametrize(
    "wrong",
    [
        {"start": (50, 120), "method": "mask"},
        {"end": (50, 120), "stroke": "all"},
        {"outline": True, "method": "skeleton"},
    ],
)
def test_settings_that_exclude_each_other(wrong):
    with pytest.raises(SettingError):
        vfplan.extract_curve(drawn(WAVE).image(), **wrong)


def test_the_ink_is_accounted_for():
    canvas = drawn(WAVE)
    canvas.text("cut 7", (100, 220), RED)
    found = vfplan.extract_curve(canvas.image())
    assert sum(found.ink.values()) == found.mask.sum()
    assert found.ink["curve"] > 2 * sum(n for kind, n in found.ink.items() if kind != "curve")


def test_a_line_of_which_half_is_too_faint_for_the_mask_is_told_apart():
    path = np.column_stack([np.arange(5, 65), np.full(60, 20)])
    pen, mask = Pen.of_colour("red"), np.zeros((40, 80), bool)
    mask[19:22, 5:15] = True
    mark = Mark("curve", pen, 3.0, (Branch(path, False, (True, True)),), (), 30, (5, 19, 10, 3))
    kept, aside = tell_apart([Candidate.of_mark(mark)], mask)
    assert [c.kind for c in kept] == ["curve"]
    assert not aside


@pytest.mark.parametrize(("width", "told"), [(1.5, True), (3.0, False)])
def test_a_thin_straight_line_beside_the_curve_is_a_bar_and_one_of_its_pen_is_not(width, told):
    canvas = drawn(WAVE, width=3.5)
    canvas.line([(80, 190), (150, 215)], width, RED)
    if not told:
        with pytest.raises(CurveError, match="2 candidates"):
            vfplan.extract_curve(canvas.image())
        return
    found = vfplan.extract_curve(canvas.image())
    assert [mark["kind"] for mark in found.set_aside] == ["bar"]
    assert not found.warnings
