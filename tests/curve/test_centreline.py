"""The planned curve against the truth it was drawn from."""

from __future__ import annotations

import functools
import tracemalloc

import cv2
import numpy as np
import pytest
from drawing import anatomy, blend, compare, coverage, jpeg, normal_errors, to_uint8, wavy

import vfplan
from vfplan.curve.profile import shading_shift
from vfplan.images.read import read_image

PLANNED = ["pelvis_a.png", "pelvis_b.png", "pelvis_c.png", "pelvis_a_q80.jpg", "pelvis_b_q80.jpg"]


@pytest.mark.parametrize("name", PLANNED)
def test_planned_slices_against_their_truth(shared_data, name):
    folder = shared_data / "planned"
    truth = np.loadtxt(folder / f"{name[:8]}_truth_px.csv", delimiter=",", skiprows=1)
    extraction = vfplan.extract_curve(read_image(folder / name))
    (stroke,) = extraction.strokes
    assert stroke.closed == name.startswith("pelvis_b")
    error = compare(stroke, truth, stroke.closed)
    assert error.rms < (0.13 if name.endswith("jpg") else 0.04)
    assert error.worst < 0.8
    assert error.uncovered < 2
    assert error.ends < 1.5
    assert abs(error.length_ratio - 1) < 0.01
    assert stroke.bridged.any() == name.startswith("pelvis_c")
    assert 0.75 <= error.z_rms <= 1.25
    if stroke.bridged.any():
        z = normal_errors(stroke.points_px, truth, False) / stroke.sigma_px
        assert np.sqrt(np.mean(z[stroke.bridged] ** 2)) <= 1.5


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize(
    ("width", "png", "q75"), [(2, 0.04, 0.18), (3, 0.03, 0.13), (5, 0.03, 0.10)]
)
def test_drawn_curves_over_anatomy(width, png, q75, closed):
    shape = (360, 420)
    curve = wavy(shape, 7, closed)
    share = coverage(shape, curve, width, closed)
    picture = to_uint8(blend(anatomy(shape, 7), share, (255, 0, 0)))
    for image, allowed in ((picture, png), (jpeg(picture, 75), q75)):
        (stroke,) = vfplan.extract_curve(image).strokes
        error = compare(stroke, curve, closed)
        assert error.rms <= allowed
        assert error.worst <= 0.8
        assert error.uncovered <= 2
        assert error.ends <= 1.5
        assert abs(error.length_ratio - 1) < 0.01


PICTURES = [
    ("png", {}, None, (0.03, 0.03)),
    ("transparent", {"opacity": 0.35}, None, (0.03, 0.03)),
    ("gamma", {"gamma": 2.2, "colour": (255, 99, 71), "opacity": 0.9}, None, (0.03, 0.03)),
    ("crimson", {"colour": (220, 20, 60), "opacity": 0.9}, None, (0.03, 0.03)),
    ("jpeg 90", {}, 90, (0.13, 0.10)),
    ("jpeg 75", {}, 75, (0.13, 0.10)),
    ("jpeg 75 gamma", {"gamma": 2.2}, 75, (0.13, 0.10)),
]


@functools.cache
def share_of(width, seed):
    curve = wavy(SHAPE, seed, closed=seed % 2 == 0)
    return curve, coverage(SHAPE, curve, width, seed % 2 == 0)


SHAPE = (360, 420)
SEEDS = (1, 2, 3, 4)


@pytest.mark.parametrize(
    ("name", "pen", "quality", "limits"), PICTURES, ids=[p[0] for p in PICTURES]
)
def test_accuracy_and_an_honest_sigma(name, pen, quality, limits):
    for width, limit in zip((3, 5), limits, strict=True):
        found = [measured(width, seed, pen, quality) for seed in SEEDS]
        assert np.sqrt(np.mean([e.rms**2 for e in found])) <= limit
        assert max(e.worst for e in found) <= 0.8
        assert max(e.uncovered for e in found) <= 2
        assert max(e.ends for e in found) <= 1.5
        # Four curves are about 150 independent places: the RMS itself is good to about 10 %.
        assert 0.7 <= np.sqrt(np.mean([e.z_rms**2 for e in found])) <= 1.35


@pytest.mark.parametrize(("width", "limit"), [(3, 0.13), (5, 0.10)])
def test_a_dark_pale_pen_in_jpeg(width, limit):
    """Little of its colour is left: the knots stand farther apart. Closed ones: no ends."""
    look = {"colour": (178, 34, 34), "opacity": 0.6}
    found = [measured(width, seed, look, 75) for seed in (2, 4)]
    assert np.sqrt(np.mean([e.rms**2 for e in found])) <= limit
    assert 0.7 <= np.sqrt(np.mean([e.z_rms**2 for e in found])) <= 1.35


def measured(width, seed, pen, quality, scale=1.0, enlarge=cv2.INTER_LINEAR):
    curve, share = share_of(width, seed)
    look = {"colour": (255, 0, 0)} | pen
    picture = blend(anatomy(SHAPE, seed), share, **look)
    if scale != 1.0:
        how = cv2.INTER_AREA if scale < 1 else enlarge
        picture = to_uint8(picture) if scale >= 2 else picture
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=how)
        curve = (curve + 0.5) * scale - 0.5
    image = to_uint8(picture)
    (stroke,) = vfplan.extract_curve(jpeg(image, quality) if quality else image).strokes
    return compare(stroke, curve, stroke.closed)


@pytest.mark.parametrize("scale", [0.73, 0.8, 1.37])
def test_pictures_rescaled_after_drawing(scale):
    found = [measured(4, seed, {"gamma": 2.2}, None, scale) for seed in SEEDS]
    assert np.sqrt(np.mean([e.rms**2 for e in found])) <= 0.03
    assert 0.6 <= np.sqrt(np.mean([e.z_rms**2 for e in found])) <= 1.4


@pytest.mark.parametrize("scale", [2.0, 2.5])
@pytest.mark.parametrize(
    ("how", "limit"),
    [(cv2.INTER_LINEAR, 0.03), (cv2.INTER_CUBIC, 0.04), (cv2.INTER_LANCZOS4, 0.05)],
)
def test_screen_captures_enlarged_after_drawing(how, limit, scale):
    """An enlarged pen's soft edge is no JPEG: brightness, and its bones, must stay out."""
    found = [measured(3, seed, {}, None, scale, how) for seed in SEEDS]
    assert np.sqrt(np.mean([e.rms**2 for e in found])) <= limit
    assert np.sqrt(np.mean([e.z_rms**2 for e in found])) <= 1.5
    assert max(e.worst for e in found) <= 0.3


def lean_of(sign):
    """The correction for offsets that follow fast changes of the ground by 0.1 px, or by -0.1."""
    rng = np.random.default_rng(5)
    fast = rng.normal(0, 0.1, 400)
    residual = sign * 0.1 * fast + rng.normal(0, 0.005, 400)
    return shading_shift(fast, fast, residual, np.ones(400, bool))[0], fast


def test_a_line_leans_to_the_dark_in_linear_light_and_never_to_the_bright():
    shift, fast = lean_of(-1)
    np.testing.assert_allclose(shift, 0.1 * fast, atol=0.004)
    assert not lean_of(+1)[0].any()


def symmetric(image):
    """The picture as it is, flipped, turned and transposed, with the map of its pixels back."""
    h, w = image.shape[:2]
    yield image, lambda p: p
    yield image[:, ::-1], lambda p: np.column_stack([w - 1 - p[:, 0], p[:, 1]])
    yield image[::-1], lambda p: np.column_stack([p[:, 0], h - 1 - p[:, 1]])
    yield image.transpose(1, 0, 2), lambda p: p[:, ::-1]


def test_flips_turns_and_channels_give_the_same_curve():
    curve, share = share_of(3, 3)
    image = to_uint8(blend(anatomy(SHAPE, 3), share, (255, 0, 0)))
    for turned, back in symmetric(image):
        (stroke,) = vfplan.extract_curve(np.ascontiguousarray(turned)).strokes
        error = normal_errors(back(stroke.points_px), curve, False)[3:-3]
        assert np.sqrt(np.mean(error**2)) < 0.02
    (green,) = vfplan.extract_curve(np.roll(image, 1, axis=2), colour="lime").strokes
    (red,) = vfplan.extract_curve(image).strokes
    assert np.allclose(green.points_px, red.points_px, atol=1e-3)


def test_the_same_image_gives_the_same_bytes():
    _, share = share_of(3, 2)
    image = to_uint8(blend(anatomy(SHAPE, 2), share, (255, 0, 0)))
    a, b = (vfplan.extract_curve(image.copy()).strokes[0] for _ in range(2))
    assert a.points_px.tobytes() == b.points_px.tobytes()
    assert a.sigma_px.tobytes() == b.sigma_px.tobytes()


def test_closed_curves_run_clockwise_and_open_ones_from_the_top_left():
    for seed in SEEDS:
        _, share = share_of(3, seed)
        image = to_uint8(blend(anatomy(SHAPE, seed), share, (255, 0, 0)))
        (stroke,) = vfplan.extract_curve(image).strokes
        u, v = stroke.points_px.T
        if stroke.closed:
            assert np.sum(u * np.roll(v, -1) - np.roll(u, -1) * v) > 0  # clockwise: v points down
            assert u[0] + v[0] <= (u + v).min() + 1.5
        else:
            assert u[0] + v[0] <= u[-1] + v[-1]


def test_one_sample_a_pixel_evenly():
    _, share = share_of(3, 1)
    image = to_uint8(blend(anatomy(SHAPE, 1), share, (255, 0, 0)))
    (stroke,) = vfplan.extract_curve(image).strokes
    steps = np.hypot(*np.diff(stroke.points_px, axis=0).T)
    assert np.allclose(steps, 1, atol=0.02)
    assert stroke.length_px == pytest.approx(steps.sum(), rel=1e-3)


def test_a_large_picture_costs_few_bytes_a_pixel():
    curve, share = share_of(5, 2)
    small = to_uint8(blend(anatomy(SHAPE, 2), share, (255, 0, 0)))
    image = cv2.copyMakeBorder(small, 0, 2048 - 360, 0, 2048 - 420, cv2.BORDER_REFLECT_101)
    image[360:, :] = image[:, 420:] = image[..., :1].mean(dtype=np.uint32) % 256
    image[:360, :420] = small
    image[2040:2042, 2040:2042] = (255, 0, 0)  # so that the pen's box is the whole picture
    tracemalloc.start()
    (stroke,) = vfplan.extract_curve(image).strokes
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert compare(stroke, curve, True).rms < 0.03
    assert peak < 12 * 2048**2
