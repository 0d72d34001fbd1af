"""The pen's ink on a slice: what there is, and where a line runs near a path.

`vfplan.extract_curve` measures a curve that it finds by itself. Here a person says where the curve
runs. The path is moved onto the ink nearest to it, and measured there as extraction measures.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vfplan.curve import tuned
from vfplan.curve.centreline import deviation_of, fit_spline, is_noisy, onward, without_ink_ahead
from vfplan.curve.coverage import Ink, find_ink, sample
from vfplan.curve.ends import find_ends
from vfplan.curve.pen import Pen
from vfplan.curve.profiles import add_brightness, places_across, read_profiles
from vfplan.curve.region import Box, Region
from vfplan.fixture import Stroke
from vfplan.geometry.polyline import evenly, normals, values_at
from vfplan.review.profiles import (
    faded,
    is_strong,
    is_valley,
    jumps,
    past_branches,
    usual_nearby,
)

MIN_LINE_PX = 20.0
"""Length [px] from which ink counts as a line that may be the curve."""

REACH_PX = 8.0
"""Distance [px] from a drawn line within which its ink is looked for: a click misses by less."""

CLOSE_PX = 3.0
"""Distance [px] from the ink within which a path lies once it was moved there."""

HAND_SIGMA_PX = 1.0
"""Deviation [px] of a point that a hand placed where there is no ink: a hand is good to a pixel."""

BORDER_POINTS = 3
"""Points beside a stretch without ink whose profiles that stretch may cut: a pen's width."""

INK_SIGMA_PX = 0.05
"""Deviation [px] that a measured point has at least: upscaled pictures have errors of 0.06 px that
no scatter along the line shows."""

BRANCH_SIGMA_PX = 0.3
"""Deviation [px] of the line where other ink joins it and it is carried past."""


class SliceInk:
    """The pen's ink on one slice.

    Parameters
    ----------
    rgb
        (H, W, 3) uint8 or uint16, red first.
    colour
        The pen: a CSS colour name or `#rrggbb`.
    exclude
        (u, v, width, height) [px] each: ink in them does not count.
    roi
        (u, v, width, height) [px]: only ink in it counts; `None` for the whole slice.
    """

    def __init__(
        self,
        rgb: NDArray,
        colour: str,
        exclude: tuple[Box, ...] = (),
        roi: Box | None = None,
    ) -> None:
        self.rgb = rgb
        self.colour = colour
        self.roi = roi
        self.exclude = exclude
        self._region = Region.of(roi, exclude, rgb.shape)

    def of_pen(self, colour: str) -> SliceInk:
        """The ink of another pen; raises `SettingError` for no colour."""
        Pen.of_colour(colour)
        return SliceInk(self.rgb, colour, self.exclude, self.roi)

    def without(self, exclude: tuple[Box, ...]) -> SliceInk:
        """The same ink but for what lies in the boxes."""
        return SliceInk(self.rgb, self.colour, exclude, self.roi)

    @cached_property
    def found(self) -> Ink:
        """The pen's coverage, as extraction has it."""
        return find_ink(self.rgb, Pen.of_colour(self.colour), self._region)

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(H, W) bool, the pixels that are ink."""
        return self.found.mask

    def nearest(
        self, path: NDArray, closed: bool, reach_px: float
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
        """Where the ink nearest to a path lies, across it.

        Parameters
        ----------
        path
            (M, 2) pixels, about one a pixel.
        closed
            Whether the last point joins the first.
        reach_px
            How far from the path ink is looked for.

        Returns
        -------
        offset, has_ink, width
            (M,) each: how far the middle of that ink lies off the path along its normal [px],
            whether there is any, and how wide it is there [px].
        """
        half = int(np.ceil((2.0 * reach_px + 2.0 * tuned.FLANK_PX) / tuned.STEP_PX))
        x = np.arange(-half, half + 1) * tuned.STEP_PX
        places = places_across(path, normals(path, closed), x)
        coverage = np.clip(sample(self.found.coverage, *places).astype(float), 0, None)
        # Half of the strongest ink of each profile, as blur does not move a half-height edge.
        threshold = np.maximum(tuned.HALF * coverage.max(axis=1), tuned.VISIBLE)
        inked = (coverage > threshold[:, None]) & ~is_valley(coverage)
        nearest = np.where(inked, np.abs(x), np.inf).argmin(axis=1)
        row = np.arange(len(path))
        has_ink = inked[row, nearest] & (np.abs(x[nearest]) <= reach_px)
        # The run of ink that holds the nearest sample, between two samples without ink.
        column = np.arange(len(x))
        before = np.maximum.accumulate(np.where(inked, -1, column), axis=1)[row, nearest]
        after = np.where(inked, len(x), column)[:, ::-1]
        after = np.minimum.accumulate(after, axis=1)[:, ::-1][row, nearest]
        has_ink &= (before >= 0) & (after < len(x))
        has_ink &= is_strong(np.where(inked, coverage, 0.0).max(axis=1), has_ink)
        offset = (x[np.maximum(before, 0)] + x[np.minimum(after, len(x) - 1)]) / 2
        width = (after - before - 1) * tuned.STEP_PX
        return np.where(has_ink, offset, 0.0), has_ink, width

    def measure(
        self, path: NDArray, closed: bool, reach_px: float, pen_px: float | None = None
    ) -> Stroke:
        """The stroke along the ink near a path; where there is none it stays as it is, edited.

        Parameters
        ----------
        path
            (M, 2) pixels (u, v).
        closed
            Whether the last point joins the first.
        reach_px
            How far from the path ink is looked for at first; then from the path that it gave.
        pen_px
            The pen's width; `None`: as wide as most of the ink along the path.
        """
        from scipy.ndimage import binary_dilation, binary_erosion

        points = path
        for reach in (reach_px, max(0.5 * reach_px, CLOSE_PX), CLOSE_PX, CLOSE_PX):
            points = evenly(points, closed)
            offset, has_ink, width = self.nearest(points, closed, reach)
            if not has_ink.any():
                return drawn_by_hand(path, closed)
            usual = pen_px
            if usual is None:
                usual = float(np.median(width[has_ink]))
            # The edges of a branch pull the centre before the width shows it.
            wide = width > tuned.WIDE * usual_nearby(width, has_ink, usual) + tuned.STEP_PX
            joined = has_ink & binary_dilation(has_ink & wide, iterations=max(1, round(usual)))
            alone = has_ink & ~joined
            alone &= ~jumps(offset, alone)
            noisy = is_noisy(self.found, points, usual)
            smooth_px = tuned.SMOOTH_NOISY_PX if noisy else tuned.SMOOTH_PX
            # Close to the ink it is measured as extraction measures.
            mass = np.ones(len(points))
            if reach == CLOSE_PX and alone.sum() >= tuned.MIN_PROFILES:
                at = np.flatnonzero(alone)
                normal = normals(points, closed)[at]
                profiles = read_profiles(self.found, points[at], normal, usual)
                alone[at] = profiles.valid
                mass[at] = profiles.mass
                offset[at] = profiles.offset(noisy)
                if noisy:
                    offset[at] = add_brightness(
                        self.found, points[at], normal, profiles, offset[at]
                    )
            if alone.sum() < tuned.MIN_PROFILES:
                return drawn_by_hand(path, closed)
            # A spline through what was measured; without ink the path goes on beside it.
            normal = normals(points, closed)
            spline = fit_spline(points + offset[:, None] * normal, alone, mass, smooth_px, closed)
            smooth = ((spline(np.arange(len(points))) - points) * normal).sum(axis=1)
            residual = np.where(alone, offset - smooth, 0.0)
            points = points + faded(smooth, alone, closed)[:, None] * normal
            points, passed = past_branches(points, joined, alone)
        mode = "wrap" if closed else "edge"
        sigma = np.hypot(deviation_of(residual, alone, smooth_px, noisy, mode), INK_SIGMA_PX)
        sigma[passed] = BRANCH_SIGMA_PX
        # A point beside ink that ends, as under a cover, is not confirmed by that ink.
        has_ink = binary_erosion(alone | passed, iterations=BORDER_POINTS, border_value=True)
        sigma[~has_ink] = HAND_SIGMA_PX
        return Stroke(points, closed, sigma, edited=~has_ink)

    def draw(self, path: NDArray, closed: bool, reach_px: float, free: tuple[bool, bool]) -> Stroke:
        """Measure a path that a hand drew; a free end near the end of its ink moves there.

        free: whether the (first, last) end is free, and does not lie on another line
        """
        line = self.measure(path, closed, reach_px)
        if closed or not any(free) or line.edited.all():
            return line
        return self._to_its_ends(line, free, self.width_along(line.points, False), reach_px)

    def trace(self, path: NDArray, closed: bool) -> Stroke:
        """Measure a line along its skeleton, and carry it on to the ends of its ink."""
        from scipy.ndimage import gaussian_filter1d

        mode = "wrap" if closed else "nearest"
        path = gaussian_filter1d(np.asarray(path, float), tuned.SMOOTH_PX, axis=0, mode=mode)
        width = self.width_along(path, closed)
        line = self.measure(path, closed, max(CLOSE_PX, width), width)
        if closed or line.edited.all():
            return line
        return self._to_its_ends(line, (True, True), width, tuned.TAPER_REACH_PX)

    def _to_its_ends(
        self, line: Stroke, free: tuple[bool, bool], width: float, reach_px: float
    ) -> Stroke:
        """The line with each free end where its ink ends, if that is within reach."""
        before = onward(line.points[::-1])[::-1]
        carried = np.vstack([before, line.points, onward(line.points)])
        profiles = read_profiles(self.found, carried, normals(carried, False), width)
        valid = without_ink_ahead(profiles.valid)
        if valid.sum() < tuned.MIN_PROFILES:
            return line
        ends = find_ends(profiles, valid, is_noisy(self.found, line.points, width))
        start, stop = float(len(before)), float(len(before) + len(line.points) - 1)
        if free[0] and not valid[0] and abs(ends[0].place - start) < 2 * reach_px:
            start = ends[0].place
        if free[1] and not valid[-1] and abs(ends[1].place - stop) < 2 * reach_px:
            stop = ends[1].place
        if stop - start < tuned.MIN_PROFILES:
            return line
        at = np.linspace(start, stop, round(stop - start) + 1)
        path = values_at(carried, at)
        return self.measure(path, False, CLOSE_PX, width)

    def width_along(self, path: NDArray, closed: bool) -> float:
        """The usual width of the ink along a path [px]; 3 where there is none."""
        _, has_ink, width = self.nearest(evenly(path, closed), closed, REACH_PX)
        return 3.0 if not has_ink.any() else float(np.median(width[has_ink]))


def drawn_by_hand(path: NDArray, closed: bool) -> Stroke:
    """The stroke along a path that no ink confirms."""
    points = evenly(path, closed)
    count = len(points)
    return Stroke(points, closed, np.full(count, HAND_SIGMA_PX), edited=np.ones(count, bool))
