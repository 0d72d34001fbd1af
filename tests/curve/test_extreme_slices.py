"""Extreme slices: tiny, huge, empty, all red, with the thinnest and the thickest pen."""

from __future__ import annotations

import numpy as np
import pytest

from vfplan import extract_curve
from vfplan.errors import CurveError, ImageError

GREY, RED = 120, np.array([255.0, 0.0, 0.0])


def blank(size):
    return np.full((size, size, 3), GREY, np.uint8)


def one_red_pixel():
    image = blank(300)
    image[150, 140] = RED
    return image


def one_bit():
    rows, columns = np.indices((300, 300))
    return np.hypot(rows - 150, columns - 150) < 80


@pytest.mark.parametrize(
    "image",
    [blank(1), blank(8), blank(300), blank(300) * 0 + RED.astype(np.uint8), one_red_pixel(),
     one_bit()],
    ids=["1 x 1", "8 x 8", "no red", "all red", "one red pixel", "1 bit"],
)  # fmt: skip
def test_a_slice_without_a_curve_is_refused(image):
    with pytest.raises((CurveError, ImageError)):
        extract_curve(image)


def off_the_ring(pen: float, size: int = 700) -> float:
    """RMS distance of the extracted curve from the ring that was drawn [px]."""
    centre, radius = np.array([size / 2 + 0.3, size / 2 - 0.2]), 0.35 * size
    image = np.empty((size, size, 3), np.uint8)
    u = np.arange(size, dtype=np.float64)
    for v in range(size):  # a row at a time, so that a large slice needs no large scratch
        distance = np.abs(np.hypot(u - centre[0], v - centre[1]) - radius)
        share = np.clip(pen / 2 + 0.5 - distance, 0.0, min(pen, 1.0))[:, None]
        image[v] = np.rint(GREY * (1 - share) + RED * share)
    stroke = extract_curve(image).strokes[0]
    away = np.hypot(*(stroke.points_px - centre).T) - radius
    return float(np.sqrt((away * away).mean()))


@pytest.mark.parametrize(("pen", "limit_px"), [(0.5, 0.2), (3.0, 0.05), (60.0, 0.5)])
def test_pens_of_any_width_are_right_or_refused(pen, limit_px):
    try:
        assert off_the_ring(pen) < limit_px
    except CurveError:
        assert pen != 3.0


@pytest.mark.full
def test_a_slice_of_16384_px():
    assert off_the_ring(3.0, 16384) < 0.05
