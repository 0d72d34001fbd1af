"""Where a line is wider than elsewhere: two of its runs side by side would be measured midway.

A pen changes its strength with its opacity and with the ground under it, its width it keeps. So a
place counts as wide by the smaller of two ratios to the line's own median: of the coverage summed
across the line, its mass, and of that sum over the profile's peak. Over curves of 2 to 8 px, bends
down to 3 px, bright bones, opacities of 35 to 100 % and both ways of blending the widest run
measured 1.08 in PNG and 1.17 in JPEG 50 and 75; at corners of 30 to 90 degrees, where a line
touches itself for a few pixels, 1.17 and 1.20. Two runs of a 3 px pen d px apart reach 1 + d/3.

JPEG blurs the profile so that its peak falls with its width, and only the mass still tells: of thin
pens, runs 1 px apart reach 1.3 to 1.5 by their mass and 1.06 to 1.2 over the peak. A mass that
speaks for `BESIDE_PX` is doubted where the other ratio rises at all; a pen that merely grows
stronger does not do that.

Several lines side by side all along are no wider run: their profile has a valley. A single pen's
has one hill. Two runs 0.5 px apart leave a valley between them, in the coverage where the picture
is clean; JPEG's coarse colour fills it, but its brightness keeps it. A spiral's turns drift across
the path, so the profiles are averaged over short runs, and the median of all runs speaks for the
line. Over single pens of 2 to 14 px, PNG to JPEG 50, both ways of blending, it measured at most
0.04 of the hill in coverage and 0.06 in brightness; of two and three lines 0.5 px apart 0.17 and
more in coverage (PNG), 0.08 and more in brightness (JPEG).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.path import normals
from vfplan.curve.profile import Profiles

RUN, LEAST_RUN = 4.0, 12  # widths, points: a corner or a blot is shorter
DOUBTED, REFUSED = (1.1, 1.25), (1.3, 1.35)  # in clean pictures, in those with JPEG's noise
BLOT, BLOT_PX, DOT = 4.5, 40.0, 1.35  # widths, px: so short a run, somewhere so wide, is a dot
BLOT_DOUBT = 0.06  # of its width beyond the line's: how far beside its middle the line may run
BESIDE_PX = 0.65  # between two runs: the line midway is 0.3 px off either
OUTLIER = 4.0  # times the line's own spread: a pen that is pressed, or fades, varies all along
BEND_POINTS = 5  # of the path, about a pixel apart
TIGHT = 0.5  # of a bend's radius, a profile's reach: more, and it sees the bend's other side
RISEN = (1.04, 1.05)  # of mass over peak, at least, where the mass alone speaks for two runs
LEAST_PX = 3.0  # narrower is no two lines that could be seen apart
STRETCH = 24  # points, about a pixel apart
COVERAGE, BRIGHTNESS = (0.08, 0.12), (0.08, 0.16)  # of the hill: doubted, refused
CLEAR = 10.0  # times the ground's roughness over a run: there the brightness counts
LEAST_GREY = 25.0  # levels between line and ground: JPEG's ringing is no valley in more
EDGE_PX = 1.0  # of the line left out of the brightness: a dark outline reaches in so far

Verdict = Literal["single", "doubted", "several"]


@dataclass(frozen=True, eq=False)
class Widening:
    """The widest run of a line."""

    ratio: float  # its width over the line's own median
    place: tuple[float, float]  # (u, v) of its middle [px]
    # Whether this may be, or surely is, no single run of the pen
    doubted: bool
    refused: bool
    # (M,) how far from either run the line may be measured, where it is doubted, or from the line
    # itself in a dot on it [px]; else 0
    doubt: NDArray[np.float64]


def widest_run(
    profiles: Profiles, base: NDArray, valid: NDArray, width: float, closed: bool
) -> Widening:
    """The widest run of 4 widths along a (M, 2) path, where (M,) `valid` says it was seen."""
    from scipy.ndimage import binary_propagation, maximum_filter1d, uniform_filter1d

    seen = np.where(profiles.seen, np.clip(profiles.alpha, 0.0, None), 0.0)
    mass = seen.sum(1)
    across = mass / np.maximum(seen.max(1), 1e-6)
    mass, across = (values / np.median(values[valid]) for values in (mass, across))
    count = min(max(LEAST_RUN, round(RUN * width)), len(base))
    mode = "wrap" if closed else "nearest"
    blots = _blots(np.minimum(mass, across), min(BLOT * width, BLOT_PX))
    in_blots, plain = np.where(blots, BLOT_DOUBT * width * (mass - 1), 0.0), valid & ~blots
    both, mass, across = (
        uniform_filter1d(np.where(plain, values, 1.0), count, mode=mode)
        for values in (np.minimum(mass, across), mass, across)
    )
    noisy = profiles.noisy
    spread = 1.48 * float(np.median(np.abs(mass - np.median(mass))))
    by_mass = (width * (mass - 1) > BESIDE_PX) & (across > RISEN[noisy])
    by_mass &= mass - 1 > OUTLIER * spread
    by_mass &= maximum_filter1d(_turn(base, closed), count, mode=mode) * profiles.x[-1] < TIGHT
    pressed = OUTLIER * 1.48 * float(np.median(np.abs(both - np.median(both))))
    wide = (both - 1 > pressed) & (width * (both - 1) > BESIDE_PX / 2)
    doubted = (wide & (both > DOUBTED[noisy])) | by_mass
    refused = bool((wide & (both > REFUSED[noisy])).any())
    ratio = both if refused else np.where(by_mass, mass, both)
    at = int(np.where(doubted, ratio, 0.0).argmax() if doubted.any() else ratio.argmax())
    place = (float(base[at, 0]), float(base[at, 1]))
    # From where it is doubted on, as far as the mass speaks for it at all.
    aside = width * (np.maximum(ratio, mass) - 1) / 2
    near = binary_propagation(doubted, mask=doubted | (aside > BESIDE_PX / 4))
    doubt = maximum_filter1d(np.where(near, aside, 0.0), count, mode=mode)
    doubt = np.maximum(doubt, in_blots)
    return Widening(float(ratio[at]), place, bool(doubted.any()), refused, doubt)


def _blots(ratio: NDArray, longest: float) -> NDArray[np.bool_]:
    """(M,) what is wide over a short run only: a dot, a glyph, an arrow's head on the line."""
    blots = np.zeros(len(ratio), bool)
    edges = np.flatnonzero(np.diff(np.r_[False, ratio > DOUBTED[0], False].astype(int)))
    for start, stop in edges.reshape(-1, 2):
        blots[start:stop] = stop - start <= longest and ratio[start:stop].max() > DOT
    return blots


def _turn(base: NDArray, closed: bool) -> NDArray[np.float64]:
    """(M,) curvature of the path [1/px], over a few pixels."""
    from scipy.ndimage import uniform_filter1d

    normal = normals(base, closed)
    ahead = np.roll(normal, -1, 0)
    sine = normal[:, 0] * ahead[:, 1] - normal[:, 1] * ahead[:, 0]
    if not closed:
        sine[-1] = 0.0
    return np.abs(uniform_filter1d(sine, BEND_POINTS, mode="wrap" if closed else "nearest"))


def lines_in(profiles: Profiles, valid: NDArray, width: float) -> Verdict:
    """Whether a line is several side by side all along, as its (M,) `valid` profiles show it."""
    if width <= LEAST_PX or valid.sum() < STRETCH:
        return "single"
    x = profiles.x
    share = _mean(valid.astype(float))
    alpha = np.where(profiles.seen & valid[:, None], profiles.alpha, 0.0)
    mean = _mean(alpha) / np.maximum(share, 1 / STRETCH)[:, None]
    hill = np.maximum(mean.max(1), 1e-3)
    coverage = float(np.median(_valley(mean[:, np.abs(x) <= width / 2])[valid] / hill[valid]))
    brightness = _by_light(profiles, valid, width)
    found = ((coverage, COVERAGE), (brightness, BRIGHTNESS))
    if any(depth > refused for depth, (_, refused) in found):
        return "several"
    return "doubted" if any(depth > doubted for depth, (doubted, _) in found) else "single"


def _by_light(profiles: Profiles, valid: NDArray, width: float) -> float:
    """The valley of the brightness less the ground; 0 where unclear."""
    x, left, rough = profiles.x, profiles.light, profiles.rough
    depth = left[:, np.abs(x) <= width / 2].mean(1)
    weight = np.where(valid, depth / rough**2, 0.0)
    power = _mean(weight * depth)
    mean = _mean(weight[:, None] * left) / np.maximum(power, 1e-9)[:, None]
    clear = valid & (power * STRETCH > CLEAR**2) & (_mean(np.abs(depth)) > LEAST_GREY)
    inner = np.abs(x) <= width / 2 - EDGE_PX
    return float(np.median(_valley(mean[clear][:, inner]))) if clear.sum() >= STRETCH else 0.0


def _valley(profiles: NDArray) -> NDArray[np.float64]:
    """(M,) how far each of (M, K) profiles sinks between two hills."""
    left = np.maximum.accumulate(profiles, axis=1)
    right = np.maximum.accumulate(profiles[:, ::-1], axis=1)[:, ::-1]
    return (np.minimum(left, right) - profiles).max(1)


def _mean(values: NDArray) -> NDArray[np.float64]:
    """Along the line, over runs of it."""
    from scipy.ndimage import uniform_filter1d

    return uniform_filter1d(values, STRETCH, axis=0, mode="nearest")
