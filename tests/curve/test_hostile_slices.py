"""Extreme and hostile slices: tiny, huge, empty, all red, noise, the thinnest and thickest pen."""

from __future__ import annotations

import numpy as np
import pytest

from vfplan import extract_curve
from vfplan.errors import CurveError

GREY, RED = 120, np.array([255.0, 0.0, 0.0])


def blank(size):
    return np.full((size, size, 3), GREY, np.uint8)


def one_red_pixel():
    image = blank(300)
    image[150, 140] = RED
    return image


@pytest.mark.parametrize(
    "image",
    [blank(1), blank(8), blank(300), blank(300) * 0 + RED.astype(np.uint8), one_red_pixel(),
     np.random.default_rng(3).integers(0, 256, (600, 700, 3), dtype=np.uint8)],
    ids=["1 x 1", "8 x 8", "no red", "all red", "one red pixel", "noise"],
)  # fmt: skip
def test_a_slice_without_a_curve_is_refused(image):
    with pytest.raises(CurveError):
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


@pytest.mark.parametrize("pen, limit_px", [(0.5, 0.2), (3.0, 0.05), (60.0, 0.5)])
def test_pens_of_any_width_are_right_or_refused(pen, limit_px):
    try:
        assert off_the_ring(pen) < limit_px
    except CurveError:
        assert pen != 3.0


@pytest.mark.full
def test_a_slice_of_16384_px():
    assert off_the_ring(3.0, 16384) < 0.05


def random_picture(rng):
    """Shapes, lines and noise in any colours, of any size and depth."""
    import cv2

    size = rng.integers(1, 90, 2)
    picture = rng.integers(0, 256, (*size, 3)).astype(np.uint8)
    if rng.random() < 0.8:
        picture[:] = rng.integers(0, 256)
    for _ in range(int(rng.integers(0, 12))):
        at = rng.integers(-20, 110, (2, 2)).tolist()
        colour = [RED.tolist(), rng.integers(0, 256, 3).tolist()][int(rng.integers(2))]
        if rng.random() < 0.6:
            cv2.line(picture, at[0], at[1], colour, int(rng.integers(1, 12)), cv2.LINE_AA)
        else:
            cv2.circle(picture, at[0], int(rng.integers(0, 40)), colour, int(rng.integers(-1, 9)))
    return picture.astype(np.uint16) * 257 if rng.random() < 0.2 else picture


def random_options(rng, shape):
    which = [{"stroke": stroke} for stroke in ("all", "longest", 1, 2)]
    which += [{"start": tuple(rng.uniform(0, 90, 2))}, {}, {}]
    gaps = [{"max_gap_px": gap} for gap in (0.0, 5.0, 200.0)] + 5 * [{}]
    ways = [{"accept_width": True}, {"method": "skeleton"}, {}, {}]
    boxes = [{"roi": (1, 1, shape[1] - 2, shape[0] - 2), "exclude": [(1, 1, 2, 2)]}, {}, {}]
    if min(shape[:2]) <= 4:
        boxes = [{}]
    picked = [choices[rng.integers(len(choices))] for choices in (which, gaps, ways, boxes)]
    return picked[0] | picked[1] | picked[2] | picked[3]


@pytest.mark.parametrize("seed", range(8))
def test_any_picture_gives_a_finite_curve_or_a_refusal_with_a_code(seed):
    rng = np.random.default_rng(seed)
    codes = []
    for _ in range(60):
        image = random_picture(rng)
        try:
            extraction = extract_curve(image, **random_options(rng, image.shape))
        except CurveError as error:
            codes.append(error.code)
            continue
        limit = np.array(image.shape[1::-1]) - 0.5
        for stroke in extraction.strokes:
            assert np.isfinite(stroke.points_px).all()
            assert ((stroke.points_px >= -0.5) & (stroke.points_px <= limit)).all()
            assert (stroke.sigma_px > 0).all()
            assert np.isfinite(stroke.sigma_px).all()
            assert len(stroke.points_px) == len(stroke.sigma_px) == len(stroke.bridged)
        assert all(0 < entry.share < 2 for entry in extraction.account)
    assert CurveError.code not in codes
