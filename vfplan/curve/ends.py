"""Where the pen was put down and lifted, by one rule for blunt and tapered ends.

Along the line its ink, the coverage summed across, falls from full to nothing. Where it falls over
a short way, the end is blunt: the centre of the pen's tip lies a part of the width before the place
at which half of the ink is left. Where it falls over a longer way, the pen was drawn out: the fall,
taken on to nothing, says where.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vfplan.curve import tuned


@dataclass(frozen=True)
class Limits:
    """What a picture's noise leaves to see at an end; the numbers are explained in `tuned`."""

    blur_px: float
    flat_width_px: float
    flat_peak: float
    taper_sigma: float


def clean_limits() -> Limits:
    """The limits in a picture whose colour is clean."""
    return Limits(tuned.END_BLUR_PX, tuned.FLAT_WIDTH_PX, tuned.FLAT_PEAK, tuned.TAPER_SIGMA)


def noisy_limits() -> Limits:
    """The limits in a picture whose colour is noisy, as in JPEG."""
    return Limits(
        tuned.END_BLUR_NOISY_PX,
        tuned.FLAT_WIDTH_NOISY_PX,
        tuned.FLAT_PEAK_NOISY,
        tuned.TAPER_SIGMA_NOISY,
    )


@dataclass(frozen=True)
class End:
    """One end of an open line, in points of its path.

    Parameters
    ----------
    place
        The centre of the pen's tip.
    whole
        Up to where profiles across the line are whole.
    sigma
        Standard deviation of the place along the line [px].
    fall
        Pixels over which the ink falls from 0.8 to 0.2.
    width
        Of the pen, close to the end [px].
    tapered
        Whether the pen was drawn out.
    """

    place: float
    whole: float
    sigma: float
    fall: float
    width: float
    tapered: bool


def find_ends(
    mass: NDArray, peak: NDArray, valid: NDArray, width: float, noisy: bool
) -> tuple[End, End]:
    """The first and the last end of a line.

    mass, peak: (M,) ink and largest coverage across a path that reaches beyond both ends
    valid: (M,) bool, where the line was seen
    width: the line's width [px]
    noisy: whether the picture's colour is noisy, as that of JPEG is
    """
    last = len(mass) - 1
    seen = np.flatnonzero(valid)
    first = _find_end(mass[::-1], peak[::-1], last - seen[0], width, noisy)
    first = replace(first, place=last - first.place, whole=last - first.whole)
    return first, _find_end(mass, peak, seen[-1], width, noisy)


def _find_end(mass: NDArray, peak: NDArray, seen: int, width: float, noisy: bool) -> End:
    """The end of the ink beyond `seen`, the last point at which the line was seen."""
    from scipy.ndimage import gaussian_filter1d

    ink = gaussian_filter1d(mass, 0.7)
    # A pressed pen has another width here than elsewhere, and may have rested at the end.
    before = slice(max(seen - tuned.TANGENT_PX, 0), seen + 1)
    last = slice(max(seen - tuned.TANGENT_PX // 2, 0), seen + 1)
    level = max(np.median(ink[before]), 1e-6)
    if ink[last].max() > tuned.WIDE * level:
        level = ink[last].max()
    ink = ink / level
    width = width * level
    high = _crossing(ink, _last_above(ink, 0.8, seen), 0.8)
    half = _crossing(ink, high, 0.5)
    low = _crossing(ink, half, 0.2)
    fall = low - high
    limits = clean_limits()
    if noisy:
        limits = noisy_limits()
    if half - high > tuned.BLUNT_FALL * width + limits.blur_px:
        sigma = limits.taper_sigma * fall
        return End(low + tuned.POINT_SHARE * fall, low, sigma, fall, width, True)
    # Half of the ink is left at the end of a flat tip, whose whole width is half covered there.
    # At a round tip it is left before the end, where half of the width is fully covered.
    left = np.interp(half, np.arange(len(peak)), peak) / max(np.median(peak[before]), 1e-6)
    place = half - tuned.ROUND_SHARE * width
    if width > limits.flat_width_px and left < limits.flat_peak:
        place = half
    sigma = tuned.CAP_SIGMA * min(width, limits.flat_width_px) + 0.2
    return End(place, half, sigma, fall, width, False)


def _last_above(ink: NDArray, level: float, seen: int) -> int:
    above = np.flatnonzero(ink[: seen + 1] >= level)
    if len(above) == 0:
        return int(seen)
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
