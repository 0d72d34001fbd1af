"""Markers' pixels against the marks on the slice: every misreading is said, no good one is."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
from conftest import ROOT

from vfplan.errors import MarkerError
from vfplan.images.read import read_image
from vfplan.markers import Correspondences, read_markers
from vfplan.planning.readings import hold_against_marks

SAMPLES = ROOT / "samples"
WIDTH, HEIGHT = 700, 600
PLACES = np.array(
    [[90.0, 80], [340, 60], [610, 95], [70, 300], [330, 280], [640, 330], [100, 520], [620, 540]]
)
COLOURS = {"cyan": (0, 220, 255), "green": (40, 230, 60), "white": (255, 255, 255)}


def pairs(places):
    labels = tuple(f"x{k + 1}" for k in range(len(places)))
    return Correspondences(labels, np.asarray(places, float), "image", np.zeros((len(places), 3)))


def texture(seed, contrast=18):
    """Smooth grey with the grain and the bright shapes of a CT slice."""
    rng = np.random.default_rng(seed)
    fine, coarse = (cv2.GaussianBlur(rng.normal(0, 1, (HEIGHT, WIDTH)), (0, 0), s) for s in (1, 9))
    grey = 95 + contrast * (fine / fine.std() + coarse / coarse.std())
    for _ in range(12):
        centre = tuple(int(x) for x in rng.uniform(50, 550, 2))
        axes = tuple(int(x) for x in rng.uniform(3, 60, 2))
        cv2.ellipse(grey, centre, axes, float(rng.uniform(0, 180)), 0, 360, 230.0, -1, cv2.LINE_AA)
    return np.repeat(np.clip(grey, 0, 240).astype(np.uint8)[..., None], 3, axis=2)


def drawn(seed, colour, shape, contrast=18):
    image = texture(seed, contrast)
    for u, v in PLACES.astype(int).tolist():
        if shape == "cross":
            cv2.line(image, (u - 6, v), (u + 6, v), COLOURS[colour], 2)
            cv2.line(image, (u, v - 6), (u, v + 6), COLOURS[colour], 2)
        elif shape == "dot":
            cv2.circle(image, (u, v), 4, COLOURS[colour], -1, cv2.LINE_AA)
        else:
            cv2.circle(image, (u, v), 7, COLOURS[colour], 2, cv2.LINE_AA)
    cv2.putText(image, "x1 cm", (20, 590), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 0), 1)
    return image


MISREAD = {
    "v counted from below": lambda p: np.c_[p[:, 0], HEIGHT - 1 - p[:, 1]],
    "u counted from the right": lambda p: np.c_[WIDTH - 1 - p[:, 0], p[:, 1]],
    "row and column exchanged": lambda p: p[:, ::-1],
    "multiplied by 1.25": lambda p: p * 0.8,
    "multiplied by 0.5": lambda p: p * 2.0,
}


@pytest.mark.parametrize("how", MISREAD)
@pytest.mark.parametrize(("colour", "shape"), [("cyan", "cross"), ("green", "dot")])
def test_a_misreading_is_refused_by_its_name(how, colour, shape):
    with pytest.raises(MarkerError, match=how):
        hold_against_marks(drawn(1, colour, shape), pairs(MISREAD[how](PLACES)))


def test_white_marks_are_held_against_too():
    image = drawn(2, "white", "cross", contrast=5)
    assert hold_against_marks(image, pairs(PLACES)).near == len(PLACES)
    with pytest.raises(MarkerError, match="v counted from below"):
        hold_against_marks(image, pairs(MISREAD["v counted from below"](PLACES)))


def test_from_one_is_warned_of_and_a_shift_refused():
    image = drawn(3, "cyan", "cross")
    (said,) = hold_against_marks(image, pairs(PLACES + 1)).warnings
    assert "counted from 1" in said
    with pytest.raises(MarkerError, match=r"are moved by \(-60, \+40\) px they meet"):
        hold_against_marks(image, pairs(PLACES + np.array([60, -40])))


@pytest.mark.parametrize("scale", [1.02, 0.98, 1.01, 1.005])
def test_a_scale_of_a_hundredth_is_refused_as_one(scale):
    with pytest.raises(MarkerError, match=f"are multiplied by {1 / scale:.3g} they"):
        hold_against_marks(drawn(1, "cyan", "cross"), pairs(scale * PLACES))


@pytest.mark.parametrize("shift", [(30, -15), (9, 9)])
@pytest.mark.parametrize("shape", ["cross", "dot", "ring"])
def test_a_shift_further_than_a_click_is_refused(shape, shift):
    there = f"are moved by ({-shift[0]:+d}, {-shift[1]:+d}) px they"
    with pytest.raises(MarkerError, match=re.escape(there)):
        hold_against_marks(drawn(4, "cyan", shape), pairs(PLACES + np.array(shift)))


@pytest.mark.parametrize("texts", ["123456789", "ABDEFGHKL", "x123456789"])
def test_a_shift_to_labels_is_no_refusal(texts):
    """Markers that no ink shows, as balls in the CT, each with its label beside it."""
    image = texture(10, contrast=5)
    for k, (u, v) in enumerate(PLACES.astype(int).tolist()):
        if texts[0] == "x":
            cv2.putText(image, "x", (u + 10, v), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 0, 255), 1)
        text = texts[-9:][k]
        at = (u + 20, v)
        cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 0, 255), 1, 16)
    held = hold_against_marks(image, pairs(PLACES))
    assert all("they meet marks of one kind" in said for said in held.warnings)


@pytest.mark.parametrize("count", [4, 6])
def test_few_clicks_of_half_a_pixel_tell_where_pixels_are_counted_from(count):
    """An exactly drawn mark, its centre known; of 40 sets from 0 and 40 from 1."""
    right, said = [], []
    image = drawn(5, "green", "dot")
    rng = np.random.default_rng(count)
    for _ in range(20):
        given = PLACES[:count] + rng.normal(0, 0.4, (count, 2))
        right.append(hold_against_marks(image, pairs(given)).warnings)
        said.append("from 1" in " ".join(hold_against_marks(image, pairs(given + 1)).warnings))
    assert sum(map(bool, right)) <= 1
    assert sum(said) >= (18 if count == 6 else 15)


def test_every_reading_that_meets_the_marks_is_named():
    """Marks symmetric from left to right, not from top to bottom: two readings meet them."""
    image = texture(6)
    ring = np.array([[99.5, 80], [599.5, 80], [349.5, 150], [219.5, 250], [479.5, 250]])
    for u, v in ring:
        at = (int(16 * u), int(16 * v))
        cv2.circle(image, at, 64, COLOURS["cyan"], -1, cv2.LINE_AA, 4)
    given = np.c_[ring[:, 0], HEIGHT - 1 - ring[:, 1]]
    with pytest.raises(MarkerError, match=r"from below, or with u .* and v from below th"):
        hold_against_marks(image, pairs(given))


def test_one_wrong_position_is_named():
    away = np.zeros_like(PLACES)
    away[4] = [4, -3]
    held = hold_against_marks(drawn(4, "cyan", "cross"), pairs(PLACES + away))
    (said,) = held.warnings
    assert "marker x5 is given 5.0 px" in said


@pytest.mark.parametrize("noise_px", [0.0, 0.5, 1.0, 2.0])
def test_what_a_hand_clicks_is_no_misreading(noise_px):
    rng = np.random.default_rng(9)
    for seed in range(4):
        image = drawn(seed, ("cyan", "green")[seed % 2], ("cross", "dot")[seed // 2])
        given = PLACES + 0.25 + rng.normal(0, noise_px, PLACES.shape)
        held = hold_against_marks(image, pairs(given))
        assert held.near >= len(PLACES) - 1
        assert held.warnings == ()


@pytest.mark.parametrize("seed", range(4))
def test_textures_letters_and_rulers_are_no_marks(seed):
    rng, image = np.random.default_rng(seed), texture(seed, contrast=25)
    for k in range(8):
        at = tuple(int(x) for x in rng.uniform(30, 550, 2))
        text = ("L", "10 cm", "R1", "kV 120", "AXIAL", "xyz", "+o+", "0.6mm")[k]
        colour = ((255, 255, 0), (255, 255, 255), (0, 255, 255))[seed % 3]
        cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)
    for v in range(100, 500, 20):
        cv2.line(image, (680, v), (690 if v % 100 else 697, v), (255, 255, 0), 1)
    for n in (4, 7, 9):
        given = rng.uniform(40, 560, (n, 2))
        held = hold_against_marks(image, pairs(given))
        assert held.near <= 2
        assert held.warnings == ()


@pytest.mark.parametrize("name", ["pelvis_a.png", "pelvis_b_q80.jpg", "pelvis_c.png"])
def test_planned_slices(shared_data, name):
    stem = name.split(".")[0].removesuffix("_q80")
    files = [shared_data / "planned" / f"{stem}_markers_{side}.csv" for side in ("image", "robot")]
    markers = read_markers(*files)
    rgb = read_image(shared_data / "planned" / name).rgb
    noise = np.random.default_rng(3).normal(0, 1, markers.source.shape)
    for source in (markers.source, markers.source + noise):
        held = hold_against_marks(rgb, pairs(source))
        assert held.near == len(source)
        assert held.warnings == ()
    (said,) = hold_against_marks(rgb, pairs(markers.source + 0.5)).warnings
    assert "counted from the first pixel's corner" in said
    with pytest.raises(MarkerError, match="v counted from below"):
        hold_against_marks(rgb, pairs(np.c_[markers.source[:, 0], 785 - markers.source[:, 1]]))


def test_plan_holds_them_without_being_asked(vfplan_cli, tmp_path):
    head, *rows = (SAMPLES / "elbow_markers_image.csv").read_text().split()
    read = [(label, float(u), float(v)) for label, u, v in (row.split(",") for row in rows)]
    wrong = tmp_path / "below.csv"
    wrong.write_text("\n".join([head, *(f"{label},{u},{785 - v}" for label, u, v in read)]))
    robot, out = SAMPLES / "elbow_markers_robot.csv", tmp_path / "f.h5"
    run = vfplan_cli("plan", SAMPLES / "elbow.png", wrong, robot, "-o", out)
    assert run.code == 3
    assert "v counted from below" in run.error_line
    assert not out.exists()
    good = vfplan_cli(
        *("plan", SAMPLES / "elbow.png", SAMPLES / "elbow_markers_image.csv", robot),
        *("-o", out, "--json"),
    )
    marks = good.json["register"]["marks_drawn"]
    assert marks["near"] == 9
    assert marks["rms_px"] < 0.3


def test_few_positions_near_marks_of_which_as_many_are_drawn():
    away = [[-33, 21], [40, 35], [-28, 47], [51, -38], [24, -44], [-46, -29]]
    places = np.r_[PLACES[:2], PLACES[2:] + away]
    held = hold_against_marks(drawn(3, "cyan", "cross"), pairs(places))
    assert held.near == 2
    assert held.warnings[0].startswith("2 of the 8 given positions have a mark near them, but 8")


GRID = np.stack(np.meshgrid([100.0, 349.5, 599], [90.0, 299.5, 509]), -1).reshape(-1, 2)


def dotted(places):
    image = texture(7)
    for u, v in places:
        at = (round(16 * u), round(16 * v))
        cv2.circle(image, at, 64, COLOURS["cyan"], -1, cv2.LINE_AA, 4)
    return image


@pytest.mark.parametrize("how", [*MISREAD][:2])
def test_a_misreading_onto_other_markers_marks_is_refused(how):
    """A grid by hand: read wrongly, more than half of it still lies at marks, of others."""
    hand = GRID + np.random.default_rng(2).uniform(-3, 3, GRID.shape)
    image = dotted(hand)
    for noise in np.random.default_rng(3).normal(0, 0.5, (5, *GRID.shape)):
        held = hold_against_marks(image, pairs(hand + noise))
        assert (held.near, held.warnings, held.rivals) == (9, (), ())
        with pytest.raises(MarkerError, match=r"[5-9] of the 9 .*" + how):
            hold_against_marks(image, pairs(MISREAD[how](hand + noise)))


def test_a_slice_that_cannot_tell_two_readings_says_so():
    (said,) = hold_against_marks(dotted(GRID), pairs(GRID)).rivals
    assert "with v counted from below, or with u counted from the right, or" in said
    assert "cannot tell" in said


def test_many_without_a_mark_are_named():
    (said,) = hold_against_marks(dotted(GRID[:5]), pairs(GRID)).warnings
    assert "within 8 px of x6, x7, x8, x9, though" in said


def test_a_shift_beside_as_many_other_marks_is_warned_of():
    """Letters, as many again: that all meet a mark is no chance."""
    image = texture(8, contrast=5)
    for u, v in [*PLACES, *np.random.default_rng(1).uniform(40, 560, (10, 2))]:
        at = (int(u), int(v))
        cv2.putText(image, "S", at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, COLOURS["cyan"], 2)
    (said,) = hold_against_marks(image, pairs(PLACES + np.array([30, -20]))).warnings
    assert "where they are moved by (-26, +14) px they meet marks of one kind" in said


@pytest.mark.parametrize("how", [*MISREAD][:3])
@pytest.mark.parametrize("kind", ["rings", "thin white crosses", "rings that touch their labels"])
def test_marks_of_any_shape_are_held_against(kind, how):
    image = texture(9, contrast=6)
    for k, (u, v) in enumerate(PLACES.astype(int).tolist()):
        if kind == "thin white crosses":  # between two columns, or rows, of pixels
            image[v - 6 : v + 7, u : u + 2] = image[v : v + 2, u - 6 : u + 7] = 180
            continue
        cv2.circle(image, (u, v), 8, (60, 120, 255), 2, cv2.LINE_AA)
        if kind != "rings" and k % 3:
            at = (u + 9, v - 5)
            cv2.putText(image, f"x{k}", at, cv2.FONT_HERSHEY_SIMPLEX, 0.4, (60, 120, 255), 1, 16)
    held = hold_against_marks(image, pairs(PLACES))
    assert held.near >= 6
    assert held.warnings == ()
    with pytest.raises(MarkerError, match=how):
        hold_against_marks(image, pairs(MISREAD[how](PLACES)))


def test_a_shift_of_all_is_not_called_counted_from_one():
    (said,) = hold_against_marks(drawn(3, "cyan", "cross"), pairs(PLACES + 5)).warnings
    assert "lie (+5.0" in said
    assert "counted" not in said


@pytest.mark.parametrize("how", ["multiplied", "moved", "digits"])
def test_three_markers_beside_their_marks_and_others_are_never_silent(how):
    """Three positions leave too little to tell how they were misread, so only that they were."""
    image, own = drawn(3, "cyan", "cross"), PLACES[[0, 3, 5]]
    given = {
        "multiplied": own * 0.7,
        "moved": own + np.array([31, 22]),
        "digits": own + np.array([[0, 0], [90, 0], [0, -54]]),
    }[how]
    warned = hold_against_marks(image, pairs(given)).warnings
    assert (
        "of the 3 given positions have a mark near them, but 8 of one kind are drawn" in warned[0]
    )


def test_a_shift_among_more_marks_of_one_shape_is_refused():
    image = drawn(4, "green", "ring")
    with pytest.raises(MarkerError, match=r"moved by \(-60, \+45\) px"):
        hold_against_marks(image, pairs(PLACES[:5] + np.array([60, -45])))


def test_one_marker_that_is_not_drawn_hides_no_misreading():
    image, own = drawn(4, "cyan", "dot"), np.vstack([PLACES, [480, 190]])
    with pytest.raises(MarkerError, match=r"moved by \(-30, \+22\) px"):
        hold_against_marks(image, pairs(own + np.array([30, -22])))
    elsewhere = np.random.default_rng(4).uniform(0, [WIDTH, HEIGHT], own.shape)
    assert "but 8 of one kind are drawn" in hold_against_marks(image, pairs(elsewhere)).warnings[0]


@pytest.mark.parametrize("undrawn", [(), (2, 5)])
def test_marks_that_are_letters_of_any_width(undrawn):
    image = texture(8)
    for k, (u, v) in enumerate(PLACES.astype(int).tolist()):
        (width, height), _ = cv2.getTextSize("ABCDEFGI"[k], cv2.FONT_HERSHEY_SIMPLEX, 0.7, 2)
        if k not in undrawn:
            at = (u - width // 2, v + height // 2)
            font = cv2.FONT_HERSHEY_SIMPLEX
            cv2.putText(image, "ABCDEFGI"[k], at, font, 0.7, COLOURS["green"], 2, cv2.LINE_AA)
    said = [w for w in hold_against_marks(image, pairs(PLACES)).warnings if w.startswith("no mark")]
    assert [re.findall(r"x\d", one) for one in said] == ([["x3", "x6"]] if undrawn else [])
    with pytest.raises(MarkerError, match=r"multiplied by 1\.25"):
        hold_against_marks(image, pairs(0.8 * PLACES))


@pytest.mark.filterwarnings("error")
def test_markers_given_at_one_place_are_held_against_marks_as_well():
    image = texture(8)
    for u, v in PLACES.astype(int).tolist():
        cv2.circle(image, (u, v), 5, COLOURS["green"], -1)
    given = 0.7 * PLACES[[0, 1, 2, 3, 3, 3, 3, 3]]
    with pytest.raises(MarkerError, match=r"multiplied by 1\.43"):
        hold_against_marks(image, pairs(given))
