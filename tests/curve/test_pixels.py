"""What the core does for each pixel of a picture, against scikit-image and SciPy."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree
from skimage.morphology import skeletonize

from vfplan import _core


def blobs(seed):
    """A mask of blobs of some size, within a border of free pixels."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=rng.integers(2, 70, 2))
    smooth = cv2.GaussianBlur(noise, (0, 0), rng.uniform(0.1, 5))
    return np.pad(smooth > 0.1 * rng.normal(), 1)


@pytest.mark.parametrize("first", range(0, 500, 100))
def test_skeletons_are_those_of_scikit_image(first):
    for seed in range(first, first + 100):
        mask = blobs(seed)
        assert np.array_equal(_core.thinned(mask), skeletonize(mask, method="lee")), seed


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (2, 2), (3, 3), (40, 60)])
def test_ink_up_to_the_border_is_safe_to_thin(shape):
    full = np.ones(shape, bool)
    assert _core.thinned(full).sum() <= full.sum()


@pytest.mark.parametrize("count", [1, 2, 5, 900])
def test_nearest_points_are_scipys(count):
    rng = np.random.default_rng(count)
    points = rng.normal(size=(count, 2)).cumsum(axis=0)
    for places in (points, points + rng.normal(size=points.shape), rng.uniform(-50, 50, (500, 2))):
        distance, row = _core.nearest(points, places)
        expected, nearest = cKDTree(points).query(places)
        assert distance == pytest.approx(expected, abs=1e-12)
        assert np.array_equal(row, nearest)


def test_of_points_that_are_as_near_the_first_counts():
    points = np.array([[5.0, 0], [-1, 0], [1, 0], [1, 0], [0, 1]])
    assert _core.nearest(points, np.zeros((3, 2)))[1].tolist() == [1, 1, 1]
    assert _core.nearest(points, np.array([[2.0, 0]]))[1].tolist() == [2]


def test_no_points_are_refused():
    with pytest.raises(ValueError, match="no points"):
        _core.nearest(np.zeros((0, 2)), np.zeros((1, 2)))
