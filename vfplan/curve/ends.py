"""Where the pen was put down and lifted, by one rule for blunt and tapered ends.

Along the line its ink, the coverage summed across, falls from full to nothing. Straight falls of
many lengths and places are held against it, and each counts by how well it fits. A short fall is
a blunt end: the centre of the pen's tip lies a part of the width before the place at which half of
the ink is left. A long fall is a pen that was drawn out, and the fall's foot is its point. Where
both fit, the end lies between them, and its deviation says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vfplan.curve import tuned
from vfplan.curve.profiles import Profiles, symmetric

FALLS_PX = np.array([1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 10, 12, 14, 17, 20, 24, 29, 35, 42])
"""Pixels: lengths of the falls that are held against the ink."""
FOOT_STEP_PX = 0.5
"""Pixels between the places that are tried for the foot of a fall."""
GAUSSIAN_WIDTH = 2.09
"""Width of a Gaussian at half of its height, over the way on which it falls from 0.8 to 0.2."""


@dataclass(frozen=True)
class End:
    """One end of an open line, in points of its path.

    Parameters
    ----------
    place
        The centre of the pen's tip, or the point of a pen that was drawn out.
    whole
        Up to where profiles across the line are whole.
    sigma
        Standard deviation of the place along the line [px].
    fall
        Pixels over which the ink of a drawn out pen falls from full to nothing; 0 of a blunt end.
    """

    place: float
    whole: float
    sigma: float
    fall: float


@dataclass(frozen=True)
class Run:
    """What a line shows along itself towards one end, which is the last of its N points.

    Parameters
    ----------
    mass
        (N,) ink across the line.
    coverage
        (N, K) across the line, at the places `x`.
    x
        (K,) [px].
    seen
        The last point at which the line was seen.
    width
        Of the pen's tip [px]: the line's width without what blur adds to it.
    edge
        Pixels over which the line's edge falls from 0.8 to 0.2 of its height.
    noisy
        Whether the picture's colour is noisy, as that of JPEG is.
    """

    mass: NDArray[np.float64]
    coverage: NDArray[np.float64]
    x: NDArray[np.float64]
    seen: int
    width: float
    edge: float
    noisy: bool


def find_ends(profiles: Profiles, valid: NDArray[np.bool_], noisy: bool) -> tuple[End, End]:
    """The first and the last end of a line.

    profiles: read across a path of M points that reaches beyond both ends
    valid: (M,) bool, where the line was seen
    noisy: whether the picture's colour is noisy, as that of JPEG is
    """
    seen = np.flatnonzero(valid)
    last = len(valid) - 1
    width, edge = _width_and_edge(profiles, valid)
    forwards = Run(
        mass=profiles.mass,
        coverage=profiles.coverage,
        x=profiles.x,
        seen=int(seen[-1]),
        width=width,
        edge=edge,
        noisy=noisy,
    )
    backwards = replace(
        forwards,
        mass=profiles.mass[::-1],
        coverage=profiles.coverage[::-1],
        seen=int(last - seen[0]),
    )
    first = _find_end(backwards)
    first = replace(first, place=last - first.place, whole=last - first.whole)
    return first, _find_end(forwards)


def _width_and_edge(profiles: Profiles, valid: NDArray[np.bool_]) -> tuple[float, float]:
    """The pen's width without blur, and over how much its edge falls from 0.8 to 0.2 [px].

    Half of the usual profile's height is as wide as the pen only while the pen is broader than the
    blur. A line that is all blur, a Gaussian, is 2.09 times as wide there as its edge. The fourth
    powers are subtracted, as a pen that is narrower than the blur shows in the fourth order.
    """
    usual = symmetric(np.median(profiles.coverage[valid], axis=0))[len(profiles.x) // 2 :]
    usual = usual / max(float(usual.max()), 1e-6)
    high = _crossing(usual, int(usual.argmax()), 0.8)
    edge = (_crossing(usual, high, 0.2) - high) * tuned.STEP_PX
    width = 2 * _crossing(usual, high, 0.5) * tuned.STEP_PX
    blurred = GAUSSIAN_WIDTH * edge
    sharp = max(width**4 - blurred**4, 0.0) ** 0.25
    return max(sharp, 1.0), edge  # No picture shows a line narrower than its pixels.


def _find_end(run: Run) -> End:
    from scipy.ndimage import gaussian_filter1d

    # A pressed pen has another width here than elsewhere, and may have rested at the end. Where it
    # rested the ink is a disc, broader than the line.
    ink = gaussian_filter1d(run.mass, 0.7)
    before = ink[max(run.seen - tuned.TANGENT_PX, 0) : run.seen + 1]
    level = max(float(np.median(before)), 1e-6)
    highest = before[-tuned.TANGENT_PX // 2 :].max()
    rested = highest > tuned.WIDE * min(level, 1.0)
    if rested:
        level = highest
    ink = ink / level
    width = run.width * level
    high = _crossing(ink, _last_above(ink, 0.8, run.seen), 0.8)
    half = _crossing(ink, high, 0.5)
    low = _crossing(ink, half, 0.2)

    # The longest fall that a blunt end shows: the round of the tip, and what blurs it.
    blunt = tuned.BLUNT_PX + tuned.BLUNT_EDGES * run.edge + tuned.BLUNT_SHARE * run.width
    blunt += tuned.BLUNT_ROUGH_PX * _roughness(run)
    noise = tuned.INK_NOISE
    if run.noisy:
        noise = tuned.INK_NOISE_NOISY
    tapered = _taper_share(FALLS_PX, blunt)
    if not run.noisy:  # The ink close by is plain to see, and a pressed pen ends at once there.
        tapered = np.minimum(tapered, _taper_share((half - high) / 0.3, blunt))

    # Each foot and each length of the fall counts by how well it fits the ink.
    foot = np.arange(half - 1, half + FALLS_PX[-1] / 2, FOOT_STEP_PX)[:, None]
    likely = _likelihood(ink, low, foot, noise) * (1 - (1 - tuned.TAPER_PRIOR) * tapered)
    likely = likely / likely.sum()
    flat, tip = 0.0, 1.0
    if not rested:
        flat, tip = _tip_shape(run, width)
    back = tuned.ROUND_SHARE * width * tip
    blunt_half = np.clip(foot - FALLS_PX / 2, high, low)
    blunt_place = blunt_half - back * (1 - flat)
    place = tapered * foot + (1 - tapered) * blunt_place
    mean = float((likely * place).sum())
    variance = (place - mean) ** 2 + tapered * (1 - tapered) * (foot - blunt_place) ** 2
    variance = float((likely * variance).sum())
    variance += flat * (1 - flat) * back**2
    sigma = tuned.END_SIGMA_PX + tuned.END_SIGMA_SHARE * min(width, tuned.FLAT_WIDTH_PX)
    whole = half
    if (likely * tapered).sum() > tuned.HALF:
        whole = _crossing(ink, half, 3 * noise)
    fall = float((likely * tapered * FALLS_PX).sum())
    return End(mean, whole, float(np.sqrt(variance + sigma**2)), fall)


def _taper_share(fall: NDArray | float, blunt: float) -> NDArray | float:
    """How far falls of the ink are a drawn out pen's: 0 to 1, where `blunt` is a blunt end's."""
    return np.clip((fall / blunt - 1) / (tuned.TAPER_TIMES - 1), 0, 1)


def _likelihood(ink: NDArray, low: float, foot: NDArray, noise: float) -> NDArray[np.float64]:
    """(F, L) how likely a fall with each foot (F, 1) and length is, of ink with a noise.

    All of them add up to 1. The height from which the ink falls is fitted, and so is an even slope
    before, as of a pen that is pressed less and less.
    """
    first = max(int(low - FALLS_PX[-1]), 0)
    at = np.arange(first, min(int(low) + tuned.SUDDEN_PX, len(ink)))
    shown = ink[at]
    ahead = foot[..., None] - at
    fall = np.clip(ahead / FALLS_PX[:, None], 0, 1)
    slope = np.maximum(ahead - FALLS_PX[:, None], 0)
    # Least squares for the height and the slope; a steep slope is less likely by itself.
    spread = tuned.INK_HANGS_PX * noise**2
    prior = spread / tuned.INK_SLOPE**2
    ff, fs, ss = (fall**2).sum(2) + 1e-9, (fall * slope).sum(2), (slope**2).sum(2) + prior
    fy, sy = fall @ shown, slope @ shown
    determinant = ff * ss - fs**2
    height = (ss * fy - fs * sy) / determinant
    steep = (ff * sy - fs * fy) / determinant
    misfit = shown - height[..., None] * fall - steep[..., None] * slope
    squares = (misfit**2).sum(2) + prior * steep**2
    spread = max(spread, tuned.INK_HANGS_PX * squares.min() / len(at))
    likely = np.exp((squares.min() - squares) / (2 * spread))
    return likely / likely.sum()


def _roughness(run: Run) -> float:
    """How much the ink varies from point to point, 0 to 1, which noise alone does."""
    from scipy.ndimage import gaussian_filter1d

    inner = run.mass[tuned.TAPER_REACH_PX : run.seen + 1]
    return 1.5 * float(np.median(np.abs(inner - gaussian_filter1d(inner, tuned.TREND_PX / 2))))


def _tip_shape(run: Run, width: float) -> tuple[float, float]:
    """How flat the tip is, 0 to 1, and how far a round one reaches, over that of a half disc.

    A round tip ends earlier at its sides than in its middle, a tip that was cut off square does
    not. A tip whose disc is smaller than the line is broad, as OpenCV draws it, falls back farther.
    Both sides are averaged, so that a line that does not leave its tip at a right angle looks the
    same. Thin pens do not show it.
    """
    middle = _end_of_band(run, np.abs(run.x) <= 0.15 * width + tuned.STEP_PX / 2)
    sides = []
    for side in (1, -1):
        at = side * run.x
        sides.append(_end_of_band(run, (at >= 0.3 * width) & (at <= 0.42 * width)))
    if middle is None or None in sides:
        return 0.0, 1.0
    from_width = tuned.FLAT_WIDTH_PX
    if run.noisy:
        from_width = tuned.FLAT_WIDTH_NOISY_PX
    shows = float(np.clip((width - from_width) / tuned.FLANK_PX, 0, 1))
    falls_back = max((middle - np.mean(sides)) / width, 1e-6)
    flat = float(np.clip(2 - falls_back / tuned.ROUND_BACK, 0, 1))
    # The disc through the middle of the tip and both sides, which lie 0.36 widths off it.
    radius = np.clip((0.36**2 + falls_back**2) / (2 * falls_back), 0.25, 0.5)
    # Half of the line's ink is left where the disc is half as broad as the line.
    tip = np.sqrt((radius**2 - 0.25**2) / (0.5**2 - 0.25**2))
    return flat * shows, float(1 - (1 - tip) * shows)


def _end_of_band(run: Run, band: NDArray[np.bool_]) -> float | None:
    """Where half of the ink is left in a band along the line; `None` in an empty band."""
    from scipy.ndimage import gaussian_filter1d

    if not band.any():
        return None
    ink = gaussian_filter1d(run.coverage[:, band].mean(1), 0.5)
    before = ink[max(run.seen - tuned.TANGENT_PX, 0) : max(run.seen - 3, 1)]
    ink = ink / max(float(np.median(before)), 1e-6)
    return _crossing(ink, _last_above(ink, 0.8, run.seen), 0.5)


def _last_above(ink: NDArray, level: float, seen: int) -> int:
    above = np.flatnonzero(ink[: seen + 1] >= level)
    if len(above) == 0:
        return seen
    return int(above[-1])


def _crossing(ink: NDArray, start: float, level: float) -> float:
    """Where the ink first falls below a level, from `start` on."""
    first = int(start)
    below = np.flatnonzero(ink[first:] < level)
    if len(below) == 0:
        return float(len(ink) - 1)
    k = first + int(below[0])
    if k == first:
        return float(start)
    return k - (level - ink[k]) / max(ink[k - 1] - ink[k], 1e-9)
