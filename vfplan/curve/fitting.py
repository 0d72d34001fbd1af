"""Measured offsets -> a spline that follows the hand and not the noise, and its standard deviation.

What brightness beside the line adds is learnt from what is left over, and taken off; the knots
stand as far apart as the noise wants.

What is left between the measurements and the spline tells the noise, and the noise the spline's own
error. What does not show there is added: the grid's share on runs nearly along it, where it is as
smooth as the line; the ends, which hang on one side only; corners and gaps. The numbers were found
by drawing curves with known truth; what they come to is in docs/extraction.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.path import curvature_of, fit_spline, normals, place_knots, runs
from vfplan.curve.profile import Profiles, shading_shift

FIRST_KNOTS_PX = 6.0
CLOSE_KNOTS_PX = 4.0  # where next to nothing is left over
CLEAN_PX = (0.002, 0.01)
FINE_KNOTS_PX = 7.0  # noise free: every wiggle is the hand's
COARSE_KNOTS_PX = 14.0  # JPEG's noise hangs together over half a block of 16 px
FARTHEST_KNOTS_PX = 22.0  # a pale pen's, of whose colour JPEG leaves little
LOUD_PX = (0.08, 0.14)
CORRELATED = (0.05, 0.3)  # residuals of neighbours this alike are JPEG's, not the pixel grid's,
NOISE_PX = (0.005, 0.015)  # and this large are noise, not the spline's own in bends
SOFT_PX2 = 0.45  # of blur: a crisp pen, read between pixels, has 0.25, JPEG's colour 0.6
TOUCHED_POINTS = 11  # within which the spline carries on what un-mixing gets wrong at one
CLIPPED = 5.0  # a line of which the border cuts off a part is less sure by this times the part

FLOOR_PX = 0.0025  # what programs that draw round off
WINDOW_PX, CORNER_PX = 61, 9  # of line over which the noise is taken for the same; of a corner
CORNER_SHARE, CORNER = 1 / 3, 4.0  # of the power left over there beyond so many times the usual
LOUD = 4.0  # times the whole line's, local power is a corner's
OUTLYING = 6.0  # times the median square, 2.2 for noise: more is a corner's, and not the line's
# A spline's error over its residual's RMS. JPEG's noise hangs together over longer stretches than
# the spline can average: `LEAST` + `SLOPE` times the correlation of neighbouring residuals, and
# `COARSE` where knots are far apart for it; more where the noise is past `NOISY_PX`.
LEAST, SLOPE, COARSE = 0.46, 0.27, 0.58
NOISY_PX, NOISIER = 0.12, 6.0
CLEAN = 0.145  # no noise: a pattern of the grid is left, that averages out,
GRID_PX = 0.035  # and is no more than this: more is the hand's own, which the spline cut short
THIN_PX = 2.0, 3.45  # of thinner pens the grid leaves more, and more of it stays in the line
CUT = 2.0  # times what is left over beyond that: the spline's own error at a corner
# The grid's share where the line runs along it, over the residual's RMS elsewhere, and at least;
# it fades as the line slants.
NOISY_GRID, CLEAN_GRID = 0.45, 1.2
UNSEEN_PX, MOST_PX = (0.025, 0.07), 0.12  # in crisp pictures, in soft ones
NOISY_SLANT, CLEAN_SLANT = 0.12, 0.10  # sine of the angle to the grid's nearer axis
DIAGONAL, DIAGONAL_SLANT = 0.6, 0.02  # the same along diagonals, over that along rows
TIGHT, TIGHTEST = 0.11, 0.25  # curvature that doubles the error, the largest that counts [1/px]
SWAY = 1.5  # times its usual bend, what a line may do in a gap
END, END_PX = 4.5, 4.0  # how much larger it is at an end, and over how much line that fades


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
    coarse = float(np.interp(alike, CORRELATED, (0, 1)) * np.interp(rms, NOISE_PX, (0, 1)))
    close = float(np.interp(rms, CLEAN_PX, (CLOSE_KNOTS_PX, FINE_KNOTS_PX)))
    far = float(np.interp(rms, LOUD_PX, (COARSE_KNOTS_PX, FARTHEST_KNOTS_PX)))
    return alike, coarse, close + coarse * (far - close)


def _along_normal(offset: NDArray, normal: NDArray, valid: NDArray) -> NDArray:
    return np.where(valid, (offset * normal).sum(1), 0.0)


@dataclass(frozen=True)
class Noise:
    """What is known of a picture's noise."""

    colour: bool  # whether the colour has noise, as JPEG's has
    soft: bool  # whether its colour is coarse, or the picture was enlarged
    alike: float  # correlation of neighbouring residuals
    coarse: float  # 0..1, how far the knots were drawn apart for that
    width: float  # of the line [px]; the thinner, the more of the grid shows


def measured_sigma(
    residual: NDArray, valid: NDArray, normal: NDArray, curvature: NDArray, picture: Noise
) -> NDArray[np.float64]:
    """(M,) standard deviation of the fitted line where it was seen [px].

    residual, valid: (M,) measured offset minus the spline [px], and where there is any
    normal, curvature: (M, 2) unit normals of the line, and (M,) its curvature [1/px]
    picture: what is known of its noise
    """
    square = residual[valid] ** 2
    whole = float(min(square.mean(), OUTLYING * np.median(square)))
    local = np.minimum(_mean_power(residual, valid, WINDOW_PX), LOUD * whole)
    power = (local + whole) / 2
    near = _mean_power(residual, valid, CORNER_PX)
    corner = CORNER_SHARE * (near - CORNER * whole)
    if not picture.colour:
        grid = GRID_PX * max(1.0, THIN_PX[0] / picture.width) ** 2
        power = np.minimum(power, grid**2)
        corner = CUT * (near - grid**2)
    noise = np.maximum(_ratio(picture, np.sqrt(whole)) ** 2 * power, corner)
    level = _along_grid(normal, np.sqrt(whole), picture)
    tight = 1 + (np.minimum(np.abs(curvature), TIGHTEST) / TIGHT) ** 2
    return tight * np.sqrt(noise + level**2 + FLOOR_PX**2)


def end_factor(s: NDArray, first: float, last: float) -> NDArray[np.float64]:
    """(M,) how much less sure an open line is at arc lengths s, measured from `first` to `last`."""
    beyond = np.minimum(np.maximum(first - s, s - last), END_PX)
    return 1 + END * np.exp(beyond / END_PX)


def _mean_power(residual: NDArray, valid: NDArray, window: int) -> NDArray[np.float64]:
    from scipy.ndimage import uniform_filter1d

    power = uniform_filter1d(np.where(valid, residual**2, 0.0), window, mode="nearest")
    share = uniform_filter1d(valid.astype(float), window, mode="nearest")
    return np.maximum(power, 0.0) / np.maximum(share, 0.05)


def _ratio(picture: Noise, rms: float) -> float:
    """The spline's error over its residual's RMS [px]."""
    if not picture.colour:
        return CLEAN * float(np.clip(THIN_PX[1] / picture.width, 1, 2))
    fine = float(np.clip(LEAST + SLOPE * picture.alike, 0.3, 0.65))
    coarse = COARSE * (1 + NOISIER * max(0.0, rms - NOISY_PX))
    return fine + picture.coarse * (coarse - fine)


def _along_grid(normal: NDArray, rms: float, picture: Noise) -> NDArray[np.float64]:
    """(M,) what of the grid's share is left where it is as smooth as the line [px]."""
    share, width = (NOISY_GRID, NOISY_SLANT) if picture.colour else (CLEAN_GRID, CLEAN_SLANT)
    size = max(share * min(rms, MOST_PX), UNSEEN_PX[picture.soft])
    slant = np.abs(normal).min(1)
    diagonal = DIAGONAL * np.exp(-(((slant - np.sqrt(0.5)) / DIAGONAL_SLANT) ** 2))
    return size * np.hypot(np.exp(-((slant / width) ** 2)), diagonal)


def bridged_sigma(bridged: NDArray, curvature: NDArray, closed: bool) -> NDArray:
    """(M,) what a gap adds: the hand may have bent there as much as it does elsewhere [px].

    A gap of length L and an unknown curvature of standard deviation k leaves k x (L − x)/2 at x.
    """
    extra = np.zeros(len(bridged))
    spread = np.sqrt(np.mean(curvature**2))
    for run in runs(bridged, False):
        x = np.arange(len(run)) + 0.5
        extra[run] = SWAY * spread * x * (len(run) - x) / 2
    return extra
