"""How far the measured centre may be off, point by point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FLOOR_PX = 0.0045
WINDOW_PX = 61  # of line over which the noise is taken for the same
# A spline's error over its residual's RMS, found by drawing curves with known truth (the study is
# in docs/extraction.md): `LEAST` + `SLOPE` times the correlation of neighbouring residuals for the
# pixel grid's noise, `COARSE` for JPEG's, and more where JPEG's noise is past `NOISY_PX`: there it
# hangs together over longer stretches than the spline can average.
LEAST, SLOPE, COARSE = 0.46, 0.32, 0.72
NOISY_PX, NOISIER = 0.12, 2.0


def measured_sigma(residual: NDArray, valid: NDArray, alike: float) -> NDArray:
    """(M,) standard deviation of the fitted line where it was seen [px].

    Parameters
    ----------
    residual, valid
        (M,) measured offset minus the spline [px], and where there is any.
    alike
        Correlation of neighbouring residuals; 1 for a spline with coarse knots.
    """
    from scipy.ndimage import uniform_filter1d

    power = uniform_filter1d(np.where(valid, residual**2, 0.0), WINDOW_PX, mode="nearest")
    share = uniform_filter1d(valid.astype(float), WINDOW_PX, mode="nearest")
    local = power / np.maximum(share, 0.05)
    whole = np.mean(residual[valid] ** 2)
    if alike == 1:
        ratio = COARSE * (1 + NOISIER * max(0.0, float(np.sqrt(whole)) - NOISY_PX))
    else:
        ratio = float(np.clip(LEAST + SLOPE * alike, 0.3, 0.7))
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
