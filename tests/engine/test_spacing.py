"""Spacing against brute-force neighbours, over scales, densities, layers and dirt."""

import numpy as np
import pytest

from vfplan.engine.spacing import SAMPLE, cloud_spacing, neighbour_distances


def brute(points, k):
    d = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(d, np.inf)
    return np.sort(d, axis=1)[:, :k]


def sheet(h, n=21, height=0.0):
    x, y = np.meshgrid(np.arange(n) * h, np.arange(n) * h)
    return np.column_stack([x.ravel(), y.ravel(), np.full(n * n, height)])


@pytest.mark.parametrize("k", [1, 4])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e3])
def test_neighbours_equal_brute_force(scale, k):
    rng = np.random.default_rng(1)
    dense, loose = rng.normal(size=(300, 3)) * 0.01, rng.normal(size=(200, 3))
    points = np.vstack([dense, loose]) * scale
    assert neighbour_distances(points, 100 * scale, k) == pytest.approx(brute(points, k), rel=1e-12)


def test_beyond_reach_is_infinite():
    points = np.array([[0.0, 0, 0], [0.5, 0, 0], [5.0, 0, 0]])
    assert neighbour_distances(points, 1.0, 1)[:, 0].tolist() == [0.5, 0.5, np.inf]
    assert cloud_spacing(points, 1.0) == 0.5
    assert cloud_spacing(points[[0, 2]], 1.0) is None
    assert cloud_spacing(points[:1], 1.0) is None


def test_duplicates_and_strays_do_not_count():
    h = 0.5e-3
    line = np.arange(400)[:, None] * h * np.array([1.0, 0, 0])
    dirty = np.vstack([line, line, line[:100] + 1e-12, [[0.3, 0.3, 0.3]]])
    assert cloud_spacing(line, 5e-3) == pytest.approx(h, rel=1e-6)
    assert cloud_spacing(dirty[:800], 5e-3) == pytest.approx(h, rel=1e-6)


@pytest.mark.parametrize("gap", [1e-5, 1e-4, 4e-3])
def test_two_layers_are_as_one(gap):
    """The nearest neighbour of a thin double sheet is its other layer: no measure of spacing."""
    layers = np.vstack([sheet(1e-3), sheet(1e-3, height=gap)])
    assert cloud_spacing(layers, 5e-3) == pytest.approx(1e-3, rel=1e-2)
    line = np.arange(200)[:, None] * 1e-3 * np.array([1.0, 0, 0])
    lines = np.vstack([line, line + gap * np.eye(3)[1]])
    assert cloud_spacing(lines, 5e-3) == pytest.approx(1e-3, rel=1e-2)


def test_random_surface_is_as_wide_as_its_holes():
    """Poisson points: discs of radius h / sqrt(2) cover nearly all of it."""
    rng = np.random.default_rng(2)
    points = rng.uniform(0, 1, (4000, 3)) * [1, 1, 0]
    h = cloud_spacing(points, 1.0)
    probes = rng.uniform(0.1, 0.9, (500, 3)) * [1, 1, 0]
    empty = np.linalg.norm(probes[:, None] - points[None], axis=2).min(axis=1)
    assert 0.85 < np.mean(empty <= h / np.sqrt(2)) < 0.99


def test_large_clouds_are_sampled():
    points = sheet(1e-4, n=300)
    nearest = neighbour_distances(points, 5e-3, 2)
    assert nearest.shape == (SAMPLE, 2)
    assert nearest == pytest.approx(1e-4)
