"""Where a line was begun and where it was lifted.

A round pen leaves a half disc beyond the centre line's end, one that is cut flat leaves nothing
("butt" caps) or half a square ("square", "projecting" caps). Both are drawn as a model, blurred as
the line itself is, and fitted to the coverage around the end; the evidence for either decides how
far the centre line stops short of the ink. Where the picture cannot tell, the answer lies between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.centreline.profile import Profiles

# How far the ink runs on beyond the centre line's end [px]. A round cap: half a width and a little
# (at these widths), for programs that draw may run on by the last step of the hand, 1 to 2 px. A
# flat cut: butt and square caps look the same, and
# programs overshoot by up to 2 px, so as far as a butt end allows that is to stay within 1.5 px;
# less in blurred pictures, whose ends are less sharp.
EARLY_PX = ((2.2, 3.0), (0.45, 0.75))
FLAT_PX, BLURRED_PX = (1.4, 1.2), (0.6, 0.9)
BETWEEN_PX = 0.2  # half a round cap, as seen in the coverage summed across the line
SURE = 2.0  # log odds for each px of width at which the cap's form is settled
ALIKE = 8.0  # samples of coverage that hang together: interpolated, and JPEG's
BLUR_PX = (0.35, 1.5)  # standard deviation of an edge: a pixel's aperture, JPEG's chroma
SEARCH_PX, STEP_PX = 3.0, 0.1
STRIPS = 24  # of the pen, across the line


@dataclass(frozen=True, eq=False)
class Ends:
    """Where an open line ends, as float indices into the path it was read along.

    Parameters
    ----------
    line
        The centre line's own (first, last) end.
    ink
        Where the coverage summed across the line falls to one half, (first, last).
    """

    line: tuple[float, float]
    ink: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Tip:
    """A pen of which the coverage can be drawn round its end.

    Parameters
    ----------
    y
        (Q,) strips of the pen across the line [px].
    spread
        (Q, K) what each strip adds to the coverage at each place across the line.
    half
        Half the pen's width [px].
    blur
        Standard deviation of the edges [px].
    """

    y: NDArray[np.float64]
    spread: NDArray[np.float64]
    half: float
    blur: float

    @classmethod
    def of_profile(cls, x: NDArray, profile: NDArray, width: float) -> Tip:
        """The pen of `width` px whose blurred coverage at (K,) x has this area and variance."""
        area = max(float(profile.sum()), 1e-9)
        variance = float((profile * x**2).sum()) / area
        blur = float(np.clip(np.sqrt(max(variance - width**2 / 12, 0.0)), *BLUR_PX))
        y = ((np.arange(STRIPS) + 0.5) / STRIPS - 0.5) * width
        spread = np.exp(-(((x - y[:, None]) / blur) ** 2) / 2)
        return cls(y, spread * area / spread.sum(), width / 2, blur)

    def coverage(self, beyond: NDArray, round_cap: bool) -> NDArray[np.float64]:
        """(..., K) coverage at `beyond` (...) px past the ink's end on the centre line."""
        from scipy.special import ndtr

        short = self.half - np.sqrt(self.half**2 - self.y**2) if round_cap else 0.0 * self.y
        return ndtr(-(beyond[..., None] + short) / self.blur) @ self.spread


def line_ends(profiles: Profiles, valid: NDArray, width: float) -> Ends:
    """Both ends of a line read along a path that reaches beyond them, about a point a pixel.

    Parameters
    ----------
    profiles
        What was read across the path.
    valid
        (M,) bool, where the line was seen.
    width
        The line's width [px].
    """
    run = valid[:, None] & profiles.seen
    mean = np.where(run, profiles.alpha, 0.0).sum(0) / np.maximum(run.sum(0), 1)
    tip = Tip.of_profile(profiles.x, np.clip((mean + mean[::-1]) / 2, 0.0, None), width)
    on, last = np.flatnonzero(valid), len(valid) - 1
    stop = _half(profiles.mass, on[-1])
    start = _half(profiles.mass[::-1], last - on[0])
    before = start - _beyond(tip, profiles.alpha[::-1], profiles.seen[::-1], start)
    after = stop - _beyond(tip, profiles.alpha, profiles.seen, stop)
    return Ends((max(last - before, 0.0), min(after, float(last))), (last - start, stop))


def _beyond(tip: Tip, alpha: NDArray, seen: NDArray, ink: float) -> float:
    """How far the ink, which ends near row `ink`, runs on beyond the centre line's end [px]."""
    rows = np.arange(max(0, int(ink - 2 * tip.half - 1)), len(alpha))
    trial = ink + np.arange(-SEARCH_PX, SEARCH_PX + tip.half / 2, STEP_PX)
    costs = []
    for round_cap in (False, True):
        model = tip.coverage(rows - trial[:, None], round_cap)
        costs.append((seen[rows] * (alpha[rows] - model) ** 2).sum((1, 2)))
    flat, disc = costs
    noise = ALIKE * min(flat.min(), disc.min()) / max(seen[rows].sum(), 1)
    odds = (disc.min() - flat.min()) / (2 * noise + 1e-9)
    return _weighed(tip, odds / (2 * tip.half), trial[np.argmin(disc)] - ink)


def _weighed(tip: Tip, odds: float, peak: float) -> float:
    """The cap's length; `odds` > 0 speaks for a flat one, a round one would end `peak` further."""
    flat = float(np.interp(tip.blur, BLURRED_PX, FLAT_PX))
    early = float(np.interp(2 * tip.half, *EARLY_PX))
    round_cap = max(tip.half + early - peak, flat)
    unsure = max(tip.half / 2 - BETWEEN_PX, flat)
    return float(np.interp(odds, [-SURE, 0.0, SURE], [round_cap, unsure, flat]))


def _half(mass: NDArray, at: int) -> float:
    """Where the mass falls to one half, going on from `at`."""
    while at > 0 and mass[at] < 0.5:
        at -= 1
    while at + 1 < len(mass) and mass[at + 1] >= 0.5:
        at += 1
    if at + 1 >= len(mass):
        return float(at)
    return at + (mass[at] - 0.5) / max(mass[at] - mass[at + 1], 1e-9)
