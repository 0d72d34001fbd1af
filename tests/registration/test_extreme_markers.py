"""Extreme layouts of markers: thin, far away, close together, too few."""

from __future__ import annotations

import numpy as np
import pytest

from vfplan import fit_registration
from vfplan.errors import MarkerError
from vfplan.registration.models import fit_model, make_problem, marker_rows

T = np.array([[5.9e-4, 2e-5, 0.25], [-1e-5, -5.8e-4, 0.31], [3e-5, 4e-5, 0.12]])
GRID = np.array([(u, v) for v in (-1.0, 0.1, 1.0) for u in (-1.0, -0.1, 1.0)])


def error(pixels):
    """Largest error over the markers of an affine fit to exact pairs [m]."""
    target = np.column_stack([pixels, np.ones(len(pixels))]) @ T.T
    return float(np.abs(fit_registration(pixels, target).apply(pixels) - target).max())


@pytest.mark.parametrize("condition", [1e4, 1e8, 1e12])
def test_nearly_collinear_is_right_or_refused(condition):
    try:
        found = error(400 + 300 * GRID @ np.array([[1.0, 0.5], [0.0, 1.0 / condition]]))
    except MarkerError:
        return
    assert found < 1e-9 * 600 * 6e-4


def test_a_hundredth_of_a_pixel_apart():
    assert error(400 + 0.01 * GRID) < 1e-9 * 2 * 0.01 * 6e-4


@pytest.mark.parametrize("bend", [0.0, 1e-3])
def test_a_similarity_with_unlike_sigmas_is_a_minimum(bend):
    """Of markers photographed askew too, and in the wrong order, where Gauss-Newton ran away."""
    rng = np.random.default_rng(3)
    for k in range(12):
        pixels = rng.uniform(0, 800, (int(rng.integers(4, 10)), 2))
        target = np.column_stack([pixels, np.ones(len(pixels))]) @ T.T
        target /= 1 + bend * pixels[:, :1]
        target += rng.normal(0, 3e-4, target.shape)
        sigma = 10 ** rng.uniform(-5, -2.5, target.shape)
        wrong = k % 2
        problem = make_problem(pixels, target[:: 1 - 2 * wrong], "similarity", None, sigma, None)
        fit = fit_model(problem)
        root = np.sqrt(problem.weights).reshape(-1, 1)
        moves = np.linalg.qr(root * (marker_rows(problem.x) @ problem.model.tangent(fit.m)))[0]
        left = root[:, 0] * fit.vectors.ravel()
        most = 0.1 if wrong else 1e-3  # of wrong ones it is a long way, in fifty steps
        assert np.linalg.norm(moves.T @ left) < most * np.linalg.norm(left)
