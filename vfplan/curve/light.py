"""What brightness adds to a line's offset in JPEG, and what blur does to a line where it bends.

JPEG stores colour at half resolution, brightness in full. Where the ground beside the line is
smooth, brightness less the ground, a straight run from flank to flank, shows the line as well: a
profile of its own, fitted as that of the coverage is. Both offsets are weighed by their own noise,
so that bones' edges under the line, and clean colour, leave the colour's offset as it is.

The JPEG bend: blur draws both edges of a bend inward, by half its variance times the curvature; the
blur is read from the line's own profile, so that of a scaled or a soft picture counts as it is.
JPEG gets no correction of its own: what it blurs is in the profile with the rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.path import normals

LUMINANCE = np.array([0.299, 0.587, 0.114])
FLANK_PX = 0.8  # beyond the line's edge begins the ground
MIDDLE_PX = 0.5
CLEAR = 2.0  # times its flanks' roughness: a line this much darker or brighter is seen
GREY_LEVELS = 1.0  # that the ground is rough at least, of 255
LAG = 4  # profiles apart, JPEG's noise in colour differs,
COARSE = 0.004  # by more than this of full coverage
INDEPENDENT = 3.0  # samples that share their noise
LEAST = 30  # profiles from which the brightness can be judged
MODEL_PX = 0.02  # what a ground that is not straight under the line may do unseen
GRID_PX = 0.05  # noise of clean colour: the pixel grid's, which the brightness shares
TREND_PX = 8.0  # slower changes of the offset are the path's, not noise
PULL, BIAS_PX, LOCAL_PX = 2.0, 4.0, 15.0  # times the colour's noise hereabouts, on the mean: bones
MEDIAN_OF_SQUARE = 0.455  # of a normal variable


def is_coarse(beside: NDArray) -> bool:
    """Whether (M, 2) coverage off both sides of a line has noise along it, as JPEG's colour has.

    Beside a line drawn and kept without loss there is none, however it was enlarged.
    """
    change = beside[LAG:] - beside[:-LAG]
    return len(change) >= LEAST and _spread(change) > COARSE


def is_tinted(beside: NDArray) -> bool:
    """Whether (M, 2) coverage off both sides of a line is not nought, as it is in clean pictures.

    JPEG's noise beside a line along its blocks does not change along the line.
    """
    return len(beside) >= LEAST and _spread(beside) > COARSE


def with_light(
    x: NDArray, left: NDArray, rough: NDArray, seen: NDArray, offset: NDArray, width: float
) -> NDArray[np.float64]:
    """(M,) offsets with what the brightness adds.

    x: (K,) places across the path [px]
    left, rough: (M, K) brightness less the ground, and (M,) how rough the ground is
    seen: (M, K) where they count; a row that lacks one is left
    offset: (M,) of the line by its colour [px]
    width: the line's width [px]
    """
    depth = left[:, np.abs(x) <= MIDDLE_PX].mean(1)
    clear = seen.all(1) & (np.abs(depth) > CLEAR * rough)
    if clear.sum() < LEAST:
        return offset
    light, doubt = _by_light(x, left, rough, np.where(clear, depth, 0.0))
    clear &= np.abs(light) < 1 + width / 4
    if clear.sum() < LEAST:
        return offset
    trend = _trend(offset)
    noise = _spread((offset - trend)[seen.any(1)])
    if noise < GRID_PX:
        return offset
    doubt = np.hypot(doubt * _spread(((light - trend) / doubt)[clear]), MODEL_PX)
    share = np.where(clear, noise**2 / (noise**2 + doubt**2), 0.0)
    pull = share * np.where(clear, light - offset, 0.0)
    return offset + _limited(pull, np.where(seen.any(1), offset - trend, np.nan), noise)


def without_ground(x: NDArray, light: NDArray, width: float) -> tuple[NDArray, NDArray]:
    """(M, K) brightness less the ground, and (M,) how rough the ground is."""
    flank = np.abs(x) > width / 2 + FLANK_PX
    line = np.column_stack([np.ones_like(x), x])
    left = light - (line @ np.linalg.pinv(line[flank]) @ light[:, flank].T).T
    return left, np.sqrt((left[:, flank] ** 2).mean(1)) + GREY_LEVELS


def _by_light(x: NDArray, left: NDArray, rough: NDArray, depth: NDArray) -> tuple[NDArray, NDArray]:
    """(M,) offset by brightness, and its standard deviation up to a common factor [px]."""
    weight = depth / rough**2
    mean = (weight[:, None] * left).sum(0) / (weight * depth).sum()
    mean = (mean + mean[::-1]) / 2
    slope = np.gradient(mean, x)
    fit = left @ np.linalg.pinv(np.column_stack([mean, slope, np.ones_like(x), x])).T
    height = np.where(fit[:, 0] * depth > 0, fit[:, 0], np.inf)
    power = float((slope**2).sum()) / INDEPENDENT
    doubt = rough / np.maximum(np.abs(depth), 1e-6) / np.sqrt(max(power, 1e-9))
    return -fit[:, 1] / height, doubt


def _limited(pull: NDArray, scatter: NDArray, noise: float) -> NDArray[np.float64]:
    """(M,) `pull` [px], less where it goes one way for longer than the colour's noise does.

    That is a bone's edge along the line. `scatter` (M,) is the colour's, NaN where not seen.
    """
    from scipy.ndimage import gaussian_filter1d

    power, share = np.nan_to_num(scatter**2), (~np.isnan(scatter)).astype(float)
    power, share = (gaussian_filter1d(values, LOCAL_PX) for values in (power, share))
    most = PULL * np.sqrt((power / np.maximum(share, 0.05) + noise**2) / 2)
    mean = np.abs(gaussian_filter1d(pull, BIAS_PX))
    return pull * np.minimum(1.0, most / np.maximum(mean, 1e-9))


def _trend(offset: NDArray) -> NDArray:
    from scipy.ndimage import gaussian_filter1d

    return gaussian_filter1d(offset, TREND_PX)


def _spread(values: NDArray) -> float:
    """Standard deviation, whatever a few outliers do."""
    return float(np.sqrt(np.median(values**2) / MEDIAN_OF_SQUARE)) + 1e-6


def drawn_inward(bend: NDArray | float, blur: float) -> NDArray | float:
    """How far blur has drawn a line to the inside of its bend [px].

    bend: its curvature, positive where it turns to its normals [1/px]
    blur: variance of the blur, as `blur_of` finds it [px²]
    """
    return bend * blur / 2


def bend_of(points: NDArray, closed: bool) -> NDArray:
    """(M,) curvature of a path in equal steps, positive where it turns to its normals [1/px]."""
    normal = normals(points, closed)
    change = np.roll(normal, -1, 0) - np.roll(normal, 1, 0)
    if not closed:
        change = 2 * np.gradient(normal, axis=0)
    step = np.hypot(*(points[1] - points[0]))
    return (normal[:, 0] * change[:, 1] - normal[:, 1] * change[:, 0]) / (2 * step)


def blur_of(x: NDArray, profile: NDArray, width: float) -> float:
    """Variance of the blur, a pixel's square included, in a line's (K,) mean profile [px²]."""
    weight = np.clip(profile, 0.0, None)
    variance = float((weight * x**2).sum() / max(weight.sum(), 1e-9))
    return max(variance - width**2 / 12, 0.0)
