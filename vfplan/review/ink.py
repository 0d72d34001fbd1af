"""The pen's ink on a slice: what there is, and where a line runs near a path.

`vfplan.extract_curve` measures a curve that it finds by itself. Here a person says where the curve
runs. The path is moved onto the ink nearest to it, and measured there as extraction measures.
A profile is a row of samples across the path; `offset` is where the ink's centre lies in it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.curve import tuned
from vfplan.curve.centreline import deviation_of, fit_spline, is_noisy, onward, without_ink_ahead
from vfplan.curve.coverage import Box, Ink, Pen, Region, find_ink
from vfplan.curve.profiles import find_ends, read_profiles
from vfplan.fixture import Stroke
from vfplan.geometry import filters
from vfplan.geometry.lines import evenly, normals, runs, values_at

# Points along a line whose median is what is usual there; longer than a branch's mouth.
NEARBY_POINTS = 41

# Length [px] of a place where other ink joins the line, over which the line can be carried.
MAX_BRANCH_PX = 60


def usual_nearby(width: NDArray, has_ink: NDArray[np.bool_], usual: float) -> NDArray[np.float64]:
    """(M,) the line's usual width nearby: a pressed pen grows wide slowly, a branch at once."""
    from scipy.ndimage import median_filter

    nearby = np.full(len(width), usual)
    nearby[has_ink] = median_filter(width[has_ink], size=NEARBY_POINTS, mode="nearest")
    return np.maximum(nearby, usual)


def faded(offset: NDArray, has_ink: NDArray[np.bool_], closed: bool) -> NDArray[np.float64]:
    """Offsets along a path; beyond the last ink that of the ink goes on, and fades over ten px."""
    from scipy.ndimage import distance_transform_edt

    count = len(offset)
    # Round a ring through its seam.
    empty = np.tile(~has_ink, 3 if closed else 1)
    distance, (nearest,) = distance_transform_edt(empty, return_indices=True)
    part = slice(count, 2 * count) if closed else slice(None)
    return offset[nearest[part] % count] * np.exp(-0.5 * (distance[part] / 10.0) ** 2)


def past_branches(
    points: NDArray, joined: NDArray[np.bool_], alone: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Carry the points past every place where other ink joins the line; which were carried.

    There the centre of the ink is not that of the line. The line goes on as on both sides.
    """
    from scipy.interpolate import CubicSpline

    passed = np.zeros(len(points), bool)
    at = np.flatnonzero(alone)
    for run in runs(~alone, False):
        before, after = at[at < run[0]][-13::4], at[at > run[-1]][:13:4]
        is_branch = joined[run].mean() > 0.5 and len(run) <= MAX_BRANCH_PX
        if is_branch and len(before) >= 2 and len(after) >= 2:
            known = np.r_[before, after]
            points[run] = CubicSpline(known, points[known])(run)
            passed[run] = True
    return passed


# Length [px] from which ink counts as a line that may be the curve.
MIN_LINE_PX = 20.0

# Distance [px] from a drawn line within which its ink is looked for: a click misses by less.
REACH_PX = 8.0

# Distance [px] from the ink within which a path lies once it was moved there.
CLOSE_PX = 3.0

# Deviation [px] of a point that a hand placed where there is no ink: a hand is good to a pixel.
HAND_SIGMA_PX = 1.0

# Points beside a stretch without ink whose profiles that stretch may cut: a pen's width.
BORDER_POINTS = 3

# Deviation [px] that a measured point has at least: upscaled pictures have errors of 0.06 px that
# no scatter along the line shows.
INK_SIGMA_PX = 0.05

# Deviation [px] of the line where other ink joins it and it is carried past.
BRANCH_SIGMA_PX = 0.5


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
        self, rgb: NDArray, colour: str, exclude: tuple[Box, ...] = (), roi: Box | None = None
    ) -> None:
        self.rgb, self.colour, self.exclude, self.roi = rgb, colour, exclude, roi
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

    @cached_property
    def bones(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The pixels (N, 2) of the ink's skeleton, and how wide the ink is at each [px]."""
        mask = self.found.mask.view(np.uint8)
        left, top, width, height = cv2.boundingRect(mask)
        part = np.pad(mask[top : top + height, left : left + width], 1)
        v, u = np.nonzero(_core.thinned(part.view(bool)))
        to_paper = cv2.distanceTransform(part, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[v, u]
        return np.column_stack([u + left - 1.0, v + top - 1.0]), 2.0 * to_paper - 0.25

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
        places, width = self.bones
        if not len(places):
            return np.zeros(len(path)), np.zeros(len(path), bool), np.zeros(len(path))
        distance, index = _core.nearest(places, path)
        across = ((places[index] - path) * normals(path, closed)).sum(axis=1)
        has_ink = distance <= reach_px
        # Ink is a whole number of pixels wide at each place; its mean nearby is the pen's width.
        width = filters.gaussian(width[index], tuned.SMOOTH_PX, "wrap" if closed else "edge")
        return np.where(has_ink, across, 0.0), has_ink, width

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
            usual = float(np.median(width[has_ink])) if pen_px is None else pen_px
            noisy = is_noisy(self.found, points, usual)
            smooth_px = tuned.SMOOTH_NOISY_PX if noisy else tuned.SMOOTH_PX
            # Close to the ink it is measured as extraction measures.
            normal, mass = normals(points, closed), np.ones(len(points))
            if reach == CLOSE_PX:
                profiles = read_profiles(self.found, points, normal, usual)
                has_ink, mass = has_ink & profiles.valid, profiles.mass
                width = usual * mass
                offset = profiles.offset(self.found, points, normal, noisy)
            # The edges of a branch pull the centre before the width shows it.
            wide = width > tuned.WIDE * usual_nearby(width, has_ink, usual) + tuned.STEP_PX
            joined = has_ink & binary_dilation(has_ink & wide, iterations=max(1, round(usual)))
            alone = has_ink & ~joined
            if alone.sum() < tuned.MIN_PROFILES:
                return drawn_by_hand(path, closed)
            # A spline through what was measured; without ink the path goes on beside it.
            spline = fit_spline(points + offset[:, None] * normal, alone, mass, smooth_px, closed)
            smooth = ((spline(np.arange(len(points))) - points) * normal).sum(axis=1)
            residual = np.where(alone, offset - smooth, 0.0)
            points = points + faded(smooth, alone, closed)[:, None] * normal
            passed = past_branches(points, joined, alone)
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
        if not closed and not line.edited.all():
            line = self._to_its_ends(line, (True, True), width, tuned.TAPER_REACH_PX)
        # No hand placed what shows no ink.
        return replace(line, bridged=line.edited, edited=None)

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
        path = values_at(carried, np.linspace(start, stop, round(stop - start) + 1))
        return self.measure(path, False, CLOSE_PX, width)

    def width_along(self, path: NDArray, closed: bool) -> float:
        """The usual width of the ink along a path [px]; 3 where there is none."""
        _, has_ink, width = self.nearest(evenly(path, closed), closed, REACH_PX)
        return float(np.median(width[has_ink])) if has_ink.any() else 3.0


def drawn_by_hand(path: NDArray, closed: bool) -> Stroke:
    """The stroke along a path that no ink confirms."""
    points = evenly(path, closed)
    count = len(points)
    return Stroke(points, closed, np.full(count, HAND_SIGMA_PX), edited=np.ones(count, bool))


def measured(path: NDArray, closed: bool, ink: SliceInk | None, free: tuple[bool, bool]) -> Stroke:
    """The stroke along a path that a hand drew, on its ink where there is any; see `draw`."""
    return drawn_by_hand(path, closed) if ink is None else ink.draw(path, closed, REACH_PX, free)
