"""Pens that are lifted or pressed less towards an end: how far beyond the ink's half they draw.

A line's coverage, summed across it, is even and then falls evenly, from one place to its end, to
nothing or to what is cut off there. Every such course, and every blunt end, is held against what
was read; how well it fits among all others, by the noise that the best of them leaves, is how
likely it is. Where the point ends, and how surely, is the mean of all of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.path import extended, normals
from vfplan.curve.pen import Pen
from vfplan.curve.profile import Profiles, read_profiles

REACH, AFTER = 45, 14  # px before and beyond the ink's end, and beyond what ended, looked at
BARE = 0.06  # of the usual ink: less is none
COARSE_PX2 = 1.0  # JPEG blurs colour by so much more along a line than across it [px²]
# A fall, in px and in widths, in JPEG as well: less is a blunt end
SHORTEST_PX, SHORTEST = 7.5, 1.7
SLOW_PX = 20.0  # a fall to no point: of a pen pressed less
CUT, STUB = 0.5, 0.05  # of the usual ink: a pressed pen's end; a point's, which is most often less
USUAL = 0.3  # share of the ends that are drawn out, before anything was seen
ALIKE_PX, FAINTEST, INKED = 1.5, 0.015, 3.0  # noise: hangs together; at least; more of it in ink
UNEVEN = 0.04  # a misfit of the usual ink: no point's
PIXEL, NOTHING = 1 / 12, 1e-12  # a pixel's variance [px²]
STEEP, SLANT = 4.0, 0.06  # a cut on a slant falls within so many widths, and lies so far aside


class Point(NamedTuple):
    """What speaks for an end that is drawn out."""

    likely: float  # 0..1
    beyond: float  # where it ends, if it is one, beyond the ink's half [px],
    sigma: float  # and with what standard deviation [px]
    fall: float  # and over how many px its ink falls to there

    @property
    def drawn_out(self) -> bool:
        """Whether it is one rather than not."""
        return self.likely > 0.5

    def surely(self, width: float) -> bool:
        """Whether no cut on a slant through a line of this width looks like it."""
        return self.drawn_out and self.fall >= STEEP * width

    def unsure(self, blunt: float) -> float:
        """Standard deviation of the end [px]; `blunt` px beyond the half if no point."""
        apart, place = self.beyond - blunt, self.drawn_out
        other = 1 - self.likely if place else self.likely
        return float(np.sqrt(self.likely * self.sigma**2 + other * apart**2))


NONE = Point(0.0, 0.0, 0.0, 0.0)


def points_of(
    rgb: NDArray,
    path: NDArray,
    used: NDArray,
    profiles: Profiles,
    pen: Pen,
    inks: tuple[float, float],
) -> tuple[Point, Point]:
    """Both ends of a line whose ink falls to half at rows `inks` of its (M, 2) path.

    The path is carried on as it bends; a row is about a pixel.
    """
    usual = np.median((profiles.alpha * profiles.seen).sum(1)[used])
    cut = profiles.clipped > 0
    lines = (path[::-1], len(path) - 1 - inks[0], cut[::-1]), (path, inks[1], cut)
    return tuple(_point(rgb, *line, profiles, pen, usual) for line in lines)


def _point(
    rgb: NDArray,
    path: NDArray,
    ink: float,
    cut: NDArray,
    profiles: Profiles,
    pen: Pen,
    usual: float,
) -> Point:
    first, width = max(int(ink) - REACH, 0), profiles.width
    if cut[first:].any():
        return NONE
    line = extended(path[first:], (0.0, max(ink + REACH - len(path), 0.0)), width)
    read = read_profiles(rgb, line, normals(line, False), pen, width)
    cover, half = read.alpha * read.seen, ink - first
    mass = cover.sum(1) / usual
    ended = np.flatnonzero(mass[int(half) :] < BARE)
    mass = mass[: int(half) + ended[0] + AFTER] if len(ended) else mass
    point = fitted(mass, half, width, profiles.blur + COARSE_PX2 * profiles.noisy)
    end = half + point.beyond
    fall = cover[int(max(end - point.fall, 0)) : int(end) + 1]
    aside = (fall @ read.x).sum() / max(fall.sum(), BARE * usual)
    slanting = not point.surely(width) and abs(aside) > SLANT * width
    return NONE if slanting else point


def fitted(mass: NDArray, half: float, width: float, blur: float) -> Point:
    """The end of a line of (N,) coverage, in shares of its usual one.

    half: where it falls to one half; width, blur: the line's width and its blur's variance [px²]
    """
    places = np.arange(half - REACH, half + REACH)
    length = places[:, None] - places  # of a fall to (E, 1) ends from (B,) places
    blunt, falling, share = _misfits(mass, places, length, np.sqrt(max(blur, PIXEL)))
    fall = np.where(places[:, None] >= half, length, 0.0)
    point = (fall >= max(SHORTEST_PX, SHORTEST * width)) & (share < CUT)
    slow = (fall >= SLOW_PX) & (share >= CUT)
    least = min(blunt.min(), falling[point | slow].min(initial=np.inf))
    noise = least / len(mass)
    if noise > UNEVEN**2:
        return NONE
    doubt = 2 * ALIKE_PX * max(1.0, blur) * (noise + FAINTEST**2)
    fits = np.exp(np.minimum(least - falling, 0.0) / doubt)
    odds = USUAL * np.where(point, fits * np.exp(-share / STUB), 0.0) / max(point.sum(), 1)
    others = fits[slow].sum() / max(slow.sum(), 1) + np.exp((least - blunt) / doubt).mean()
    weights = odds.sum(1)
    total = max(weights.sum(), NOTHING)
    end = weights @ places / total
    sigma = np.sqrt(weights @ (places - end) ** 2 / total)
    way = end - places[np.argmax(odds.max(0))]
    likely = total / (total + (1 - USUAL) / 2 * others)
    return Point(*map(float, (likely, end - half, sigma, way)))


def _misfits(
    mass: NDArray, places: NDArray, length: NDArray, blur: float
) -> tuple[NDArray, NDArray, NDArray]:
    """The squares that blunt ends at (P,) places leave of (N,) coverage, and those of falls.

    Of (P, P) falls, to one place from another, the best falls to a share of its full ink, and stops
    there. Returns both and the shares; noise is less where there is little ink.
    """
    from scipy.special import ndtr

    weight = 1 / (1 + INKED * np.clip(mass, 0.0, 1.0))
    off = (places[:, None] - np.arange(len(mass))) / blur
    step, y = weight * ndtr(off), weight * mass
    ramp = weight * blur * (off * ndtr(off) + np.exp(-(off**2) / 2) / np.sqrt(2 * np.pi))
    far = np.maximum(length, 1.0)
    cross, own = ramp @ ramp.T, step @ ramp.T
    # Least squares of an even line to its end, and of one that falls evenly to nothing there
    even = (step**2).sum(1)[:, None] + NOTHING
    falls = (np.diag(cross)[:, None] + np.diag(cross) - 2 * cross) / far**2 + NOTHING
    both = (np.diag(own)[:, None] - own) / far
    on_even, on_fall = (step @ y)[:, None], ((ramp @ y)[:, None] - ramp @ y) / far
    det = np.maximum(even * falls - both**2, NOTHING)
    cut = np.maximum((falls * on_even - both * on_fall) / det, 0.0)
    full = (on_fall - cut * both) / falls
    total = y @ y
    blunt = (total - on_even**2 / even)[:, 0]
    return blunt, total - cut * on_even - full * on_fall, cut / np.maximum(cut + full, NOTHING)
