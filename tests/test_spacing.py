"""Spacing against a brute-force nearest neighbour, over scales, densities and dirt."""

import numpy as np
import pytest

from vfplan.spacing import SAMPLE, cloud_spacing, nearest_distances


def brute(points):
    d = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(d, np.inf)
    return d.min(axis=1)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e3])
def test_nearest_distances_equal_brute_force(scale):
    rng = np.random.default_rng(1)
    dense, loose = rng.normal(size=(300, 3)) * 0.01, rng.normal(size=(200, 3))
    points = np.vstack([dense, loose]) * scale
    assert nearest_distances(points, 100 * scale) == pytest.approx(brute(points), rel=1e-12)


def test_beyond_reach_is_infinite():
    points = np.array([[0.0, 0, 0], [0.5, 0, 0], [5.0, 0, 0]])
    assert nearest_distances(points, 1.0).tolist() == [0.5, 0.5, np.inf]
    assert cloud_spacing(points, 1.0) == 0.5
    assert cloud_spacing(points[[0, 2]], 1.0) is None
    assert cloud_spacing(points[:1], 1.0) is None


def test_duplicates_and_strays_do_not_count():
    h = 0.5e-3
    line = np.arange(400)[:, None] * h * np.array([1.0, 0, 0])
    dirty = np.vstack([line, line, line[:100] + 1e-12, [[0.3, 0.3, 0.3]]])
    assert cloud_spacing(dirty, 5e-3) == pytest.approx(h, rel=1e-6)


def test_large_clouds_are_sampled():
    n = 300
    x, y = np.meshgrid(np.arange(n), np.arange(n))
    sheet = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]) * 1e-4
    nearest = nearest_distances(sheet, 5e-3)
    assert nearest.shape == (SAMPLE,)
    assert nearest == pytest.approx(1e-4)
