"""Probes of extreme marker layouts: thin, far, close together."""

from __future__ import annotations

import numpy as np

from vfplan.engine.checks import Vector
from vfplan.registration import fit_registration

T = np.array([[5.9e-4, 2e-5, 0.25], [-1e-5, -5.8e-4, 0.31], [3e-5, 4e-5, 0.12]])
GRID = np.array([(u, v) for v in (-1.0, 0.1, 1.0) for u in (-1.0, -0.1, 1.0)])


def _error(pixels: Vector, T_true: Vector) -> float:
    """Largest error over the markers of an affine fit to exact pairs [m]."""
    target = np.column_stack([pixels, np.ones(len(pixels))]) @ T_true.T
    found = fit_registration(pixels, target)
    return float(np.abs(found.apply(pixels) - target).max())


def thin(condition: float) -> float:
    """Markers nearly on a line: error over the layout's size in the robot's frame."""
    pixels = 400 + 300 * GRID @ np.array([[1.0, 0.5], [0.0, 1.0 / condition]])
    return _error(pixels, T) / (600 * 6e-4)


def far(distance: float) -> float:
    """Markers `distance` [m] from the robot's origin: error [m]."""
    away = T.copy()
    away[:, 2] += distance
    return _error(400 + 300 * GRID, away)


def close(spacing_px: float) -> float:
    """Markers a fraction of a pixel apart: error over the layout's size."""
    pixels = 400 + spacing_px * GRID
    return _error(pixels, T) / max(2 * spacing_px * 6e-4, 1e-300)


def few(count: int) -> float:
    """Fewer markers than an affine needs."""
    return _error(400 + 300 * GRID[:count], T)
