"""What the pixel grid and bends do to the measured line, and the deviation stated for it."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from drawing import blend, compare, coverage, flat, jpeg, straight_coverage, to_uint8, wavy

import vfplan
from vfplan.curve.path import bend_of, normals
from vfplan.curve.pattern import learnt_pattern
from vfplan.curve.phase import Grid, inward_lean
from vfplan.curve.uncertainty import Picture, end_factor, measured_sigma

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
def test_a_line_nearly_along_the_pixels_is_as_good_as_any(slope):
    pens = (2, 2.2, 3, 4.5, 5)
    found = [scored(slope, start, pen) for pen in pens for start in (100.13, 99.71)]
    for error, _ in found:
        assert np.sqrt(np.mean(error**2)) < 0.008  # 0.02 to 0.03 px without redrawing
    assert rms([e / s for e, s in found]) < 1.25
    assert max(np.abs(e / s).max() for e, s in found) < 5


@pytest.mark.parametrize("slope", [1 / 300, 0.01, 0.05])
def test_in_jpeg_a_line_along_the_pixels_says_how_little_is_known(slope):
    """Its noise repeats along the line and shows in no residual."""
    found = [scored(slope, start, pen, 80) for pen in (2, 3, 4.5, 5) for start in (100.13, 99.71)]
    assert rms([e / s for e, s in found]) < 1.6


def drawn_reading(x, base, normal, line, width, sub=40):
    """A straight pen's coverage on the four pixels round each place, read linearly; slowly."""
    at, way = line
    offset = (np.arange(sub) + 0.5) / sub - 0.5
    du, dv = np.meshgrid(offset, offset)

    def pixel(u, v):
        distance = (u + du - at[0]) * -way[1] + (v + dv - at[1]) * way[0]
        return (np.abs(distance) <= width / 2).mean()

    found = np.zeros((len(base), len(x)))
    for i, j in np.ndindex(*found.shape):
        u, v = base[i] + x[j] * normal[i]
        a, b = int(np.floor(u)), int(np.floor(v))
        f, g = u - a, v - b
        found[i, j] = (1 - g) * ((1 - f) * pixel(a, b) + f * pixel(a + 1, b))
        found[i, j] += g * ((1 - f) * pixel(a, b + 1) + f * pixel(a + 1, b + 1))
    return found


@pytest.mark.parametrize("angle", [0.0, 0.03, 0.5, np.pi / 4, 1.5, 2.6])
def test_a_line_drawn_anew_reads_as_a_picture_of_it_does(angle):
    way = np.array([np.cos(angle), np.sin(angle)])
    at, width, shift = np.array([50.3, 49.8]), 2.6, 0.21
    base = at + np.arange(-4, 5)[:, None] * 0.93 * way
    normal = np.tile([-way[1], way[0]], (len(base), 1))
    x = np.arange(-3, 3.5, 0.5)
    grid = Grid.of_path(x, base, normal, np.zeros(len(base)))
    line = (at + shift * normal[0], way)
    expected = drawn_reading(x, base, normal, line, width)
    drawn = grid.read(np.full(len(base), shift), width, 0.0)
    np.testing.assert_allclose(drawn, expected, atol=0.02)  # of 40 x 40 samples a pixel
    assert np.abs(drawn - expected).mean() < 0.004


def ring(radius, width, quality=None):
    t = np.linspace(0, 2 * np.pi, 3000, endpoint=False)
    curve = np.column_stack([75.37 + radius * np.cos(t), 74.81 + radius * np.sin(t)])
    picture = to_uint8(blend(flat((150, 150)), coverage((150, 150), curve, width, True), RED))
    image = jpeg(picture, quality) if quality else picture
    (stroke,) = vfplan.extract_curve(image).strokes
    return np.hypot(*(stroke.points_px - (75.37, 74.81)).T) - radius, stroke.sigma_px


@pytest.mark.parametrize("radius", [10, 12, 25])
def test_blur_draws_no_bend_inward(radius):
    for quality, allowed in ((None, 0.004), (80, 0.03)):
        error, sigma = ring(radius, 3, quality)
        assert abs(error.mean()) < allowed
        assert np.sqrt(np.mean((error / sigma) ** 2)) < 1.5


def test_the_lean_of_a_blurred_bend_follows_from_its_profile():
    x = np.arange(-6, 6.1, 0.1)
    profile = np.convolve(np.abs(x) < 1.5, np.exp(-((x / 0.8) ** 2) / 2), "same")
    lean = inward_lean(x, profile, np.array([0.0, 0.1, -0.05]), 3.0)
    np.testing.assert_allclose(lean, [0.0, 0.032, -0.016], atol=0.002)


@pytest.mark.parametrize("closed", [False, True])
def test_curvature_of_a_path_in_equal_steps(closed):
    t = np.linspace(0, 2 * np.pi, 125, endpoint=False)
    t = t if closed else t[:80]
    path = 20 * np.column_stack([np.cos(t), np.sin(t)])
    bend = bend_of(path, closed)
    np.testing.assert_allclose(bend[2:-2], 1 / 20, rtol=0.01)
    centre = path + normals(path, closed) / bend[:, None]
    assert np.abs(centre[2:-2]).max() < 0.5  # it turns to its normals


def slanting(pattern, noise, seed=3):
    """A curve of slants up to 30 degrees, and the offsets a pattern of rows gives it."""
    rng = np.random.default_rng(seed)
    u = np.arange(600.0)
    points = np.column_stack([u, 100 + 40 * np.sin(u / 60)])
    normal = normals(points, False)
    offset = pattern(points[:, 1]) * normal[:, 1]
    residual = offset + noise * rng.standard_normal(len(u))
    return points, normal, offset, residual


@pytest.mark.parametrize("period", [1.0, 2.0, 2.5])
def test_the_grids_pattern_is_learnt_on_slants_and_known_along_the_grid(period):
    wave = 2 * np.pi / period
    points, normal, offset, residual = slanting(lambda v: 0.08 * np.sin(wave * (v + 0.5)), 0.03)
    level = np.abs(normal[:, 0]) < 0.05
    residual[level] = 0.0  # where the line swallows it
    found, learnt = learnt_pattern(points, normal, residual, np.ones(len(points), bool))
    assert learnt
    assert np.sqrt(np.mean((found - offset)[level] ** 2)) < 0.03


def test_noise_holds_no_pattern_and_a_level_line_teaches_none():
    points, normal, _, residual = slanting(lambda v: 0 * v, 0.03)
    seen = np.ones(len(points), bool)
    assert not learnt_pattern(points, normal, residual, seen)[0].any()
    level = np.column_stack([np.arange(300.0), np.full(300, 80.2)])
    found, learnt = learnt_pattern(level, normals(level, False), residual[:300], seen[:300])
    assert not learnt
    assert not found.any()


def sigma_of(coarse=0.0, alike=0.0, noisy=True, angle=0.6, curvature=0.0):
    residual = 0.05 * np.random.default_rng(0).standard_normal(400)
    normal = np.tile([-np.sin(angle), np.cos(angle)], (400, 1))
    picture = Picture(noisy=noisy, redrawn=False, learnt=True, alike=alike, coarse=coarse)
    bend = np.full(400, curvature)
    return measured_sigma(residual, np.ones(400, bool), normal, bend, picture).mean()


def test_the_deviation_changes_by_little_where_the_picture_does():
    steps = [sigma_of(coarse=c, alike=0.05 + 0.25 * c) for c in np.linspace(0, 1, 21)]
    assert np.abs(np.diff(steps)).max() < 0.05 * steps[0]
    assert sigma_of(angle=0.0) > 1.2 * sigma_of(angle=0.6)
    assert sigma_of(curvature=0.13) == pytest.approx(2 * sigma_of())
    s = np.arange(100.0)
    factor = end_factor(s, 5.0, 94.0)
    assert factor[50] == pytest.approx(1, abs=1e-3)
    assert (np.diff(factor[:50]) <= 0).all()
    assert factor[5] == pytest.approx(5.5)


@pytest.mark.parametrize("width", [2, 3, 5])
def test_a_crisp_pen_is_measured_to_a_few_thousandths_of_a_pixel(width):
    shape, found = (360, 420), []
    for seed in (1, 2, 4):
        curve = wavy(shape, seed, seed % 2 == 0)
        picture = blend(flat(shape), coverage(shape, curve, width, seed % 2 == 0), RED)
        (stroke,) = vfplan.extract_curve(to_uint8(picture)).strokes
        found.append(compare(stroke, curve, stroke.closed))
    assert np.sqrt(np.mean([e.rms**2 for e in found])) < 0.005
    assert 0.7 <= np.sqrt(np.mean([e.z_rms**2 for e in found])) <= 1.35
