"""Which curve: what is set aside, bridged, kept apart or refused."""

from __future__ import annotations

import functools
import re

import cv2
import numpy as np
import pytest
from drawing import (
    anatomy,
    blend,
    compare,
    coverage,
    flat,
    jpeg,
    normal_errors,
    polyline,
    to_uint8,
    wavy,
)

import vfplan
from vfplan.errors import CurveError, ImageError, SettingError

RED = (255, 0, 0)
SHAPE = (400, 480)


@functools.cache
def slice_with_curve(closed):
    picture = anatomy(SHAPE, 3)
    curve = wavy(SHAPE, 11, closed, margin=0.2)
    return to_uint8(blend(picture, coverage(SHAPE, curve, 3, closed), RED)), curve


def pen(*parts, width=3, closed=False, background=None):
    share = np.zeros(SHAPE)
    for part in parts:
        share = np.maximum(share, coverage(SHAPE, np.asarray(part, float), width, closed))
    return to_uint8(blend(flat(SHAPE) if background is None else background, share, RED))


def text(image):
    cv2.putText(image, "L 12 mm", (8, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.6, RED, 1, cv2.LINE_AA)
    cv2.putText(image, "R", (450, 390), cv2.FONT_HERSHEY_SIMPLEX, 0.9, RED, 2, cv2.LINE_AA)


def arrow(image):
    cv2.arrowedLine(image, (20, 20), (80, 50), RED, 3, cv2.LINE_AA, 0, 0.25)


def filled_arrow(image):
    cv2.line(image, (20, 20), (70, 45), RED, 3, cv2.LINE_AA)
    cv2.fillConvexPoly(image, np.array([[84, 52], [62, 50], [70, 34]]), RED, cv2.LINE_AA)


def swatch(image):
    cv2.rectangle(image, (10, 10), (34, 26), RED, -1)


def legend_line(image):
    cv2.line(image, (10, 380), (40, 380), RED, 3)


def panel(image):
    cv2.rectangle(image, (5, 5), (75, 55), (255, 110, 120), -1)


def panel_with_text(image):
    cv2.rectangle(image, (5, 5), (85, 55), RED, -1)
    cv2.putText(image, "CASE", (12, 38), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 2)


def frame(image):
    cv2.rectangle(image, (8, 8), (90, 50), RED, 3)


def frame_round_the_image(image):
    cv2.rectangle(image, (1, 1), (SHAPE[1] - 2, SHAPE[0] - 2), RED, 2)


def crosses_and_dots(image):
    for k in range(3):
        cv2.drawMarker(image, (20 + 40 * k, 20), RED, cv2.MARKER_CROSS, 18, 2, cv2.LINE_AA)
        cv2.circle(image, (20 + 40 * k, 380), 5, RED, -1, cv2.LINE_AA)


def rings(image):
    for k in range(3):
        cv2.circle(image, (20 + 40 * k, 20), 8, RED, 2, cv2.LINE_AA)


def markers_and_labels(image):
    for k, (u, v) in enumerate([(40, 40), (240, 60), (430, 350)]):
        cv2.drawMarker(image, (u, v), (0, 220, 255), cv2.MARKER_CROSS, 14, 1)
        place = (u + 8, v - 8)
        cv2.putText(image, f"x{k}", place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 0), 1)


ORNAMENTS = [
    text, arrow, filled_arrow, swatch, legend_line, panel, panel_with_text, frame,
    frame_round_the_image, crosses_and_dots, rings, markers_and_labels,
]  # fmt: skip


@pytest.mark.parametrize("quality", [None, 80], ids=["png", "jpeg80"])
@pytest.mark.parametrize("ornament", ORNAMENTS, ids=lambda f: f.__name__)
def test_what_is_no_curve_is_set_aside_and_reported(ornament, quality):
    image, curve = slice_with_curve(True)
    image = image.copy()
    ornament(image)
    extraction = vfplan.extract_curve(jpeg(image, quality) if quality else image)
    (stroke,) = extraction.strokes
    error = compare(stroke, curve, True)
    assert error.worst < 0.8
    assert error.uncovered < 2
    if ornament is not markers_and_labels:
        assert extraction.set_aside
        assert all(mark["kind"] != "curve" for mark in extraction.set_aside)


def signed(image, u, v):
    """The image with a cyan plus and its label at a place, as markers are drawn."""
    for way in ([7, 0], [0, 7]):
        bar = np.array([u, v]) + np.outer([1, -1], way)
        image = blend(image, coverage(SHAPE, bar, 2, cap="butt"), (0, 220, 255))
    image = to_uint8(image)
    place = (int(u) + 8, int(v) - 6)
    cv2.putText(image, "x5", place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (240, 240, 0), 1, cv2.LINE_AA)
    return image


def test_a_sign_over_the_curve_never_costs_half_of_it():
    """What is left beside the sign may fork like an arrow; it is doubted, not dropped."""
    t = np.linspace(0, 1, 2000)
    curve = np.column_stack([40 + 400 * t, 200 + 40 * np.sin(4 * t)])
    refused = 0
    for width in (3, 4.5):
        image = blend(flat(SHAPE, 60.0), coverage(SHAPE, curve, width), RED)
        for aside in (0, 2, 3, 3.5, 4, 4.5, 6):
            picture = signed(image, *curve[1000] + [0, aside])
            try:
                (stroke,) = vfplan.extract_curve(picture).strokes
            except CurveError as error:
                refused += "candidates and none was chosen" in error.message
                continue
            assert compare(stroke, curve).uncovered < 3
    assert 0 < refused < 7


def test_a_line_that_ends_in_a_dot_is_no_arrow_beside_another_of_its_length():
    cut = np.array([[60, 120], [400, 130]])
    dot = cut[1] + 3 * np.column_stack([np.cos(T), np.sin(T)])
    image = pen(cut, dot, np.add(cut, [0, 120]))
    with pytest.raises(CurveError, match="2 candidates and none was chosen"):
        vfplan.extract_curve(image)


def two_strokes():
    ring = 40 + 25 * np.column_stack([np.cos(T), np.sin(T)])
    image, _ = slice_with_curve(False)
    share = coverage(SHAPE, ring, 3, True)
    return to_uint8(blend(image.astype(float), share, RED))


T = np.linspace(0, 2 * np.pi, 400, endpoint=False)


def test_several_candidates_are_described_and_none_is_chosen():
    with pytest.raises(CurveError, match="2 candidates") as caught:
        vfplan.extract_curve(two_strokes())
    message = str(caught.value)
    assert "1: open" in message
    assert "2: closed" in message
    assert "--stroke" in message


def test_a_stroke_is_chosen_by_number_length_region_or_all():
    image = two_strokes()
    assert [s.closed for s in vfplan.extract_curve(image, stroke="all").strokes] == [False, True]
    assert [s.closed for s in vfplan.extract_curve(image, stroke="longest").strokes] == [False]
    assert [s.closed for s in vfplan.extract_curve(image, stroke=2).strokes] == [True]
    (ring,) = vfplan.extract_curve(image, roi=(5, 5, 75, 75)).strokes
    assert ring.closed
    assert np.allclose(ring.points_px.mean(0), 40, atol=0.2)
    with pytest.raises(CurveError, match="there are 2"):
        vfplan.extract_curve(image, stroke=3)


def test_the_colour_tells_two_pens_apart():
    image, curve = slice_with_curve(False)
    ring = 40 + 25 * np.column_stack([np.cos(T), np.sin(T)])
    both = to_uint8(blend(image.astype(float), coverage(SHAPE, ring, 3, True), (0, 0, 255)))
    (red,) = vfplan.extract_curve(both).strokes
    (blue,) = vfplan.extract_curve(both, colour="#0000ff").strokes
    assert compare(red, curve).rms < 0.03
    assert blue.closed


@pytest.mark.parametrize("colour", ["lime", "blue", "magenta", "yellow", "cyan", "darkorange"])
def test_any_named_colour(colour):
    from matplotlib.colors import to_rgb

    _, curve = slice_with_curve(False)
    rgb = 255 * np.array(to_rgb(colour))
    image = to_uint8(blend(anatomy(SHAPE, 3), coverage(SHAPE, curve, 3), rgb))
    (stroke,) = vfplan.extract_curve(image, colour=colour).strokes
    assert compare(stroke, curve).rms < 0.03


@pytest.mark.parametrize("colour", ["grey", "white", "#808080", "no-such-colour", "#12"])
def test_a_colour_that_is_none_is_refused(colour):
    with pytest.raises(SettingError, match="colour"):
        vfplan.extract_curve(slice_with_curve(False)[0], colour=colour)


def with_gap(gap):
    curve = slice_with_curve(False)[1]
    arc = np.r_[0, np.cumsum(np.hypot(*np.diff(curve, axis=0).T))]
    hidden = np.flatnonzero(np.abs(arc - 0.4 * arc[-1]) < gap / 2)
    return pen(curve[: hidden[0]], curve[hidden[-1] + 1 :]), curve


@pytest.mark.parametrize("gap", [5, 10, 15, 20])
def test_short_pen_lifts_are_bridged_and_marked(gap):
    image, curve = with_gap(gap)
    (stroke,) = vfplan.extract_curve(image).strokes
    error = compare(stroke, curve)
    assert error.worst < 0.8
    assert 0 < stroke.bridged.sum() <= gap + 2
    if gap > 8:
        assert stroke.sigma_px[stroke.bridged].max() > 2 * np.median(stroke.sigma_px)


def test_long_pen_lifts_are_not_bridged_unless_allowed():
    image, _ = with_gap(35)
    with pytest.raises(CurveError, match="2 candidates"):
        vfplan.extract_curve(image)
    assert len(vfplan.extract_curve(image, max_gap_px=40).strokes) == 1
    image, _ = with_gap(10)
    with pytest.raises(CurveError, match="2 candidates"):
        vfplan.extract_curve(image, max_gap_px=2)


@pytest.mark.parametrize("angle", [0.0, 0.4, np.pi / 4, 1.2, 2.3])
def test_the_longest_lift_is_measured_between_the_inked_ends(angle):
    """Whatever way the line runs, and however much of its ends thinning takes."""
    way = np.array([np.cos(angle), np.sin(angle)])
    for gap, bridged in ((16, True), (19, True), (22, False)):
        near, far = (gap + 3) / 2, 120  # the 3 px pen's ends are round
        image = pen(
            *(np.array([[240.2], [200.3]]).T + k * np.outer([near, far], way) for k in (-1, 1))
        )
        if bridged:
            assert vfplan.extract_curve(image).strokes[0].bridged.any()
        else:
            with pytest.raises(CurveError, match="2 candidates"):
                vfplan.extract_curve(image)


def test_tangents_that_disagree_are_not_bridged():
    image = pen([[50, 200], [250, 200]], [[256, 206], [256, 380]])
    with pytest.raises(CurveError, match="2 candidates"):
        vfplan.extract_curve(image)


def test_a_ring_with_a_pen_lift_is_closed():
    ring = np.column_stack([240 + 100 * np.cos(T), 200 + 100 * np.sin(T)])
    (stroke,) = vfplan.extract_curve(pen(ring[5:-5])).strokes
    assert stroke.closed
    assert stroke.bridged.any()
    assert compare(stroke, ring, True).worst < 0.3


def test_a_dashed_line_is_one_curve():
    curve = slice_with_curve(False)[1]
    arc = np.r_[0, np.cumsum(np.hypot(*np.diff(curve, axis=0).T))]
    dashes = [curve[(arc >= a) & (arc < a + 14)] for a in np.arange(0, arc[-1] - 14, 22)]
    (stroke,) = vfplan.extract_curve(pen(*dashes)).strokes
    assert compare(stroke, curve[arc < arc[-1] - 20]).uncovered < 3


@pytest.mark.parametrize(
    ("name", "parts", "place"),
    [
        ("crossing", [[[60, 80], [300, 300]], [[300, 80], [60, 300]]], (180, 190)),
        ("fork", [[[60, 200], [400, 210]], [[230, 205], [240, 60]]], (230, 205)),
        ("lollipop", [np.column_stack([240 + 60 * np.cos(T), 150 + 60 * np.sin(T)]),
                      [[300, 150], [310, 350]]], (300, 150)),
    ],
)  # fmt: skip
def test_forks_and_crossings_are_refused_with_their_pixel(name, parts, place):
    with pytest.raises(CurveError, match="forks, touches or crosses") as caught:
        vfplan.extract_curve(pen(*map(polyline, parts)))
    u, v = (float(x) for x in caught.value.where[len("pixel (") : -1].split(","))
    assert np.hypot(u - place[0], v - place[1]) < 25


def test_a_figure_of_eight_is_refused():
    eight = np.column_stack([240 + 120 * np.sin(T), 200 + 80 * np.sin(2 * T)])
    with pytest.raises(CurveError, match="crosses itself"):
        vfplan.extract_curve(pen(eight, closed=True))


def test_two_lines_a_pixel_apart_are_refused():
    line = np.column_stack([np.linspace(50, 430, 300), 200 + 10 * np.sin(np.linspace(0, 6, 300))])
    with pytest.raises(CurveError, match="side by side"):
        vfplan.extract_curve(pen(line, line + np.array([0, 4])))
    with pytest.raises(CurveError, match="side by side") as caught:
        vfplan.extract_curve(pen(line, line + np.array([0, 4])), roi=(30, 150, 420, 120))
    place = np.array(re.findall(r"[0-9]+", caught.value.where), float)
    assert (
        np.abs(line + np.array([0, 2]) - place).sum(1).min() < 2
    )  # of the image, not of the region


@pytest.mark.parametrize("apart", [6, 8, 12])
def test_a_hairpin_is_followed_round_its_bend(apart):
    bend = np.linspace(0, np.pi, 50)
    turn = np.column_stack([300 + apart / 2 * np.sin(bend), 200 - apart / 2 * np.cos(bend)])
    curve = np.vstack([[[100, 200 - apart / 2]], turn, [[100, 200 + apart / 2]]])
    (stroke,) = vfplan.extract_curve(pen(curve)).strokes
    error = compare(stroke, curve)
    assert error.rms < 0.03
    assert error.uncovered < 2


def test_nothing_red_and_only_text():
    with pytest.raises(CurveError, match="no planned curve"):
        vfplan.extract_curve(to_uint8(flat(SHAPE)))
    image = to_uint8(flat(SHAPE))
    cv2.putText(image, "HELLO PLAN", (30, 90), cv2.FONT_HERSHEY_SIMPLEX, 1, RED, 2, cv2.LINE_AA)
    with pytest.raises(CurveError, match="set aside: text"):
        vfplan.extract_curve(image)


def noises(rng):
    """Pictures in which nobody drew: coloured noise of several kinds."""
    grey = np.repeat(rng.integers(60, 200, (*SHAPE, 1)), 3, axis=2)
    hit, red = rng.random((*SHAPE, 3)), rng.random(SHAPE) < 0.02
    yield rng.integers(0, 256, (*SHAPE, 3))
    yield 128 + 30 * rng.standard_normal((*SHAPE, 3))
    yield 128 + 60 * rng.standard_normal((*SHAPE, 3))
    yield np.where(hit < 0.05, 0, np.where(hit > 0.95, 255, grey))
    yield np.where(red[..., None], RED, grey)


@pytest.mark.parametrize("seed", [1, 2])
def test_noise_is_no_curve(seed):
    for picture in map(to_uint8, noises(np.random.default_rng(seed))):
        for image in (picture, jpeg(picture, 75)):
            with pytest.raises(CurveError, match="no planned curve"):
                vfplan.extract_curve(image, stroke="longest")


def test_a_picture_full_of_marks_is_refused_at_once(monkeypatch):
    image = to_uint8(flat((900, 900)))
    image[::12, :, :] = image[:, ::12, :] = 200
    for v in range(4, 890, 12):
        for u in range(4, 890, 12):
            image[v : v + 3, u : u + 3] = RED
    with pytest.raises(CurveError, match="marks in red"):
        vfplan.extract_curve(image)
    with monkeypatch.context() as patch:  # before any of them is looked at
        patch.setattr("vfplan.curve.marks.thin", None)
        with pytest.raises(CurveError, match="marks in red"):
            vfplan.extract_curve(image)


def test_a_curve_over_coloured_noise_is_found():
    picture, curve = anatomy(SHAPE, 3), slice_with_curve(False)[1]
    picture = blend(picture, coverage(SHAPE, curve, 3), RED)
    image = to_uint8(picture + 12 * np.random.default_rng(5).standard_normal((*SHAPE, 3)))
    (stroke,) = vfplan.extract_curve(image).strokes
    error = compare(stroke, curve)
    assert error.rms < 0.1
    assert error.uncovered < 2


def test_a_line_that_leaves_the_image_ends_at_its_border():
    image = pen([[-20, 100], [250, 190]])
    (stroke,) = vfplan.extract_curve(image).strokes
    assert -0.5 <= stroke.points_px.min() < 1


@pytest.mark.parametrize("width", [2, 4])
def test_a_line_that_touches_the_border_is_measured_by_what_is_seen(width):
    t = np.linspace(0, 1, 400)
    curve = np.column_stack([60 + 300 * t, 60 * (2 * t - 1) ** 2])
    (stroke,) = vfplan.extract_curve(pen(curve, width=width)).strokes
    error = compare(stroke, curve)
    assert error.rms < 0.05
    assert error.worst < 0.2
    assert error.uncovered < 2


def test_beside_a_pen_lift_in_a_bend_the_line_follows_the_ink():
    way = np.linspace(-1.4, 1.4, 800)
    bend = np.column_stack([240 + 24 * np.sin(way), 200 - 24 * np.cos(way)])
    legs = polyline([[150, 330], bend[0]]), polyline([bend[-1], [330, 330]])
    curve = np.vstack([legs[0], bend[1:-1], legs[1]])
    middle = len(curve) // 2
    lift = np.hypot(*(curve - curve[middle]).T) < 6
    image = pen(curve[: np.argmax(lift)], curve[len(lift) - np.argmax(lift[::-1]) :], width=2)
    (stroke,) = vfplan.extract_curve(image).strokes
    error = np.abs(normal_errors(stroke.points_px, curve, False))
    assert stroke.bridged.any()
    assert error[stroke.bridged].max() < 0.5
    assert error[~stroke.bridged][2:-2].max() < 0.2


def test_a_small_ring_is_a_curve_and_a_small_rectangle_a_frame():
    ring = np.column_stack([240.3 + 8 * np.cos(T), 200.1 + 8 * np.sin(T)])
    (stroke,) = vfplan.extract_curve(pen(ring, width=2, closed=True)).strokes
    assert stroke.closed
    image = to_uint8(flat(SHAPE))
    cv2.rectangle(image, (200, 200), (216, 214), RED, 2)
    with pytest.raises(CurveError, match="set aside: frame"):
        vfplan.extract_curve(image)


def test_a_marker_over_the_line_is_bridged():
    image, curve = slice_with_curve(False)
    image = image.copy()
    for k in (1000, 2500):
        place = tuple(int(x) for x in np.rint(curve[k]))
        cv2.drawMarker(image, place, (0, 220, 255), cv2.MARKER_CROSS, 14, 1)
    (stroke,) = vfplan.extract_curve(image).strokes
    assert stroke.bridged.any()
    error = compare(stroke, curve)
    assert error.rms < 0.06
    assert error.worst < 0.8


@pytest.mark.parametrize(
    "wrong",
    [
        {"method": "guess"}, {"stroke": 0}, {"stroke": "some"}, {"max_gap_px": -1.0},
        {"max_gap_px": float("nan")}, {"roi": (0, 0, 9999, 5)}, {"roi": (-1, 0, 5, 5)},
        {"roi": (0, 0, 0, 5)},
    ],
    ids=str,
)  # fmt: skip
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(SettingError):
        vfplan.extract_curve(slice_with_curve(False)[0], **wrong)


@pytest.mark.parametrize(
    ("shape", "kind"), [((5, 5), "f8"), ((5, 5, 4), "u1"), ((0, 3, 3), "u1"), ((5, 5, 3), "f4")]
)
def test_arrays_of_another_kind_are_refused(shape, kind):
    with pytest.raises(ImageError, match="red first"):
        vfplan.extract_curve(np.zeros(shape, kind))


def test_methods_by_name():
    image, curve = slice_with_curve(False)
    ridge, skeleton, mask = (
        vfplan.extract_curve(image, method=m) for m in ("ridge", "skeleton", "mask")
    )
    assert len(mask.strokes[0].points_px) == np.count_nonzero(mask.mask)
    assert np.array_equal(mask.mask, ridge.mask)
    assert compare(ridge.strokes[0], curve).rms < 0.03
    assert 0.2 < compare(skeleton.strokes[0], curve).rms < 0.6


def line_at(v, start, stop):
    return polyline([[start, v], [stop, v]])


@pytest.mark.parametrize(("width", "stub"), [(2.2, 4), (3, 2), (3, 4), (5, 2), (5, 6)])
def test_a_last_bit_beyond_a_pen_lift_is_told(width, stub):
    image = pen(line_at(200.2, 60, 300), line_at(200.2, 315, 315 + stub), width=width)
    extraction = vfplan.extract_curve(image)
    (warning,) = extraction.warnings
    assert f"px at ({315 + stub / 2:.0f}, 200) lies" in warning
    gap = float(warning.split(" lies about ")[1].split()[0])
    assert gap == pytest.approx(15 - width, abs=3)
    (mark,) = extraction.set_aside
    assert mark["kind"] == "speck"
    assert abs(mark["box"][0] + mark["box"][2] / 2 - (315 + stub / 2)) < 2


def test_specks_elsewhere_are_not_warned_of():
    dots = [line_at(v, u, u + 3) for u, v in ((362, 200), (150, 215), (300, 216))]
    extraction = vfplan.extract_curve(pen(line_at(200, 60, 300), *dots))
    assert not extraction.warnings
    assert not extraction.set_aside
    thin = pen(line_at(200, 60, 300), width=6)
    thin[199:201, 312:318] = RED
    assert not vfplan.extract_curve(thin).warnings


def test_two_specks_ahead_of_a_thick_pens_end_are_told():
    image = pen(line_at(200, 60, 300), width=8)
    image[197:200, 309:312] = image[201:204, 316:319] = RED
    (warning,) = vfplan.extract_curve(image).warnings
    assert "among 2 specks" in warning


@pytest.mark.parametrize("method", ["ridge", "skeleton", "mask"])
def test_a_region_that_cuts_the_curve_is_warned_of(method):
    image = pen([[-20, 100], [250, 190]])
    whole = vfplan.extract_curve(image, method=method, roi=(0, 50, 300, 200))
    assert not whole.warnings
    cut = vfplan.extract_curve(image, method=method, roi=(0, 50, 200, 200))
    (warning,) = cut.warnings
    u, v = (float(x) for x in warning.split("(")[1].split(")")[0].split(","))
    assert np.hypot(u - 200, v - 173) < 5
    assert "border of the region 0,50,200,200" in warning
    twice = vfplan.extract_curve(image, method=method, roi=(60, 50, 140, 200))
    assert len(twice.warnings) == 2


def test_a_curve_that_is_nearly_closed_is_warned_of():
    ring = np.column_stack([240 + 100 * np.cos(T), 200 + 100 * np.sin(T)])
    extraction = vfplan.extract_curve(pen(ring[17:-17]))
    assert not extraction.strokes[0].closed
    (warning,) = extraction.warnings
    missing = float(warning.split(": ")[1].split()[0])
    assert missing == pytest.approx(np.hypot(*(ring[17] - ring[-18])) - 3, abs=3)
    assert not vfplan.extract_curve(pen(ring[60:-60])).warnings
    side_by_side = pen([[100, 180], [300, 180], [340, 200], [300, 220], [100, 220]])
    assert not any("closed" in w for w in vfplan.extract_curve(side_by_side).warnings)


def test_a_ring_that_fades_over_bright_bone_is_not_opened_in_silence():
    """Half opaque, blended in linear light: over white less than half of the mark's strength."""
    ring = np.column_stack([240 + 120 * np.cos(T), 200 + 120 * np.sin(T)])
    ground = flat(SHAPE, 40.0)
    cv2.circle(ground, (360, 200), 28, (250, 250, 250), -1)
    share = coverage(SHAPE, ring, 3, True)
    extraction = vfplan.extract_curve(to_uint8(blend(ground, share, RED, 0.5, 2.2)))
    (stroke,) = extraction.strokes
    assert stroke.closed or any("nearly closed" in w for w in extraction.warnings)


def ring_by_hand(drift):
    """Drawn 6 % past its beginning, beside it."""
    turn = np.linspace(0, 2 * np.pi * 1.06, 2000)
    axes = np.array([130, 100]) + drift * turn[:, None] / (2 * np.pi)
    return [240, 200] + axes * np.column_stack([np.cos(turn), np.sin(turn)])


@pytest.mark.parametrize(
    ("width", "drift", "quality"),
    [(2, 1, None), (3, 2, None), (5, 2, None), (3, 3, 75), (5, 4, 75)],
)
def test_a_line_that_runs_beside_itself_is_refused_with_its_pixel(width, drift, quality):
    image = pen(ring_by_hand(drift), width=width)
    with pytest.raises(CurveError, match="touches itself") as caught:
        vfplan.extract_curve(jpeg(image, quality) if quality else image)
    place = np.array(caught.value.where[len("pixel (") : -1].split(","), float)
    overlap = ring_by_hand(drift)[-120:]
    assert np.hypot(*(overlap - place).T).min() < 8


def test_a_line_that_may_run_beside_itself_is_warned_of():
    (warning,) = vfplan.extract_curve(pen(ring_by_hand(1), width=5)).warnings
    assert "as wide as elsewhere" in warning


def test_one_line_is_never_taken_for_two_runs():
    """Corners, tight bends, strength that changes, bright edges, JPEG."""
    corner = [[60, 200], [180, 200], [240, 96]]
    way = np.linspace(-np.pi / 2, np.pi / 2, 60)
    bend = [200, 190] + 4 * np.column_stack([np.cos(way), np.sin(way)])
    pin = np.vstack([[[80, 126], [150, 186]], bend, [[150, 194], [80, 254]]])
    fading = np.where(np.arange(SHAPE[1]) < 180, 1.0, 0.55)
    for curve in (corner, pin, wavy(SHAPE, 3)):
        share = coverage(SHAPE, polyline(curve), 3)
        for opacity, gamma in ((1, 1), (0.6, 2.2), (fading, 1)):
            image = to_uint8(blend(anatomy(SHAPE, 1), share * opacity, RED, 1, gamma))
            for picture in (image, jpeg(image, 75)):
                extraction = vfplan.extract_curve(picture, stroke="longest")
                assert not any("as wide" in w for w in extraction.warnings)


def test_a_line_that_fades_in_linear_light_is_looked_at_whole():
    """Part of its thinned path lies outside the box of its mask."""
    shape = (380, 430)
    half = np.where(np.arange(shape[1]) < shape[1] // 2, 1.0, 0.55)
    share = coverage(shape, wavy(shape, 3), 5) * half
    image = to_uint8(blend(anatomy(shape, 3), share, RED, 1, 2.2))
    assert vfplan.extract_curve(image, stroke="longest").strokes
