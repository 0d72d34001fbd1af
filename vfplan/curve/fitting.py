"""Measured offsets -> a spline that follows the hand and not the noise, and its deviation.

What brightness beside the line adds is learnt from what is left over, and taken off; the knots
stand as far apart as the noise wants.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.path import normals
from vfplan.curve.profile import Profiles, shading_shift
from vfplan.curve.spline import curvature_of, fit_spline, place_knots
from vfplan.curve.uncertainty import Noise, end_factor, measured_sigma

FIRST_KNOTS_PX = 6.0
CLOSE_KNOTS_PX = 4.0  # where next to nothing is left over
CLEAN_PX = (0.002, 0.01)
FINE_KNOTS_PX = 7.0  # noise free: every wiggle is the hand's
COARSE_KNOTS_PX = 14.0  # JPEG's noise hangs together over half a block of 16 px
FARTHEST_KNOTS_PX = 22.0  # a pale pen's, of whose colour JPEG leaves little
LOUD_PX = (0.08, 0.14)
CORRELATED = (0.05, 0.3)  # residuals of neighbours this alike are JPEG's, not the pixel grid's,
NOISY_PX = (0.005, 0.015)  # and this large are noise, not the spline's own in bends
SOFT_PX2 = 0.45  # of blur: a crisp pen, read between pixels, has 0.25, JPEG's colour 0.6
TOUCHED_POINTS = 11  # within which the spline carries on what un-mixing gets wrong at one
CLIPPED = 5.0  # a line of which the border cuts off a part is less sure by this times the part


@dataclass(frozen=True, eq=False)
class Fitted:
    """A line's spline over arc length [px], and (M,) its deviation at the measured points [px]."""

    spline: Callable[[NDArray], NDArray]
    sigma: NDArray[np.float64]


def fit_line(
    s: NDArray, base: NDArray, profiles: Profiles, valid: NDArray, closed: bool, knots: float | None
) -> Fitted:
    """The spline through what was read along a path; a first one where `knots` [px] are given.

    s, base: (M,) arc length and (M, 2) the path, in equal steps [px]
    profiles, valid: what was read there, and (M,) bool, which of it counts
    closed: whether the path is a ring
    knots: the knots' distance [px]; `None` lets it follow from the noise, and states the deviation
    """
    normal = normals(base, closed)
    period = s[-1] + s[1] if closed else None
    length = period if closed else s[-1]
    even = FIRST_KNOTS_PX if knots is None else knots
    flat = np.zeros(len(s))
    raw = base + profiles.offset[:, None] * normal
    at = place_knots(s, flat, valid, length, even)
    spline = fit_spline(s, np.column_stack([raw, profiles.shading]), valid, period, at)
    if knots is not None:
        return Fitted(lambda x: spline(x)[:, :2], flat)
    return _refined(s, raw, spline, profiles, valid, normal, period)


def _refined(
    s: NDArray,
    raw: NDArray,
    spline: Callable[[NDArray], NDArray],
    profiles: Profiles,
    valid: NDArray,
    normal: NDArray,
    period: float | None,
) -> Fitted:
    """The spline with its knots as far apart as the noise wants, and its deviation."""
    from scipy.ndimage import maximum_filter1d

    smooth = spline(s)
    residual = _along_normal(raw - smooth[:, :2], normal, valid)
    fast = np.where(valid, profiles.shading - smooth[:, 2], 0.0)
    shift, doubt = shading_shift(profiles.shading, fast, residual, valid)
    raw = raw + shift[:, None] * normal
    alike, coarse, widest = _knots(residual[valid])
    at = place_knots(s, curvature_of(spline, s), valid, period or s[-1], widest)
    spline = fit_spline(s, raw, valid, period, at)
    residual = _along_normal(raw - spline(s), normal, valid)
    noise = Noise(profiles.noisy, profiles.blur > SOFT_PX2, alike, coarse, profiles.width)
    sigma = measured_sigma(residual, valid, normal, curvature_of(spline, s), noise)
    touched = maximum_filter1d(profiles.doubt, TOUCHED_POINTS)
    sigma = np.sqrt(sigma**2 + doubt**2 + touched**2) * (1 + CLIPPED * profiles.clipped)
    if period is None:
        sigma *= end_factor(s, *s[valid][[0, -1]])
    return Fitted(spline, sigma)


def _knots(residual: NDArray) -> tuple[float, float, float]:
    """How alike neighbouring residuals are, -1..1; how coarse, 0..1, the knots; their distance."""
    power = float((residual**2).mean())
    alike = float((residual[1:] * residual[:-1]).mean() / max(power, 1e-12))
    rms = np.sqrt(power)
    coarse = float(np.interp(alike, CORRELATED, (0, 1)) * np.interp(rms, NOISY_PX, (0, 1)))
    close = float(np.interp(rms, CLEAN_PX, (CLOSE_KNOTS_PX, FINE_KNOTS_PX)))
    far = float(np.interp(rms, LOUD_PX, (COARSE_KNOTS_PX, FARTHEST_KNOTS_PX)))
    return alike, coarse, close + coarse * (far - close)


def _along_normal(offset: NDArray, normal: NDArray, valid: NDArray) -> NDArray:
    return np.where(valid, (offset * normal).sum(1), 0.0)
