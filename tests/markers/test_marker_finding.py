"""Markers drawn with a known centre are found again, to a fraction of a pixel."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from refusals import refuses

from vfplan import read_image
from vfplan.errors import MarkerError
from vfplan.markers.find_marks import Mark, find_markers, fit_mark

FINE = 16  # samples a pixel of the drawings below: their edges are exact to 1/32 px


def canvas():
    """A grey slice with a gradient and noise."""
    rng = np.random.default_rng(1)
    v, u = np.indices((80, 80))
    grey = 90 + 0.8 * u + 0.3 * v + rng.normal(0, 1.5, (80, 80))
    return np.repeat(grey[..., None], 3, axis=2)


def draw(image, covered, colour):
    """Lay `colour` over the image by the exact coverage of `covered(u, v)`."""
    size = image.shape[0]
    axis = (np.arange(size * FINE) + 0.5) / FINE - 0.5
    u, v = np.meshgrid(axis, axis)
    alpha = covered(u, v).reshape(size, FINE, size, FINE).mean(axis=(1, 3))[..., None]
    return image * (1 - alpha) + alpha * np.array(colour, dtype=float)


def cross(u0, v0, arm=7.0, half=0.8125, angle=0.0):
    def covered(u, v):
        x = np.cos(angle) * (u - u0) + np.sin(angle) * (v - v0)
        y = np.cos(angle) * (v - v0) - np.sin(angle) * (u - u0)
        return ((abs(x) < arm) & (abs(y) < half)) | ((abs(y) < arm) & (abs(x) < half))

    return covered


def dot(u0, v0, radius=3.0):
    return lambda u, v: np.hypot(u - u0, v - v0) < radius


def found(image, at):
    return find_markers(np.clip(np.round(image), 0, 255).astype(np.uint8), ["x1"], [at])[0]


CYAN, RED, YELLOW = (0, 220, 255), (230, 20, 30), (255, 255, 0)
WHITE, BLACK = (255, 255, 255), (0, 0, 0)


@pytest.mark.parametrize("centre", [(40.3125, 39.75), (39.5, 40.5)])
@pytest.mark.parametrize("colour", [CYAN, RED, YELLOW, WHITE, BLACK])
@pytest.mark.parametrize(
    "shape, make",
    [
        ("cross", cross), ("cross", lambda u, v: cross(u, v, arm=9, half=1.5)),
        ("cross", lambda u, v: cross(u, v, angle=np.pi / 4)),
        ("dot", dot), ("dot", lambda u, v: dot(u, v, 5.2)),
    ],
)  # fmt: skip
def test_drawn_markers_are_found_to_a_twentieth_of_a_pixel(centre, colour, shape, make):
    image = draw(canvas(), make(*centre), colour)
    marker = found(image, (centre[0] + 2.5, centre[1] - 3))
    assert np.hypot(*np.subtract(marker.position_px, centre)) < 0.05
    assert marker.shape == shape
    assert marker.moved_px == pytest.approx(np.hypot(2.5, 3), abs=0.1)


def test_sixteen_bits_and_a_neighbour_in_another_colour():
    image = draw(canvas(), cross(40.3, 40.2), CYAN)
    image = draw(image, cross(52, 30, arm=4, angle=np.pi / 4), YELLOW)  # a label's x
    rgb = np.clip(np.round(image), 0, 255).astype(np.uint16) * 257
    marker = find_markers(rgb, ["x1"], [(43, 38)])[0]
    assert np.hypot(*np.subtract(marker.position_px, (40.3, 40.2))) < 0.05


def test_rounded_ends_do_not_move_a_cross():
    def covered(u, v):
        level = (abs(v - 40.13) < 0.8) & (u > 32.5) & (u < 47.5)
        return level | ((abs(u - 40.41) < 0.8) & (v > 32.5) & (v < 47.5))

    marker = found(draw(canvas(), covered, CYAN), (40, 40))
    assert np.hypot(*np.subtract(marker.position_px, (40.41, 40.13))) < 0.05


def test_nothing_there_is_an_error_by_name():
    line = draw(canvas(), lambda u, v: abs(v - 40) < 1.5, RED)  # a curve passing by
    far = draw(canvas(), cross(60, 40), CYAN)
    for image, at in (
        (canvas(), (40, 40)), (line, (40, 40)), (far, (40, 40)), (canvas(), (900, 40)),
        (canvas(), (40, -90)), (canvas(), (-12, 40)),
    ):  # fmt: skip
        with refuses(MarkerError, "no-mark-near", label="x1") as refused:
            found(image, at)
        assert "no cross or dot within 8 px of marker 'x1'" in str(refused.value)


def test_one_mark_is_not_two_markers():
    rgb = np.round(draw(canvas(), cross(40, 40), CYAN)).astype(np.uint8)
    with refuses(MarkerError, "one-mark-two-markers", labels=["x1", "x2"]):
        find_markers(rgb, ["x1", "x2"], [(38, 40), (43, 41)])


def test_the_nearest_of_two_marks_is_taken():
    image = draw(draw(canvas(), dot(36, 40), CYAN), dot(47, 40), CYAN)
    assert found(image, (44, 40)).position_px[0] == pytest.approx(47, abs=0.05)
    assert found(image, (39, 40)).position_px[0] == pytest.approx(36, abs=0.05)


@pytest.mark.parametrize(
    "name", ["pelvis_a.png", "pelvis_b.png", "pelvis_c.png", "pelvis_a_q80.jpg", "pelvis_b_q80.jpg"]
)
def test_planned_slices(shared_data, name):
    """JPEG at quality 80 has halved chroma; one marker lies on the phantom's edge."""
    folder = shared_data / "planned"
    with open(folder / f"{name[:8]}_markers_image.csv") as file:
        rows = list(csv.DictReader(file))
    truth = np.array([[float(row["u_px"]), float(row["v_px"])] for row in rows])
    start = np.round(truth)
    if name.endswith("png"):
        start = truth + np.random.default_rng(0).uniform(-4, 4, truth.shape)
    markers = find_markers(read_image(folder / name).rgb, [row["label"] for row in rows], start)
    assert np.linalg.norm([m.position_px for m in markers] - truth, axis=1).max() < 0.1
    assert {m.shape for m in markers} == {"cross"}


@pytest.mark.filterwarnings("error")
def test_a_blurred_mark_as_bright_as_its_ground_is_told_by_its_colour():
    v, u = np.indices((24, 24)).astype(float)
    alpha = 1 / (1 + np.exp((np.hypot(u - 11.3, v - 12.1) - 4) / 0.9))
    mark = Mark(alpha, np.ones(alpha.shape, bool), u, v, (11.0, 12.0), 6.0)
    fit = fit_mark(mark, np.full((24, 24, 3), 0.5))
    assert fit.shape == "dot"
    assert np.linalg.norm(fit.parameters[:2] - (11.3, 12.1)) < 0.05
