"""How far the measured centre may be off, point by point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FLOOR_PX = 0.008
WINDOW_PX = 61  # of line over which the noise is taken for the same


def measured_sigma(residual: NDArray, valid: NDArray, knots: float) -> NDArray:
    """(M,) standard deviation of the fitted line where it was seen [px]."""
    from scipy.ndimage import uniform_filter1d

    power = uniform_filter1d(np.where(valid, residual**2, 0.0), WINDOW_PX, mode="nearest")
    share = uniform_filter1d(valid.astype(float), WINDOW_PX, mode="nearest")
    local = power / np.maximum(share, 0.05)
    whole = np.mean(residual[valid] ** 2)
    ratio = 0.73 if knots > 10 else 0.6
    return np.sqrt(ratio**2 * (local + whole) / 2 + FLOOR_PX**2)


def bridged_sigma(bridged: NDArray, curvature: NDArray, closed: bool) -> NDArray:
    """(M,) what a gap adds: the hand may have bent there as much as it does elsewhere [px].

    A gap of length L and an unknown curvature of standard deviation k leaves k x (L − x)/2 at x.
    """
    extra = np.zeros(len(bridged))
    if not bridged.any():
        return extra
    spread = np.sqrt(np.mean(curvature**2))
    edges = np.flatnonzero(np.diff(np.r_[False, bridged, False].astype(int)))
    for start, stop in edges.reshape(-1, 2):
        x = np.arange(stop - start) + 0.5
        extra[start:stop] = spread * x * (stop - start - x) / 2
    return extra
