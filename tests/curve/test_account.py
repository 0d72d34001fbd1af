"""What is listed, and what a person is asked to look at."""

from __future__ import annotations

import cv2
import extraction_kinds
import numpy as np
import pytest
import slices
from canvas import Canvas
from drawing import blend, coverage, flat, to_uint8

from vfplan.curve.account import find_leftover, fold_findings, join_findings
from vfplan.curve.coverage import Pen, find_ink
from vfplan.curve.extraction import extract_curve
from vfplan.errors import CurveError
from vfplan.fixture import Stroke

RED, GREEN = (255, 0, 0), (0, 200, 60)
SHAPE = (300, 340)
T = np.linspace(0, 1, 600)
CURVE = np.column_stack([60 + 220 * T, 150 + 30 * np.sin(np.pi * T)])


def painted(*lines):
    """A flat picture with red lines: (curve, width) each."""
    shares = [coverage(SHAPE, np.asarray(curve, float), width) for curve, width in lines]
    return to_uint8(blend(flat(SHAPE), np.max(shares, axis=0), RED))


def picture(*more, width=3.0):
    return painted((CURVE, width), *more)


def codes(extraction):
    return [finding.code for finding in extraction.findings]


def test_all_other_ink_is_listed_the_largest_first():
    image = picture(([(40, 40), (90, 40)], 3.0), ([(300, 30), (306, 30)], 6.0))
    extraction = extract_curve(image)
    assert codes(extraction) == []
    first, second = extraction.account
    assert (first.number, second.number) == (1, 2)
    assert (first.u, first.v) == pytest.approx((65, 40), abs=1.5)
    assert first.pixels == pytest.approx(150, abs=25)
    assert first.pixels > second.pixels
    assert first.share == pytest.approx(first.pixels / np.count_nonzero(extraction.mask), rel=0.1)


@pytest.mark.parametrize("gap, way, found", [
    (25, (10, 0), ["ink-at-end"]), (48, (10, 0), ["ink-joins"]), (48, (0, 10), []),
    (70, (10, 0), []), (25, (1, 0), [])])  # fmt: skip
def test_ink_ahead_of_an_end_is_asked_about_unless_it_is_a_dot_or_far(gap, way, found):
    start = np.add(CURVE[-1], (gap, 0.0))
    stop = np.add(start, way)
    image = np.full((*SHAPE[:1], 460, 3), 220, np.uint8)
    image[:, :340] = picture()
    cv2.line(image, np.rint(start).astype(int), np.rint(stop).astype(int), RED, 3)
    extraction = extract_curve(image)
    assert codes(extraction) == found
    assert len(extraction.account) == 1


BOXED, VEILED, HIDDEN, OVER_THE_END = (picture() for _ in range(4))
HIDDEN[120:190, 230:] = 150  # and nothing tells of what is below
# The veil lies over the last 50 px of the curve, and its ink is no part of the mask.
VEILED[120:190, 230:] = np.rint(0.08 * VEILED[120:190, 230:] + 0.92 * 150)
BOXED[:, 190:230] = 128  # A quarter of the curve lies beyond.
cv2.line(OVER_THE_END, (280, 130), (280, 170), GREEN, 4)
DOT = CURVE[300] + [0.0, 5.2]
DOTS = [([CURVE[-1] + [gap, 0.0], CURVE[-1] + [gap + 1, 0.0]], 3.0) for gap in (10, 18, 26)]
SLOWLY = CURVE + np.outer(np.sin(np.pi * T) ** 2, (0.0, 2.0))
ALONG_BORDER = np.vstack([CURVE, [[330, 150], [336, 152], [336, 260]]])


@pytest.mark.parametrize(
    "image, found, place, within",
    [
        (painted((CURVE[:450], 3.0), (CURVE[560:], 3.0)), ["ink-at-end"], CURVE[560], 4),
        (BOXED, ["ink-at-end"], (231, 169), 3),
        (picture((CURVE[200:212], 6.0)), ["width-changes"], CURVE[206], 2.8),
        (picture((SLOWLY, 3.0)), ["width-changes"], CURVE[300], 60),
        (painted((ALONG_BORDER, 3.0)), ["curve-on-border", "corner-near-end", "leaves-picture"],
         (337, 205), 6),
        (picture()[:, 100:], ["leaves-picture"], (0, 166), 1),
        (picture(([DOT, np.add(DOT, (0.1, 0))], 5.0)), ["ink-touches"], DOT, 1),
        (picture(*DOTS), ["ink-at-end"] * 3, CURVE[-1] + [10.5, 0.0], 1),
        (OVER_THE_END, ["end-other-colour"], CURVE[-1], 6),
        (VEILED, ["ink-at-end"], (230, 170), 3),
    ],
    ids=["beyond a long gap", "beyond a box", "a wider stretch", "drawn twice", "along the border",
         "on it", "a dot beside", "dots ahead", "another colour", "under a veil"],
)  # fmt: skip
def test_a_finding_lies_where_its_cause_is_seen(image, found, place, within):
    extraction = extract_curve(image)
    assert codes(extraction) == found
    assert extraction.findings[0].place_px == pytest.approx(place, abs=within)
    assert {(f.severity, f.stage) for f in extraction.findings} == {("doubt", "extract")}


@pytest.mark.parametrize("arcs", [[(5, 355)], [(5, 178), (182, 355)]])
def test_the_one_gap_of_a_ring_is_asked_about_and_several_are_noted(arcs):
    turns = [np.radians(np.linspace(*arc, 200)) for arc in arcs]
    lines = [170 + 80 * np.column_stack([np.cos(turn), np.sin(turn)]) for turn in turns]
    extraction = extract_curve(painted(*((line, 3.0) for line in lines)))
    assert extraction.strokes[0].closed
    assert codes(extraction) == {1: ["bridge-near-end"], 2: ["bridge"] * 2}[len(arcs)]
    places = [finding.place_px for finding in extraction.findings]
    assert pytest.approx((250, 170), abs=1) in places


def test_a_line_off_the_direction_of_an_end_and_a_frame_around_all_are_listed_only():
    aside = CURVE[-1] + [34.0, 36.0]
    frame = [(8, 8), (331, 8), (331, 291), (8, 291), (8, 8)]
    for other in ([aside, np.add(aside, (12, 38))], frame):
        extraction = extract_curve(picture((other, 3.0)))
        assert (codes(extraction), len(extraction.account)) == ([], 1)


@pytest.mark.parametrize("width, code", [(8, ["bridge"]), (30, ["stretch-hidden"])])
def test_a_long_hidden_stretch_is_asked_about_and_a_short_one_is_noted(width, code):
    image = picture()
    u, v = CURVE[300]
    left, right = round(u - width / 2), round(u + width / 2)
    cv2.rectangle(image, (left, round(v) - 20), (right, round(v) + 20), GREEN, -1)
    extraction = extract_curve(image, max_gap_px=40)
    assert codes(extraction) == code
    (entry,) = extraction.account
    assert entry.what == "hidden"
    assert (entry.u, entry.v) == pytest.approx((u, v), abs=4)
    assert extraction.strokes[0].points_px[0, 0] < 65


@pytest.mark.parametrize(
    "middle, gap, code",
    [(300, 10, "bridge"), (300, 32, "bridge-long"), (500, 10, "bridge-near-end"),
     (420, 10, "bridge-near-end")],
)  # fmt: skip
def test_each_bridge_is_told_and_one_that_is_long_or_before_a_leader_line_is_asked_about(
    middle, gap, code
):
    half = round(300 * gap / 110 / 2)
    image = painted((CURVE[: middle - half], 3.0), (CURVE[middle + half :], 3.0))
    extraction = extract_curve(image, max_gap_px=40)
    (finding,) = extraction.findings
    assert (finding.code, finding.severity == "note") == (code, code == "bridge")
    (entry,) = extraction.account
    assert entry.what == "bridge"
    assert np.count_nonzero(extraction.strokes[0].bridged) == entry.pixels


def test_a_change_of_width_is_asked_about_in_the_point_of_a_pen_that_was_drawn_out():
    canvas = Canvas(flat(SHAPE), "exact")
    canvas.pressed(CURVE, np.minimum(4.0, 0.03 * np.arange(600, 0, -1) + 0.4), RED)
    found = extract_curve(canvas.image()).findings
    places = [finding.place_px for finding in found if finding.code == "width-changes"]
    assert [place[0] > CURVE[450, 0] for place in places] == [True]


def test_faint_ink_that_is_listed_is_asked_about_once():
    faint = coverage(SHAPE, CURVE[500:], 1.0)
    image = blend(flat(SHAPE), np.maximum(coverage(SHAPE, CURVE[:470], 4.0), 0.5 * faint), RED)
    assert codes(extract_curve(to_uint8(image))).count("ink-at-end") == 1


@pytest.mark.parametrize(
    "kind, seed",
    [("linear light", 13), ("thin", 14), ("taper", 19), ("leader", 7),
     ("window frame", 15), ("leader", 3), ("leader", 16)],
)  # fmt: skip
def test_what_the_picture_explains_is_not_asked_about(kind, seed):
    findings = extract_curve(slices.draw(kind, seed).image).findings
    assert [finding.text for finding in findings if finding.severity == "doubt"] == []


@pytest.mark.parametrize(
    "kind, seed, code",
    [*(("double run", seed, "width-changes") for seed in (271839, 314160, 314178)),
     *(("letter at an end", seed, "corner-near-end") for seed in (5058, 5080, 5109, 5138)),
     ("letter at an end", 13705, "width-changes")],
)  # fmt: skip
def test_a_second_run_in_jpeg_and_a_letter_are_asked_about(kind, seed, code):
    assert code in codes(extract_curve(extraction_kinds.draw(kind, seed).image))


@pytest.mark.parametrize("grey, asked", [(90, True), (None, False)])
def test_an_even_grey_at_an_end_is_asked_about(grey, asked):
    rough = np.random.default_rng(3).normal(0, 6, SHAPE)
    image = to_uint8(blend(flat(SHAPE) + rough[..., None], coverage(SHAPE, CURVE, 3.0), RED))
    if grey is not None:
        image[120:190, 250:300] = grey
    assert ("end-other-colour" in codes(extract_curve(image))) == asked


def test_strokes_on_both_sides_of_the_line_are_asked_about():
    at = CURVE[300]
    ticks = [([at, np.add(at, (9, 12 * side))], 2.0) for side in (-1, 1)]
    image, ink = picture(*ticks), find_ink(picture(*ticks), Pen.of_colour("red"))
    with pytest.raises(CurveError, match="forks"):
        extract_curve(image)
    leftover = find_leftover(ink, extract_curve(picture()).strokes)
    found = join_findings(leftover, (), ink, 20.0, ())
    assert [finding.code for finding in found] == ["ink-joins"] * 2


@pytest.mark.parametrize("length, code", [(10, "ink-touches"), (16, "width-changes")])
def test_a_thin_stroke_at_the_end_of_a_broad_line_is_asked_about_where_it_lies(length, code):
    end = CURVE[-1]
    stroke = [end, np.add(end, (0.08 * length, length))]
    extraction = extract_curve(picture((stroke, 1.5), width=4.0))
    assert codes(extraction) == [code]
    assert np.hypot(*(stroke[1] - extraction.findings[0].place_px)) < 10


@pytest.mark.parametrize("turn_deg, found", [(0, []), (40, ["corner-near-end"]),
                                                 (90, ["corner-near-end"])])  # fmt: skip
def test_a_leader_line_that_leaves_the_end_at_a_corner_is_asked_about_there(turn_deg, found):
    end, before = CURVE[[-1, -2]]
    way = np.radians(turn_deg) + np.arctan2(*(end - before)[::-1])
    image = picture(([end, np.add(end, (50 * np.cos(way), 50 * np.sin(way)))], 3.0))
    findings = extract_curve(image).findings
    assert [f.code for f in findings] == found
    assert all(np.hypot(*(f.place_px - end)) < 2 for f in findings)
    assert codes(extract_curve(image, end=tuple(end))) == []


@pytest.mark.parametrize("gap_px, found", [(26.0, [("ink-at-end", True)]), (60.0, [])])
def test_ends_that_face_each_other_over_a_gap_are_asked_about(gap_px, found):
    angle = np.linspace(0, 2 * np.pi, 801) + (gap_px + 3.0) / 160 * np.linspace(1, -1, 801)
    ring = np.column_stack([170 + 80 * np.cos(angle), 150 + 80 * np.sin(angle)])
    findings = extract_curve(painted((ring, 3.0))).findings
    assert [(f.code, f.place_px == pytest.approx((250, 150), abs=3)) for f in findings] == found


def test_strong_ink_on_a_pale_line_and_a_colour_across_a_broad_one_break_no_line():
    pale = blend(flat(SHAPE), coverage(SHAPE, CURVE, 3.0), RED, 0.45)
    rested = to_uint8(blend(pale, coverage(SHAPE, CURVE[300:325], 3.0), RED))
    bent = np.column_stack([CURVE[:, 0], 150 + 60 * np.sin(2 * np.pi * T)])
    crossed = painted((bent, 12.0))
    cv2.line(crossed, (150, 94), (191, 206), (0, 255, 255), 8, cv2.LINE_AA)
    for image, length in ((rested, 230), (crossed, 338)):
        assert extract_curve(image).strokes[0].length == pytest.approx(length, abs=4)


@pytest.mark.parametrize("end", [260, 380])
def test_a_gap_between_two_chosen_strokes_is_asked_about(end):
    image, ends = painted((CURVE[:180], 3.0), (CURVE[end:], 3.0)), CURVE[[180, end]]
    extraction = extract_curve(image, stroke="all")
    assert len(extraction.strokes) == 2
    # The gap, not a stroke that is taken; and of a line that is left out its end there.
    for findings, words, place in (
        (extraction.findings, "between two strokes", ends.mean(axis=0)),
        (extract_curve(image, stroke="longest").findings, "begins here", ends[0]),
    ):
        assert [f.code for f in findings if words in f.text] == ["ink-at-end"]
        assert findings[-1].place_px == pytest.approx(place, abs=5)


def test_a_fourth_piece_at_the_line_and_a_curve_that_runs_back_are_asked_about():
    dots = [([CURVE[k] + [0.0, 5.2], CURVE[k] + [0.1, 5.2]], 5.0) for k in (120, 240, 360, 480)]
    assert codes(extract_curve(picture(*dots))).count("ink-joins") == 1
    back = painted((CURVE, 3.0), (np.add(CURVE[100:500], (0.0, 5.5)), 3.0))
    assert "curve-folds" in codes(extract_curve(back, stroke="all"))
    x, y = np.r_[0:60, [60] * 17, 61:100], np.r_[np.zeros(60), 0:9, 7:-1:-1, np.zeros(39)]
    spur = Stroke(np.column_stack([x, y]), False, width=3.0)
    assert [found.code for found in fold_findings([spur])] == ["curve-folds"]


@pytest.mark.parametrize("image, marks", [(picture(), 0), (picture(), 9), (HIDDEN, 0)])
def test_markers_and_words_of_other_colours_are_no_account(image, marks):
    for k in range(marks):
        place = 20 + 35 * k, 40
        cv2.drawMarker(image, place, (0, 255, 255), cv2.MARKER_CROSS, 14, 2)
        cv2.putText(image, f"x{k}", place, cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255, 255, 0), 1)
    extraction = extract_curve(image)
    assert (extraction.account, codes(extraction)) == ((), [])


def test_what_was_cut_off_is_not_asked_about():
    start = CURVE[-1] + [12.0, 0.0]
    image = picture(([start, np.add(start, (20, 0))], 8.0))
    assert codes(extract_curve(image, max_gap_px=10)) == ["ink-at-end"]
    assert codes(extract_curve(image, max_gap_px=10, end=(220, 173))) == []


@pytest.mark.parametrize("slope", [40, 60])
def test_the_deviation_covers_the_kink_where_the_ends_of_a_ring_cross(slope):
    angle = np.linspace(-0.12, 2 * np.pi + 0.12, 900)
    radius = 100 + slope * (np.minimum(angle, 0) + np.maximum(angle - 2 * np.pi, 0))
    ends = np.column_stack([170 + radius * np.cos(angle), 150 + radius * np.sin(angle)])
    (stroke,) = extract_curve(painted((ends, 5.0))).strokes
    across = np.abs(np.hypot(*(stroke.points - (170, 150)).T) - 100)
    assert stroke.closed
    assert across.max() > 1
    assert (across <= 1.96 * stroke.sigma + 0.05).all()


def test_the_deviation_covers_what_a_letter_adds_to_one_side():
    (stroke,) = extract_curve(picture((np.add(CURVE[200:225], (0.0, 2.0)), 3.0))).strokes
    across = np.abs(stroke.points[:, 1] - np.interp(stroke.points[:, 0], *CURVE.T))
    assert across.max() > 0.7
    assert (across <= 1.96 * stroke.sigma + 0.05).all()
