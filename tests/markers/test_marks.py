"""Marker positions against the marks on the slice: misreadings are refused or found."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from conftest import ROOT
from drawing import jpeg
from refusals import refuses

from vfplan import read_image
from vfplan.errors import CheckFailed
from vfplan.markers.check_marks import compare_with_marks, drawn_marks
from vfplan.markers.correspondences import read_markers

SAMPLES = ROOT / "samples"
WIDTH, HEIGHT = 700, 600
PLACES = np.array(
    [[90.0, 80], [340, 60], [610, 95], [70, 300], [330, 280], [640, 330], [100, 520], [620, 540]]
)
COLOURS = {"cyan": (0, 220, 255), "green": (40, 230, 60), "white": (255, 255, 255)}


def compare(image, places, **settings):
    labels = [f"x{k + 1}" for k in range(len(places))]
    return compare_with_marks(image, labels, places, **settings)


def codes(comparison):
    return [finding.code for finding in comparison[1]]


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
    "multiplied by 0.8": lambda p: p * 0.8,
    "multiplied by 1.1": lambda p: p * 1.1,
    "multiplied by 2": lambda p: p * 2.0,
    "shifted by 50 px": lambda p: p + np.array([50, -50]),
}


@pytest.mark.parametrize("how", MISREAD)
@pytest.mark.parametrize(
    "colour, shape", [("cyan", "cross"), ("green", "dot"), ("cyan", "ring"), ("white", "cross")]
)
def test_a_misreading_is_refused(how, colour, shape):
    image = drawn(1, colour, shape, contrast=5 if colour == "white" else 18)
    with refuses(CheckFailed, "markers-meet-no-marks", drawn=len(PLACES)) as caught:
        compare(image, MISREAD[how](PLACES))
    assert caught.value.numbers["near"] < len(PLACES) / 2
    found = compare(image, MISREAD[how](PLACES), markers_as_given=True)
    assert codes(found) == ["markers-meet-no-marks"]


@pytest.mark.parametrize("shift", [1.0, 3.0, 5.0])
def test_a_small_shift_is_a_finding(shift):
    found = compare(drawn(3, "cyan", "cross"), PLACES + shift)
    assert codes(found) == ["markers-off-marks"]
    np.testing.assert_allclose(found[0]["shift_px"], shift, atol=0.4)


def test_one_wrong_position_is_named_with_its_place():
    offset = np.zeros_like(PLACES)
    offset[4] = [4, -3]
    (finding,) = compare(drawn(4, "cyan", "cross"), PLACES + offset)[1]
    assert (finding.code, finding.place_px) == ("marker-off-mark", (334.0, 277.0))
    assert "x5" in finding.text


@pytest.mark.parametrize("quality", [50, 60, 70, 80, 90])
def test_marks_that_compression_blurs_are_marks(quality):
    """JPEG halves the resolution of colour, so marks of one kind differ in size there."""
    image = jpeg(cv2.imread(str(SAMPLES / "elbow.png"))[..., ::-1], quality)
    marked = read_markers(SAMPLES / "elbow_markers_image.csv", SAMPLES / "elbow_markers_robot.csv")
    found = compare_with_marks(image, marked.labels, marked.source)
    assert (found[0]["near"], codes(found)) == (9, [])
    if quality < 60:
        return  # Fewer than half of the marks are of one size, so a moved marker is not told.
    for k in range(9):
        places = marked.source.copy()
        places[k] += (6, -8)
        [finding] = compare_with_marks(image, marked.labels, places)[1]
        assert (finding.code, finding.place_px) == ("marker-not-drawn", tuple(places[k]))


def test_a_thin_mark_that_compression_blurs_is_known_by_its_shape():
    image = texture(7)
    for place in PLACES.astype(int).tolist():
        cv2.drawMarker(image, place, (255, 0, 255), cv2.MARKER_CROSS, 13, 1, cv2.LINE_AA)
    found = compare(jpeg(image, 60), PLACES)
    assert (found[0]["near"], codes(found)) == (len(PLACES), [])


@pytest.mark.parametrize("noise_px", [0.0, 0.5, 1.0])
def test_what_a_hand_clicks_is_no_misreading(noise_px):
    rng = np.random.default_rng(9)
    for seed in range(4):
        image = drawn(seed, ("cyan", "green")[seed % 2], ("cross", "dot")[seed // 2])
        found = compare(image, PLACES + 0.25 + rng.normal(0, noise_px, PLACES.shape))
        assert (found[0]["near"], codes(found)) == (len(PLACES), [])


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
        assert codes(compare(image, rng.uniform(40, 560, (n, 2)))) == ["no-marks-drawn"]


def test_labels_beside_markers_that_no_ink_shows_refuse_nothing():
    """Balls in the CT, each with its label beside it: all labels begin with an x."""
    image = texture(10, contrast=5)
    for k, (u, v) in enumerate(PLACES.astype(int).tolist()):
        at = (u + 20, v)
        cv2.putText(image, f"x{k}", at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 0, 255), 1, 16)
    assert codes(compare(image, PLACES)) == ["no-marks-drawn"]


def test_a_slice_without_a_mark_refuses_nothing():
    for image in (texture(0), np.zeros((50, 60, 3), np.uint8), np.zeros((50, 60, 3), np.uint16)):
        found = compare(image, np.array([[10.0, 10], [30, 12], [22, 41]]))
        assert codes(found) == ["no-marks-drawn"]


def test_a_colour_picture_is_no_slice_with_marks():
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    assert not any(kind.are_stamped for kind in drawn_marks(noise))


@pytest.mark.parametrize("name", ["pelvis_a.png", "pelvis_b_q80.jpg", "pelvis_c.png"])
def test_planned_slices(shared_data, name):
    folder = shared_data / "planned"
    stem = name.split(".")[0].removesuffix("_q80")
    rgb = read_image(folder / name).rgb
    for other in ("pelvis_a", "pelvis_b", "pelvis_c"):
        markers = read_markers(*(folder / f"{other}_markers_{s}.csv" for s in ("image", "robot")))
        if other != stem:
            with refuses(CheckFailed, "markers-meet-no-marks"):
                compare(rgb, markers.source)
            continue
        found = compare(rgb, markers.source)
        assert (found[0]["near"], found[0]["drawn"], codes(found)) == (9, 9, [])
        assert found[0]["rms_px"] < 0.6


def test_plan_compares_without_an_option(vfplan_cli, tmp_path):
    wrong, robot, out = tmp_path / "u.csv", SAMPLES / "elbow_markers_robot.csv", tmp_path / "f.h5"
    head, *rows = (SAMPLES / "elbow_markers_image.csv").read_text().split()
    flipped = [f"{label},{u},{785 - float(v)}" for label, u, v in (row.split(",") for row in rows)]
    wrong.write_text("\n".join([head, *flipped]))
    common = ("plan", SAMPLES / "elbow.png", wrong, robot, "-o", out, "--json")
    run = vfplan_cli(*common)
    assert (run.code, run.json["error"]["code"]) == (1, "markers-meet-no-marks")
    assert not out.exists()
    run = vfplan_cli(*common, "--markers-as-given").sound
    found = {finding["code"] for finding in run.json["findings"]}
    assert {"markers-meet-no-marks", "faces-down"} <= found


@pytest.mark.parametrize("label, shift, size", [("3", (6, 3), 0.4), ("M3", (2, 10), 0.35)])
def test_a_label_that_touches_a_mark_does_not_move_it(label, shift, size):
    image = drawn(1, "cyan", "cross")
    foot = (PLACES[3] + shift).astype(int).tolist()
    cv2.putText(image, label, foot, cv2.FONT_HERSHEY_SIMPLEX, size, COLOURS["cyan"], 1)
    assert codes(compare(image, PLACES)) == []
