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
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.path import normals
from vfplan.curve.profile import Profiles

CLEAN = 0.006  # of coverage beside the line: less, and the colour has no noise of JPEG's
RUN, LEAST_RUN = 4.0, 12  # widths, points: a corner or a blot is shorter
DOUBTED, REFUSED = (1.1, 1.25), (1.3, 1.35)  # in clean pictures, in those with JPEG's noise
BLOT, BLOT_PX, DOT = 4.5, 40.0, 1.35  # widths, px: so short a run, somewhere so wide, is a dot
BLOT_DOUBT = 0.06  # of its width beyond the line's: how far beside its middle the line may run
BESIDE_PX = 0.65  # between two runs: the line midway is 0.3 px off either
OUTLIER = 4.0  # times the line's own spread: a pen that is pressed, or fades, varies all along
BEND_POINTS = 5  # of the path, about a pixel apart
TIGHT = 0.5  # of a bend's radius, a profile's reach: more, and it sees the bend's other side
RISEN = (1.04, 1.05)  # of mass over peak, at least, where the mass alone speaks for two runs


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
    noisy = int(np.median(np.abs(profiles.alpha[:, [0, -1]])) > CLEAN)
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
