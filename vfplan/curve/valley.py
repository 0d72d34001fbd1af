"""Whether a line is several lines side by side all along: its profile has a valley.

A single pen's profile has one hill. Two runs 0.5 px apart leave a valley between them, in the
coverage where the picture is clean; JPEG's coarse colour fills it, but its brightness keeps it. A
spiral's turns drift across the path, so the profiles are averaged over short runs, and the median
of all runs speaks for the line. Over single pens of 2 to 14 px, PNG to JPEG 50, both ways of
blending, it measured at most 0.04 of the hill in coverage and 0.06 in brightness; of two and three
lines 0.5 px apart 0.17 and more in coverage (PNG), 0.08 and more in brightness (JPEG).
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.light import LUMINANCE, without_ground
from vfplan.curve.pen import sample_pixels
from vfplan.curve.profile import Profiles

LEAST_PX = 4.0  # narrower is no two lines that could be seen apart
RUN = 24  # points, about a pixel apart
COVERAGE, BRIGHTNESS = (0.08, 0.12), (0.08, 0.16)  # of the hill: doubted, refused
CLEAR = 10.0  # times the ground's roughness over a run: there the brightness counts
LEAST_GREY = 25.0  # levels between line and ground: JPEG's ringing is no valley in more
EDGE_PX = 1.0  # of the line left out of the brightness: a dark outline reaches in so far

Verdict = Literal["single", "doubted", "several"]


def lines_in(
    rgb: NDArray, base: NDArray, normal: NDArray, profiles: Profiles, valid: NDArray, width: float
) -> Verdict:
    """Whether a line measured along a (M, 2) path is one line, as (M,) `valid` profiles show it."""
    if width <= LEAST_PX or valid.sum() < RUN:
        return "single"
    x = profiles.x
    share = _mean(valid.astype(float))
    alpha = np.where(profiles.seen & valid[:, None], profiles.alpha, 0.0)
    mean = _mean(alpha) / np.maximum(share, 1 / RUN)[:, None]
    hill = np.maximum(mean.max(1), 1e-3)
    coverage = float(np.median(_valley(mean[:, np.abs(x) <= width / 2])[valid] / hill[valid]))
    brightness = _by_light(rgb, base[:, None] + normal[:, None] * x[:, None], x, valid, width)
    found = ((coverage, COVERAGE), (brightness, BRIGHTNESS))
    if any(depth > refused for depth, (_, refused) in found):
        return "several"
    return "doubted" if any(depth > doubted for depth, (doubted, _) in found) else "single"


def _by_light(rgb: NDArray, at: NDArray, x: NDArray, valid: NDArray, width: float) -> float:
    """The valley of the brightness less the ground, read at (M, K, 2) places; 0 where unclear."""
    light = sample_pixels(rgb, at[..., 0], at[..., 1]) @ LUMINANCE
    left, rough = without_ground(x, light, width)
    depth = left[:, np.abs(x) <= width / 2].mean(1)
    weight = np.where(valid, depth / rough**2, 0.0)
    power = _mean(weight * depth)
    mean = _mean(weight[:, None] * left) / np.maximum(power, 1e-9)[:, None]
    clear = valid & (power * RUN > CLEAR**2) & (_mean(np.abs(depth)) > LEAST_GREY)
    inner = np.abs(x) <= width / 2 - EDGE_PX
    return float(np.median(_valley(mean[clear][:, inner]))) if clear.sum() >= RUN else 0.0


def _valley(profiles: NDArray) -> NDArray[np.float64]:
    """(M,) how far each of (M, K) profiles sinks between two hills."""
    left = np.maximum.accumulate(profiles, axis=1)
    right = np.maximum.accumulate(profiles[:, ::-1], axis=1)[:, ::-1]
    return (np.minimum(left, right) - profiles).max(1)


def _mean(values: NDArray) -> NDArray[np.float64]:
    """Along the line, over runs of it."""
    from scipy.ndimage import uniform_filter1d

    return uniform_filter1d(values, RUN, axis=0, mode="nearest")
