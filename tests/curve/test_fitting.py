"""What the pixel grid and bends do to the measured line, and the deviation stated for it."""

from __future__ import annotations

import functools
from types import SimpleNamespace

import numpy as np
import pytest
from canvas import RASTERISERS, Canvas
from drawing import anatomy, blend, compare, coverage, flat, jpeg, straight_coverage, to_uint8, wavy

import vfplan
from vfplan.curve.fitting import bridged_sigma, end_factor, measured_sigma
from vfplan.curve.profile import blur_of

RED = (255, 0, 0)


@functools.cache
def straight(slope, start, width, turned):
    return straight_coverage(slope, start, width, turned)


def scored(slope, start, width, quality=None):
    ends, share = straight(slope, start, width, start % 1 > 0.5)
    picture = to_uint8(blend(flat(share.shape), share, RED))
    (stroke,) = vfplan.extract_curve(jpeg(picture, quality) if quality else picture).strokes
    keep = slice(6, -6)
    way = np.diff(ends, axis=0)[0] / np.hypot(*np.diff(ends, axis=0)[0])
    off = stroke.points_px[keep] - ends[0]
    error = way[0] * off[:, 1] - way[1] * off[:, 0]
    return error, stroke.sigma_px[keep]


def rms(values):
    return float(np.sqrt(np.mean(np.concatenate(values) ** 2)))


@pytest.mark.parametrize("slope", [1 / 300, 0.01, 0.02, 0.05, 0.3])
def test_a_line_nearly_along_the_pixels_is_within_the_budget(slope):
    pens = (2, 2.2, 3, 4.5, 5)
    found = [scored(slope, start, pen) for pen in pens for start in (100.13, 99.71)]
    assert rms([error for error, _ in found]) < 0.03
    assert rms([e / s for e, s in found]) < 1.25
    assert max(np.abs(e / s).max() for e, s in found) < 5


@pytest.mark.parametrize("slope", [1 / 300, 0.01, 0.05])
def test_in_jpeg_a_line_along_the_pixels_says_how_little_is_known(slope):
    """Its noise repeats along the line and shows in no residual."""
    found = [scored(slope, start, pen, 80) for pen in (2, 3, 4.5, 5) for start in (100.13, 99.71)]
    assert rms([e / s for e, s in found]) < 1.6


def ring(radius, width, quality=None):
    t = np.linspace(0, 2 * np.pi, 3000, endpoint=False)
    curve = np.column_stack([75.37 + radius * np.cos(t), 74.81 + radius * np.sin(t)])
    picture = to_uint8(blend(flat((150, 150)), coverage((150, 150), curve, width, True), RED))
    image = jpeg(picture, quality) if quality else picture
    (stroke,) = vfplan.extract_curve(image).strokes
    return np.hypot(*(stroke.points_px - (75.37, 74.81)).T) - radius, stroke.sigma_px


@pytest.mark.parametrize("radius", [10, 12, 25])
def test_blur_draws_no_bend_inward(radius):
    for quality, allowed in ((None, 0.01), (80, 0.03)):
        error, sigma = ring(radius, 3, quality)
        assert abs(error.mean()) < allowed
        assert np.sqrt(np.mean((error / sigma) ** 2)) < 1.5


def test_blur_follows_from_a_lines_profile():
    x = np.arange(-6, 6.1, 0.1)
    profile = np.convolve(np.abs(x) < 1.5, np.exp(-((x / 0.8) ** 2) / 2), "same")
    assert blur_of(x, profile, 3.0) == pytest.approx(0.64, abs=0.02)


def sigma_of(noisy=True, angle=0.6, curvature=0.0, power=1.0):
    residual = 0.05 * power * np.random.default_rng(0).standard_normal(400)
    normal = np.tile([-np.sin(angle), np.cos(angle)], (400, 1))
    picture = SimpleNamespace(noisy=noisy, blur=0.3, width=3.0)
    bend = np.full(400, curvature)
    return measured_sigma(residual, np.ones(400, bool), normal, bend, picture, "nearest").mean()


def test_the_deviation_grows_with_the_noise_along_the_grid_in_bends_and_at_ends():
    assert sigma_of(noisy=False, power=0.5) < sigma_of(power=0.5) < 0.6 * sigma_of()
    assert sigma_of(angle=0.0) > 1.2 * sigma_of(angle=0.6)
    # Blur of 0.3 px² draws a bend of 0.2 per px inward by 0.03 px.
    assert sigma_of(curvature=0.2) > np.hypot(sigma_of(), 0.03)
    s = np.arange(100.0)
    factor = end_factor(s, 5.0, 94.0)
    assert factor[50] == pytest.approx(1, abs=1e-3)
    assert (np.diff(factor[:50]) <= 0).all()
    assert factor[5] == pytest.approx(5.5)


def test_the_deviation_of_a_ring_knows_no_seam():
    rng = np.random.default_rng(1)
    residual, bend = 0.2 * rng.standard_normal((2, 200))
    normal = np.tile([0.6, 0.8], (200, 1))
    picture = SimpleNamespace(noisy=False, blur=0.3, width=3.0)
    gap = np.arange(200) % 199 < 20

    def stated(by):
        values = (np.roll(part, by, 0) for part in (residual, ~gap, normal, bend))
        sigma = measured_sigma(*values, picture, "wrap")
        extra = bridged_sigma(np.roll(gap, by), np.roll(bend, by), True)
        return np.roll(np.column_stack([sigma, extra]), -by, 0)

    assert stated(-10) == pytest.approx(stated(60))


@pytest.mark.parametrize("rasteriser", RASTERISERS)
def test_a_crisp_pen_is_measured_within_the_budget_whatever_drew_it(rasteriser):
    found = []
    for width, seed in ((2, 1), (3, 2), (5, 4)):
        curve = wavy((360, 420), seed, seed % 2 == 0)
        canvas = Canvas(anatomy((360, 420), seed), rasteriser)
        canvas.line(curve, width, RED, seed % 2 == 0)
        (stroke,) = vfplan.extract_curve(canvas.image()).strokes
        found.append(compare(stroke, curve, stroke.closed))
    assert np.sqrt(np.mean([e.rms**2 for e in found])) < 0.03
    assert 0.3 <= np.sqrt(np.mean([e.z_rms**2 for e in found])) <= 1.6
