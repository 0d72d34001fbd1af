"""What the picture shows across a line, at each point of its path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.curve import tuned
from vfplan.curve.coverage import OTHER_UNIT, Ink, brightness, sample
from vfplan.geometry import filters


@dataclass(frozen=True, eq=False)
class Profiles:
    """Samples across a path of M points, at K places.

    Parameters
    ----------
    x
        (K,) the places across the path [px].
    coverage
        (M, K) of the pen.
    is_line
        (M, K) bool: in the picture, and no ink of a neighbour.
    inside
        (M, K) bool: in the picture.
    mass
        (M,) coverage summed across the line, 1 where it is as usual.
    valid
        (M,) bool: the line was seen.
    hidden
        (M,) bool: another colour lies over it.
    has_other
        (M,) bool: another colour lies over it or touches its edge.
    covered
        (M,) how much of the line's width another colour hides, with the sign of its side [px].
    width
        The line's width [px].
    """

    x: NDArray[np.float64]
    coverage: NDArray[np.float64]
    is_line: NDArray[np.bool_]
    inside: NDArray[np.bool_]
    mass: NDArray[np.float64]
    valid: NDArray[np.bool_]
    hidden: NDArray[np.bool_]
    has_other: NDArray[np.bool_]
    covered: NDArray[np.float64]
    width: float

    @property
    def core(self) -> NDArray[np.bool_]:
        """(K,) the places within the line."""
        return np.abs(self.x) <= self.width / 2

    @property
    def peak(self) -> NDArray[np.float64]:
        """(M,) the largest coverage across the line."""
        return np.where(self.is_line, self.coverage, 0).max(1)

    def offset(self, noisy: bool) -> NDArray[np.float64]:
        """(M,) how far off the path the line lies [px].

        Two measures: the centroid of the line's own ink, and the shift of its mean profile that
        fits best. The centroid follows a pen whose width changes; the shift is less disturbed by
        noise in the flanks. Where colour is noisy the shift counts, else what scatters less.
        """
        ink = np.where(self.is_line, np.clip(self.coverage, 0, None), 0)
        centroid = (ink @ self.x) / np.maximum(ink.sum(1), 1e-6)
        # Another colour hides one side: what shows lies half of its width to the other side.
        centroid = np.where(self.valid, centroid + self.covered / 2, 0.0)
        whole = self.is_line.all(1) & self.valid
        if whole.sum() < tuned.MIN_PROFILES:
            return centroid
        mean = symmetric(self.coverage[whole].mean(0))
        level = np.ones((len(self.x), 1))
        shift = fit_shift(self.x, self.coverage, self.is_line, mean, level)
        clear = self.valid & ~self.hidden & (self.mass > tuned.VISIBLE)
        usable = clear & (np.abs(shift) <= self.width / 2 + 1)
        shift = np.where(usable, shift, centroid)
        if noisy or self._scatter(shift) < self._scatter(centroid):
            return shift
        # The centroid of a line that the picture's border cuts lies too far inside.
        return np.where(usable & ~self.inside[:, self.core].all(1), shift, centroid)

    def _scatter(self, offset: NDArray) -> float:
        """Variance of an offset around its slow changes [px^2], whatever a few outliers do."""
        trend = filters.gaussian(offset, tuned.TREND_PX)
        return float(np.median((offset - trend)[self.valid] ** 2))


def read_profiles(ink: Ink, path: NDArray, normal: NDArray, width: float) -> Profiles:
    """Read the coverage across a (M, 2) path with (M, 2) unit normals."""
    half = np.ceil((width / 2 + tuned.FLANK_PX) / tuned.STEP_PX)
    x = np.arange(-half, half + 1) * tuned.STEP_PX
    u, v = places_across(path, normal, x)
    coverage = sample(ink.coverage, u, v).astype(float)
    other = sample(ink.other, u, v) / OTHER_UNIT
    columns, rows = ink.size
    inside = (u > -0.5) & (u < columns - 0.5) & (v > -0.5) & (v < rows - 0.5)
    is_line = ~_beyond_valley(coverage, x, width)
    mass = np.where(is_line, np.clip(coverage, 0, None), 0).sum(1) * tuned.STEP_PX
    usual = max(float(np.median(mass[inside[:, len(x) // 2]])), 1e-6)
    mass = mass / usual
    core = np.abs(x) <= width / 2 + tuned.STEP_PX
    edge = np.abs(x) <= width / 2 + tuned.EDGE_BLUR_PX
    has_other = (other[:, edge] > tuned.FOREIGN).any(1)
    hidden = (other[:, core] > tuned.FOREIGN).any(1) & (mass < tuned.HIDDEN)
    side = np.sign((other * x)[:, core].sum(1))
    covered = np.where(hidden, side * (1 - mass) * usual, 0.0)
    lowest_mass = np.where(hidden, tuned.HALF, tuned.VISIBLE)
    valid = (mass > lowest_mass) & inside[:, len(x) // 2]
    is_line &= inside
    return Profiles(x, coverage, is_line, inside, mass, valid, hidden, has_other, covered, width)


def symmetric(profile: NDArray) -> NDArray[np.float64]:
    """A (K,) profile and its mirror image, averaged."""
    return (profile + profile[::-1]) / 2


def fit_shift(
    x: NDArray, values: NDArray, is_line: NDArray, mean: NDArray, ground: NDArray
) -> NDArray[np.float64]:
    """(M,) how far a (K,) mean profile is shifted in each row of (M, K) values [px].

    A least-squares fit of the profile, its derivative and a ground (K, G), through the samples that
    are the line's own; 0 where the profile does not show.
    """
    basis = np.column_stack([mean, np.gradient(mean, x), ground])
    fit = values @ np.linalg.pinv(basis).T
    for row in np.flatnonzero(~is_line.all(1)):
        visible = is_line[row]
        if visible.sum() > basis.shape[1]:
            fit[row] = np.linalg.lstsq(basis[visible], values[row, visible], rcond=None)[0]
    height = np.where(fit[:, 0] > tuned.RISE, fit[:, 0], np.inf)
    return -fit[:, 1] / height


def places_across(path: NDArray, normal: NDArray, x: NDArray) -> tuple[NDArray, NDArray]:
    """(M, K) columns u and rows v of the places `x` across a path [px]."""
    return path[:, :1] + normal[:, :1] * x, path[:, 1:] + normal[:, 1:] * x


def _beyond_valley(coverage: NDArray, x: NDArray, width: float) -> NDArray[np.bool_]:
    """Where coverage rises again, outward from the line's edge: the ink of a neighbour."""
    beyond = np.zeros(coverage.shape, bool)
    for side in (1, -1):
        outward = np.flatnonzero(side * x >= width / 2)[::side]
        run = coverage[:, outward]
        rises = run - np.minimum.accumulate(run, axis=1) > tuned.RISE
        for row in np.flatnonzero(rises.any(1)):
            bottom = run[row, : rises[row].argmax()].argmin()
            beyond[row, outward[bottom + 1 :]] = True
    return beyond


def add_brightness(
    ink: Ink, path: NDArray, normal: NDArray, profiles: Profiles, offset: NDArray
) -> NDArray[np.float64]:
    """(M,) offsets with what the brightness adds, which JPEG keeps at full resolution.

    The ground is a straight run from flank to flank. Coverage and brightness count by their own
    noise, so that coverage alone counts where it is clean, and where the ground is rough or as
    bright as the pen.
    """
    x = profiles.x
    light = brightness(ink.rgb, *places_across(path, normal, x))
    flank = np.abs(x) > profiles.width / 2 + tuned.FLANK_PX / 2
    ramp = np.column_stack([np.ones(len(x)), x])
    line = light - light[:, flank] @ np.linalg.pinv(ramp[flank]).T @ ramp.T
    rough = np.sqrt((line[:, flank] ** 2).mean(1)) + 1.0  # Grey levels are whole numbers.
    depth = line[:, ~flank].mean(1)
    clear = profiles.valid & ~profiles.hidden & profiles.is_line.all(1) & (np.abs(depth) > rough)
    if clear.sum() < tuned.MIN_PROFILES:
        return offset
    depth = np.where(clear, depth, 1.0)
    weight = np.where(clear, depth / rough**2, 0.0)
    mean = symmetric(weight @ line / (weight @ depth))
    is_line = profiles.is_line | ~clear[:, None]
    by_light = fit_shift(x, line / depth[:, None], is_line, mean, ramp)
    # Brightness that lies more than half a width off the colour is not the line's.
    clear &= np.abs(by_light - offset) <= profiles.width / 2
    if clear.sum() < tuned.MIN_PROFILES:
        return offset
    trend = filters.gaussian(offset, tuned.TREND_PX)
    colour_variance = np.median((offset - trend)[profiles.valid] ** 2)
    light_variance = (rough / depth) ** 2
    light_variance *= np.median(((by_light - trend) ** 2 / light_variance)[clear])
    # JPEG stores colour at half the resolution, so its noise hangs together over twice the length,
    # and smoothing along the line averages half as much of it.
    light_variance /= 2
    share = np.where(clear, colour_variance / (colour_variance + light_variance), 0.0)
    return offset + share * (by_light - offset)
