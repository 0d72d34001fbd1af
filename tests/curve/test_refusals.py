"""What is refused: each by its code, with the place and the numbers."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
import slices
from canvas import Canvas
from drawing import arc_of, blend, coverage, flat, normal_errors, to_uint8
from refusals import refuses

from vfplan.curve.extraction import extract_curve
from vfplan.errors import CurveError, SettingError

RED = (255, 0, 0)
SHAPE = (300, 340)
T = np.linspace(0, 1, 600)


def line(u0, v0, u1, v1, bow=0.0):
    """(600, 2) a line, bowed sideways."""
    u, v = u0 + (u1 - u0) * T, v0 + (v1 - v0) * T
    return np.column_stack([u, v + bow * np.sin(np.pi * T)])


def paint(*curves, width=3.0, colour=RED, closed=False):
    share = np.max([coverage(SHAPE, curve, width, closed) for curve in curves], axis=0)
    return to_uint8(blend(flat(SHAPE), share, colour))


TWO_LINES = paint(line(40, 80, 300, 80), line(40, 220, 300, 220))
BOWED = line(40, 150, 300, 150, 30)


def pressed(widths):
    """What is found of a line whose pen has another width at each point."""
    canvas = Canvas(flat(SHAPE), "exact")
    canvas.pressed(BOWED, widths, RED)
    return extract_curve(canvas.image())


def refusal(image, **options):
    with pytest.raises(CurveError) as refused:
        extract_curve(image, **options)
    return refused.value


@pytest.mark.parametrize("name", ["#0000ff", "#ffff00", "#ffa500", "#1f77b4", "#00ff7f", "#1e90ff"])
def test_no_ink_but_another_pens_line_is_named_by_its_own_colour(name):
    curve = line(40, 100, 290, 140, 40)
    image = paint(curve, colour=tuple(bytes.fromhex(name[1:])))
    error = refusal(image)
    assert (error.code, error.numbers["other_colour"]) == ("no-line", name)
    assert error.numbers["other_length_px"] == pytest.approx(arc_of(curve)[-1], rel=0.05)
    wrong, found, *_ = error.message.split(". ")
    assert (wrong, found[:12]) == ("No line was drawn in red", "Longest line")
    assert found.endswith(f"--colour '{name}'")
    assert extract_curve(image, colour=name).findings == ()


@pytest.mark.parametrize("seed", [6, 15, 18, 19])
def test_an_orange_bar_in_jpeg_is_no_red_line(seed):
    """JPEG spreads some of the bar's pixels into the hues of red."""
    image = slices.draw("orange bar", seed).image
    assert refusal(image).code == "no-line"
    assert len(extract_curve(image, colour="#ff7f0e").strokes) == 1


@pytest.mark.parametrize("box", [{"roi": (10, 200, 100, 60)}, {"exclude": [(30, 60, 280, 60)]}])
def test_a_region_that_misses_the_line_is_named(box):
    error = refusal(paint(line(40, 80, 300, 90)), **box)
    assert error.code == "no-line"
    assert "within what --roi and --exclude leave" in error.message
    assert "--roi" not in refusal(paint(line(40, 100, 44, 100), width=8.0)).message


def test_several_candidates_with_the_gap_between_them():
    first, second = line(40, 100, 150, 100, 20), line(190, 100, 300, 100, -20)
    image = paint(first, second, line(60, 180, 110, 180, 10))
    error = refusal(image)
    assert (error.code, error.numbers["candidates"]) == ("several-candidates", 2)
    assert error.numbers["gap_px"] == pytest.approx(37, abs=3)
    assert error.numbers["u_px"] == pytest.approx(170, abs=3)
    assert len(error.candidates) == 2
    (one,) = extract_curve(image, stroke=2).strokes
    assert one.points_px[:, 0].min() > 180 or one.points_px[:, 0].max() < 160
    whole = extract_curve(image, stroke="all")
    assert len(whole.strokes) == 2
    assert "line-left-out" in [f.code for f in whole.findings], "the third line is too short"
    assert len(extract_curve(image, stroke="longest").strokes) == 1
    assert refusal(image, stroke=4).code == "stroke-number"


@pytest.mark.parametrize("strength", [0.15, 0.3, 0.45])
def test_a_paler_line_behind_a_gap_is_another_pens(strength):
    dark, pale = (coverage(SHAPE, line(u, 100, u + 120, 100, 20), 3.0) for u in (40, 176))
    assert len(extract_curve(to_uint8(blend(flat(SHAPE), dark + pale, RED))).strokes) == 1
    image = to_uint8(blend(flat(SHAPE), dark + strength * pale, RED))
    assert refusal(image).code == "several-candidates"


@pytest.mark.parametrize("second, max_gap, advised", [
    (line(160, 100, 290, 100), 10.0, True),
    (line(160, 100, 170, 230), 60.0, False),  # the directions differ
    (line(240, 100, 330, 100), 20.0, False),  # the gap is longer than a line
])  # fmt: skip
def test_a_wider_gap_is_advised_only_where_it_joins_the_lines(second, max_gap, advised):
    image = paint(line(30, 100, 120, 100), second)
    error = refusal(image, max_gap_px=max_gap)
    assert error.code == "several-candidates"
    longer = re.search(r"--max-gap (\d+) joins", str(error))
    assert ("--max-gap" in str(error)) == (longer is not None) == advised
    if advised:
        assert len(extract_curve(image, max_gap_px=float(longer[1])).strokes) == 1


def test_a_fork_and_a_crossing_name_their_place():
    turn = np.linspace(0, 2 * np.pi, 1200)
    eight = np.column_stack([170 + 100 * np.sin(turn), 150 + 70 * np.sin(2 * turn)])
    for image in (paint(eight), paint(line(40, 150, 300, 150), line(170, 150, 250, 60))):
        error = refusal(image)
        assert error.code == "line-forks"
        place = error.numbers["u_px"], error.numbers["v_px"]
        assert np.hypot(*np.subtract(place, (170, 150))) < 6
        assert error.where == f"pixel ({place[0]:.0f}, {place[1]:.0f})"
        assert "vfplan review IMAGE" in error.message


def test_runs_side_by_side():
    image = paint(BOWED, np.add(BOWED[200:420], (0.0, 3.0)))
    error = refusal(image)
    assert error.code == "runs-side-by-side"
    assert error.numbers["width_ratio"] > 1.5
    assert 100 < error.numbers["u_px"] < 250
    assert len(extract_curve(image, accept_width=True).strokes) == 1


@pytest.mark.parametrize("widths, asked", [
    ((2.2, 4.8), True), ((6.0, 3.0), True), ((6.5, 2.0), True), ((2.0, 7.0, 2.0, 7.0), True),
    ((3, 3, 6, 6, 3, 3, 3), True), ((3.0, 3.6, 3.0), False)])  # fmt: skip
def test_a_pressed_pen_is_measured_and_asked_about_where_it_is_wide(widths, asked):
    widths = np.interp(T, np.linspace(0, 1, len(widths)), widths)
    extraction = pressed(widths)
    found = [(f.code, f.severity) for f in extraction.findings]
    assert found == [("width-changes", "doubt")] * asked
    for finding in extraction.findings:
        assert np.interp(finding.place_px[0], BOWED[:, 0], widths) > widths.mean()
    [stroke] = extraction.strokes
    assert np.abs(normal_errors(stroke.points, BOWED, False)[8:-8]).max() < 0.2
    assert np.median(stroke.sigma) < 0.1, "a pressed pen is known as well as any"


@pytest.mark.parametrize("apart", [2.5, 3.0, 3.5])
def test_a_valley_between_two_lines_is_a_double_line(apart):
    error = refusal(paint(BOWED, np.add(BOWED, (0.0, apart)), width=2.0))
    assert error.code == "double-line"
    assert error.numbers["dip"] > 0.12


def test_more_pieces_than_anybody_draws():
    image = np.full((590, 590, 3), 128, np.uint8)
    image[(np.indices((590, 590)) % 10 < 3).all(axis=0)] = RED
    error = refusal(image)
    assert (error.code, error.numbers["pieces"]) == ("too-many-pieces", 59**2)


def test_a_cover_that_is_longer_than_the_longest_bridged():
    image = paint(BOWED)
    cv2.rectangle(image, (150, 120), (190, 220), (0, 200, 60), -1)
    error = refusal(image)
    assert error.code in ("bridge-too-long", "several-candidates")
    assert error.numbers["gap_px"] == pytest.approx(40, abs=8)
    extraction = extract_curve(image, max_gap_px=50)
    assert [finding.code for finding in extraction.findings] == ["stretch-hidden"]


def test_a_frame_along_the_border_is_no_curve():
    image, only = paint(line(60, 150, 280, 150, 30)), to_uint8(flat(SHAPE))
    for framed in (image, only):
        cv2.rectangle(framed, (6, 6), (333, 293), RED, 2)
    (stroke,) = extract_curve(image).strokes
    assert not stroke.closed
    assert refusal(only).code == "only-a-frame"
    assert extract_curve(only, stroke=1).strokes[0].closed


@pytest.mark.parametrize("options, code", [
    ({"method": "magic"}, "method-unknown"),
    ({"stroke": 0}, "stroke-unknown"),
    ({"stroke": True}, "stroke-unknown"),
    ({"max_gap_px": -1.0}, "max-gap"),
    ({"max_gap_px": float("inf")}, "max-gap"),
    ({"colour": "grey"}, "colour-grey"),
    ({"colour": "no colour"}, "colour-unknown"),
    ({"roi": (0, 0, 400, 10)}, "region-outside"),
    ({"roi": (0, 0, 0, 10)}, "region-outside"),
    ({"exclude": [(0.5, 0, 10, 10)]}, "region-not-a-box"),
    ({"start": (1, 1), "method": "mask"}, "start-without-order"),
    ({"start": (1, 1), "stroke": "all"}, "start-without-order"),
])  # fmt: skip
def test_settings_out_of_range(options, code):
    with refuses(SettingError, code):
        extract_curve(paint(line(40, 150, 300, 150)), **options)


def test_start_and_end_cut_and_turn_the_curve():
    image = paint(line(40, 150, 300, 150))
    whole = extract_curve(image).strokes[0]
    part = extract_curve(image, start=(250, 150), end=(100, 150)).strokes[0]
    assert part.points_px[0] == pytest.approx([250, 150], abs=1)
    assert part.points_px[-1] == pytest.approx([100, 150], abs=1)
    assert part.length == pytest.approx(150, abs=2)
    turned = extract_curve(image, start=(300, 150)).strokes[0]
    assert np.allclose(turned.points_px, whole.points_px[::-1])
    assert refusal(image, start=(100, 150), end=(100, 150)).code == "start-is-end"


def test_places_that_no_line_passes_by_are_refused():
    for start, end, distance_px in (((170, 120), None, 40), ((40, 80), (300, 220), 140)):
        error = refusal(TWO_LINES, start=start, end=end)
        assert error.code == "place-off-curve"
        assert error.numbers["distance_px"] == pytest.approx(distance_px, abs=1)
    assert refusal(TWO_LINES * 0, start=(40, 80)).code == "image-grey"


def test_a_start_chooses_among_candidates_and_where_a_ring_begins():
    stroke = extract_curve(TWO_LINES, start=(298, 221)).strokes[0]
    assert stroke.points_px[:, 1] == pytest.approx(220, abs=1)
    turn = np.linspace(0, 2 * np.pi, 900, endpoint=False)
    ring = np.column_stack([170 + 80 * np.cos(turn), 150 + 80 * np.sin(turn)])
    image = paint(ring, closed=True)
    stroke = extract_curve(image, start=(250, 150)).strokes[0]
    assert stroke.points_px[0] == pytest.approx([250, 150], abs=1)
    assert refusal(image, end=(250, 150)).code == "end-of-a-ring"


def test_a_region_and_what_is_excluded():
    stroke = extract_curve(TWO_LINES, roi=(0, 150, 340, 150)).strokes[0]
    assert stroke.points_px[:, 1].min() > 200
    stroke = extract_curve(TWO_LINES, exclude=[(0, 150, 340, 150)]).strokes[0]
    assert stroke.points_px[:, 1].max() < 100
    straight, finding = extract_curve(TWO_LINES, roi=(100, 150, 240, 150)).findings
    assert (straight.code, straight.severity) == ("curve-straight", "doubt")
    assert (finding.code, finding.severity) == ("end-at-region", "note")
