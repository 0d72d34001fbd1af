"""Coverage and brightness along the local normals of a path: how far off it the line lies.

JPEG stores colour at half resolution, brightness in full. Where the ground beside the line is
smooth, brightness less the ground, a straight run from flank to flank, shows the line as well: a
profile of its own, fitted as that of the coverage is. Both offsets are weighed by their own noise,
so that bones' edges under the line, and clean colour, leave the colour's offset as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.pen import Pen, sample_pixels

MARGIN_PX = 2.0  # profiles reach this far beyond the line's edge
STEP_PX = 0.5
INNER_PX = 0.5  # of the profile's middle: it must lie in the image
FOREIGN = 0.35  # of the pen's strength across its hue: more is another colour
TINGED = 0.15  # of the pen's strength across its hue: a pixel that another colour may hide in part
TOUCHED_PX = 0.15, 0.45  # doubt of a line on top of another colour, of one measured by one edge
VISIBLE = 0.85  # of the usual coverage: the pen lies on top of the other colour
RISE = 0.2  # of full coverage, past the line's edge: a neighbour
FAR_PX = 5.0  # beyond a width from the line's middle a pen that was enlarged has faded as well
SEEN = 0.25  # of the usual coverage: less is no line
LUMINANCE = np.array([0.299, 0.587, 0.114])
FLANK_PX = 0.8  # beyond the line's edge begins the ground
MIDDLE_PX = 0.5
CLEAR = 2.0  # times its flanks' roughness: a line this much darker or brighter is seen
GREY_LEVELS = 1.0  # that the ground is rough at least, of 255
COARSE = 0.004  # of full coverage beside the line: JPEG's noise
LEAST = 30  # profiles from which noise and brightness can be judged
TREND_PX = 8.0  # slower changes of the offset are the path's, not noise
MEDIAN_OF_SQUARE = 0.455  # of a normal variable
SHADING_T = 5.0  # a shading effect below this many standard errors is not there,
SHADING_DOUBT = 0.6  # share of the correction that may be wrong
SHADING_MOST = 0.4  # and linear light shifts no edge by more, from black to white [px]


@dataclass(frozen=True, eq=False)
class Profiles:
    """What was read across the line at each point of a path."""

    x: NDArray[np.float64]  # (K,) places across the path [px]
    # (M, K) coverage there, and bool, where nothing foreign hid it
    alpha: NDArray[np.float64]
    seen: NDArray[np.bool_]
    # (M, K) brightness less the ground's, on 0..255, and (M,) how rough the ground is
    light: NDArray[np.float64]
    rough: NDArray[np.float64]
    # (M,) of the line from the path along the normal [px]; 0 where not valid
    offset: NDArray[np.float64]
    mass: NDArray[np.float64]  # (M,) coverage summed across the line, 1 in the middle of its run
    valid: NDArray[np.bool_]  # (M,) bool: the line was seen and nothing foreign hid it
    clipped: NDArray[np.float64]  # (M,) share of the line's own width that lies outside the image
    # (M,) grey just beyond the line on one side minus on the other, -1..1
    shading: NDArray[np.float64]
    noisy: bool  # whether there is colour beside the line, as JPEG's noise is
    blur: float  # variance of the line's blur, a pixel's square included [px²]
    width: float  # the line's width [px]
    # (M,) what un-mixing may have got wrong where another colour touches the line [px]
    doubt: NDArray[np.float64]


def read_profiles(
    rgb: NDArray,
    base: NDArray,
    normal: NDArray,
    pen: Pen,
    width: float,
) -> Profiles:
    """Read profiles across a (M, 2) path with (M, 2) unit normals.

    Where another colour touches the line, it is measured by what that leaves of it: all of it, or
    one of its edges.
    """
    half = np.ceil((width / 2 + MARGIN_PX) / STEP_PX)
    x = np.arange(-half, half + 1) * STEP_PX
    u, v = base[:, :1] + normal[:, :1] * x, base[:, 1:] + normal[:, 1:] * x
    pixels = sample_pixels(rgb, u, v)
    alpha = pixels @ pen.along / pen.strength
    inside = (np.abs(u - (rgb.shape[1] - 1) / 2) <= rgb.shape[1] / 2) & (
        np.abs(v - (rgb.shape[0] - 1) / 2) <= rgb.shape[0] / 2
    )
    across = pixels @ pen.across / pen.strength
    foreign = (np.abs(across) > FOREIGN) | (alpha < -FOREIGN)
    core = np.abs(x) <= width / 2 + 0.5
    touched = foreign[:, core].any(1)
    foreign |= _beyond_valley(alpha, x, width)
    mass = np.where(foreign, 0.0, np.clip(alpha, 0, None)).sum(1)
    usual = max(np.median(mass), 1e-9)
    mass = mass / usual
    seen = ~foreign & inside
    shown = np.where(touched[:, None], _shown_beside(alpha, across, seen, x, width, usual), seen)
    valid = np.where(touched, shown.any(1), (mass > SEEN) & ~foreign[:, core].any(1))
    valid &= inside[:, np.abs(x) <= INNER_PX].all(1)
    mean = _mean_profile(alpha, valid[:, None] & seen)
    off = (width + FAR_PX) * normal
    beside = sample_pixels(rgb, *np.moveaxis(np.stack([base - off, base + off], 1), 2, 0))
    beside = (beside @ pen.along / pen.strength)[valid]
    offset = _matched(x, alpha, valid[:, None] & shown, mean)
    valid &= np.abs(offset) < width / 2 + 1.5
    light, rough = without_ground(x, pixels @ LUMINANCE, width)
    noisy = len(beside) >= LEAST and _spread(beside) > COARSE
    if noisy:
        offset = with_light(
            x, light, rough, valid[:, None] & seen, np.where(valid, offset, 0.0), width
        )
    grey = pixels.mean(2) / 255
    shading = grey[:, -3:].mean(1) - grey[:, :3].mean(1)
    outer = np.r_[0:3, -3:0]
    bare = seen[:, outer].all(1) & (np.abs(alpha[:, outer]) < RISE).all(1)
    shading = np.where(bare, shading, 0.0)  # another mark's darkness is no background
    offset = np.where(valid, offset, 0.0)
    clipped = 1 - inside[:, core].mean(1)
    return Profiles(
        x=x,
        alpha=alpha,
        light=light,
        rough=rough,
        seen=seen,
        offset=offset,
        mass=mass,
        valid=valid,
        clipped=clipped,
        shading=shading,
        noisy=noisy,
        blur=blur_of(x, mean, width),
        width=width,
        doubt=np.where(touched, np.where(shown.all(1), *TOUCHED_PX), 0.0),
    )


def _shown_beside(
    alpha: NDArray, across: NDArray, seen: NDArray, x: NDArray, width: float, usual: float
) -> NDArray[np.bool_]:
    """(M, K) of a line that another colour touches, the places that show it; none where too few do.

    All of them where the pen lies on top, else those the other colour leaves, an edge and its
    ground among them.
    """
    whole = np.abs(np.clip(alpha, 0.0, None).sum(1) / usual - 1) < 1 - VISIBLE
    clean = seen & (np.abs(across) < TINGED)
    half = width / 2
    edges = [clean[:, (side * x > half - 1) & (side * x <= half + 1)].all(1) for side in (1, -1)]
    red = (alpha * clean).max(1) > VISIBLE * np.median(alpha.max(1))
    return np.where(whole[:, None], True, clean & (red & np.logical_or(*edges))[:, None])


def _beyond_valley(alpha: NDArray, x: NDArray, width: float) -> NDArray[np.bool_]:
    """Where, going outward from the line's edge, coverage rises again: another line."""
    beyond = np.zeros(alpha.shape, bool)
    for side in (x >= width / 2, x <= -width / 2):
        outward = np.flatnonzero(side)[:: 1 if x[side][0] > 0 else -1]
        run = alpha[:, outward]
        rises = run - np.minimum.accumulate(run, axis=1) > RISE
        for row in np.flatnonzero(rises.any(1)):
            bottom = int(np.argmin(run[row, : np.argmax(rises[row])]))
            beyond[row, outward[bottom + 1 :]] = True
    return beyond


def _mean_profile(alpha: NDArray, seen: NDArray) -> NDArray[np.float64]:
    """(K,) the pen's own profile: the mean over the line, made symmetric."""
    profile = np.where(seen, alpha, 0.0).sum(0) / np.maximum(seen.sum(0), 1)
    return (profile + profile[::-1]) / 2


def _matched(x: NDArray, alpha: NDArray, seen: NDArray, profile: NDArray) -> NDArray:
    """(M,) the line's offset [px]: the shift of the profile that fits best, with what is seen."""
    basis = np.column_stack([profile, np.gradient(profile, x), np.ones_like(x)])
    fit = alpha @ np.linalg.pinv(basis).T
    for row in np.flatnonzero(seen.any(1) & ~seen.all(1)):
        if seen[row].sum() > 4:
            fit[row] = np.linalg.lstsq(basis[seen[row]], alpha[row, seen[row]], rcond=None)[0]
    scale = np.where(fit[:, 0] > 0.2, fit[:, 0], np.inf)
    return -fit[:, 1] / scale


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
    from scipy.ndimage import gaussian_filter1d

    depth = left[:, np.abs(x) <= MIDDLE_PX].mean(1)
    clear = seen.all(1) & (np.abs(depth) > CLEAR * rough)
    trend = gaussian_filter1d(offset, TREND_PX)
    noise = _spread((offset - trend)[seen.any(1)])
    if clear.sum() < LEAST:
        return offset
    depth, weight = np.where(clear, depth, 1.0), np.where(clear, depth / rough**2, 0.0)
    mean = weight @ left / (weight @ depth)
    mean = (mean + mean[::-1]) / 2
    light = _matched(x, left / depth[:, None], clear[:, None] & seen, mean)
    doubt = rough / np.abs(depth)
    doubt = doubt * _spread(((light - trend) / doubt)[clear])
    share = np.where(clear, noise**2 / (noise**2 + doubt**2), 0.0)
    return offset + share * (light - offset)


def without_ground(x: NDArray, light: NDArray, width: float) -> tuple[NDArray, NDArray]:
    """(M, K) brightness less the ground, and (M,) how rough the ground is."""
    flank = np.abs(x) > width / 2 + FLANK_PX
    line = np.column_stack([np.ones_like(x), x])
    left = light - (line @ np.linalg.pinv(line[flank]) @ light[:, flank].T).T
    return left, np.sqrt((left[:, flank] ** 2).mean(1)) + GREY_LEVELS


def _spread(values: NDArray) -> float:
    """Standard deviation, whatever a few outliers do."""
    return float(np.sqrt(np.median(values**2) / MEDIAN_OF_SQUARE)) + 1e-6


def blur_of(x: NDArray, profile: NDArray, width: float) -> float:
    """Variance of the blur, a pixel's square included, in a line's (K,) mean profile [px²]."""
    weight = np.clip(profile, 0.0, None)
    variance = float((weight * x**2).sum() / max(weight.sum(), 1e-9))
    return max(variance - width**2 / 12, 0.0)


def shading_shift(
    shading: NDArray, fast: NDArray, residual: NDArray, valid: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(M,) correction along the normal, and its doubt, for a background brighter on one side.

    A picture blended in linear light is not linear in its stored values: coverage rises by a power
    below 1 of the light, slower the brighter the ground, whatever the pen. An edge over dark ground
    looks wider than one over bright ground and the line seems to lean to the dark. How much is
    learnt from the picture: the part of the residual that follows the fast changes of `shading`.
    Zero where no such effect stands out; one to the bright side has another cause, as a sharpened
    picture's overshoot cut off at white.

    shading, fast: (M,) the grey's difference across the line, and its part that a smooth line
        cannot follow
    residual, valid: (M,) measured offsets minus the smooth line [px], and where there are any
    """
    power = float(fast @ fast)
    none = np.zeros(len(fast))
    if power < 1e-5 * len(fast):
        return none, none
    slope = float(fast @ residual) / power
    left = residual - slope * fast
    error = np.sqrt(float(left @ left) / max(valid.sum() - 1, 1) / power)
    if SHADING_T * error < -slope < SHADING_MOST:
        return -slope * shading, np.abs(shading) * np.hypot(error, SHADING_DOUBT * slope)
    doubt = min(max(abs(slope), error), SHADING_MOST / 4)
    return none, np.abs(shading) * doubt
