"""The strokes of a review: measured on the pen's ink near a path, and mended by a person.

`vfplan.extract_curve` measures a curve that it finds by itself. Here a person says where the curve
runs. The path is moved onto the ink nearest to it, by the skeleton of the ink, and measured there
as extraction measures.

A measured curve has a point a pixel; nobody wants to drag those. About thirty knots lie on it. A
knot that is moved takes the points between its neighbours along. Every edit returns a new stroke.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.curve import tuned
from vfplan.curve.candidates import box_of, path_through
from vfplan.curve.centreline import (
    deviation_of,
    fit_spline,
    is_noisy,
    onward,
    usual_bend,
    with_sway,
    without_ink_ahead,
)
from vfplan.curve.choose import sudden_changes
from vfplan.curve.coverage import Box, Ink, Pen, Region, find_ink
from vfplan.curve.profiles import find_ends, read_profiles
from vfplan.errors import SettingError
from vfplan.fixture import FLAGS, Stroke
from vfplan.geometry.lines import (
    BEYOND,
    Array,
    Flags,
    Indices,
    arc_lengths,
    distance_to,
    evenly,
    gaussian,
    nearest_to,
    normals,
    running_median,
    runs,
    values_at,
    windows,
)
from vfplan.registration.models import rms

# Points along a line whose median is what is usual there; longer than a branch's mouth.
NEARBY_POINTS = 41

# Length [px] of a place where other ink joins the line, over which the line can be carried.
MAX_BRANCH_PX = 60

# Length [px] from which ink counts as a line that may be the curve.
MIN_LINE_PX = 20.0

# Distance [px] from a drawn line within which its ink is looked for: a click misses by less.
REACH_PX = 8.0

# Distance [px] from the ink within which a path lies once it was moved there.
CLOSE_PX = 3.0

# Distance [px] of neighbours on a skeleton at most, across a pixel's corner.
STEP_OF_BONES_PX = 1.5

# Deviation [px] of a point that a hand placed where there is no ink: a hand is good to a pixel.
HAND_SIGMA_PX = 1.0

# Deviations of a hand from which on an end of ink is no longer sure to be the one that was
# meant. With it all, and without it 98.4 % of 320 ends lie within their bound
# (`docs/make_drawn_bound.py numbers`).
HAND_SIGMAS = 3.0

# Points along a line over which the deviation of a place fades to a hundredth.
FADE_POINTS = 20

# Points of a drawn path over which a line goes from its last ink onto that path.
# The sharpest turn at an end (95 % of those of `docs/make_drawn_bound.py numbers`) is 93 degrees
# with 0 points, 57 with 3, 41 with 6 and 36 with 12.
ONTO_PATH_POINTS = 6

# Points beside a stretch without ink whose profiles that stretch may cut: a pen's width.
BORDER_POINTS = 3

# Deviation [px] that a measured point has at least: upscaled pictures have errors of 0.06 px that
# no scatter along the line shows.
INK_SIGMA_PX = 0.05

# Deviation [px] of the line where other ink joins it and it is carried past.
BRANCH_SIGMA_PX = 0.5

# The same of a ring past its own ends [px].
ENDS_SIGMA_PX = 0.08

# Share of what the ring's ink lacks on one side there, which is added to that deviation. With both,
# of 270 rings whose ends cross or overlap 98 % lie within their bound, by median at 0.5 of it.
LACK_SHARE = 0.2

# Points along a ring whose median width counts where its ends overlap.
OVERLAP_POINTS = 11

# Share of a path that shows ink, from which it is no dotted line: of dots and dashes 0.8 shows.
WITHOUT_GAPS = 0.9

# Steps of a path, from which on it has gone around an end of ink if it is back at one place.
SPUR_STEPS = 6

# Knots of a stroke: few enough to grasp each, enough for every bend that a hand draws.
KNOTS = 30

# Distance [px] from the curve within which a drawn stretch begins or ends on it, and a finding
# belongs to the stretch that was mended.
JOIN_PX = 12.0

# Length [px] of a stroke along which a drawn path runs, and does not merely cross it.
ALONG_PX = 3 * JOIN_PX

# The fields of a stroke that have a value a point.
PER_POINT = ("points", "sigma", *FLAGS, "is_knot")


def faded(offset: NDArray, has_ink: Flags, closed: bool) -> Array:
    """Offsets along a path; beyond the last ink that of the ink goes on, and fades over ten px."""
    from scipy.ndimage import distance_transform_edt

    # A ring lies between two more rounds, so that the way leads through its seam.
    around = len(offset) * closed
    empty = np.pad(~has_ink, around, "wrap")
    distance, (nearest,) = distance_transform_edt(empty, return_indices=True)
    part = slice(around, around + len(offset))
    fade = np.exp(-0.5 * (distance[part] / 10.0) ** 2)
    return offset[nearest[part] % len(offset)] * fade


def past_branches(points: NDArray, joined: Flags, alone: Flags) -> Flags:
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


def without_spurs(path: NDArray, bones: NDArray) -> Array:
    """A closed path (M, 2) without the ends of ink that it goes around, there and back.

    bones: (N, 2) the pixels of the ink's skeleton, of which one is nearest on both ways
    """
    nearest = bones[_core.nearest(bones, path)[1]]
    skipped = np.zeros(len(path), int)
    for step in range(SPUR_STEPS, min(2 * MAX_BRANCH_PX, len(path) // 2)):
        is_back = np.abs(np.roll(nearest, -step, axis=0) - nearest).max(axis=1) <= 1
        skipped[is_back] = step
    if not skipped.any():
        return path
    # From behind the longest one on. The seam is put on the other side of the ring.
    at = first = int(skipped.argmax() + skipped.max())
    kept = []
    while at < first + len(path):
        kept.append(at % len(path))
        at += max(1, int(skipped[kept[-1]]))
    return path[np.roll(kept, len(kept) // 2)]


@dataclass(frozen=True, eq=False)
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

    rgb: NDArray
    colour: str
    exclude: tuple[Box, ...] = ()
    roi: Box | None = None

    @cached_property
    def found(self) -> Ink:
        """The pen's coverage, as extraction has it."""
        region = Region.of(self.roi, self.exclude, self.rgb.shape)
        return find_ink(self.rgb, Pen.of_colour(self.colour), region)

    @cached_property
    def bones(self) -> tuple[Array, Array]:
        """The pixels (N, 2) of the ink's skeleton, and how wide the ink is at each [px]."""
        if not len(self.found.pixels):
            return np.full((1, 2), -1e9), np.ones(1)  # Out of anybody's reach.
        box, corner = box_of(self.found.pixels, 1)
        v, u = np.nonzero(_core.thinned(box))
        to_paper = cv2.distanceTransform(box.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return np.column_stack([u, v]) + corner.astype(float), 2.0 * to_paper[v, u] - 0.25

    def nearest(self, path: NDArray, closed: bool, reach_px: float) -> tuple[Array, Flags, Array]:
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
        distance, index = _core.nearest(places, path)
        across = ((places[index] - path) * normals(path, closed)).sum(axis=1)
        has_ink = distance <= reach_px
        # Ink is a whole number of pixels wide at each place; its mean nearby is the pen's width.
        width = gaussian(width[index], tuned.SMOOTH_PX, BEYOND[closed])
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
            # A pressed pen grows wide slowly, a branch at once.
            nearby = np.full(len(width), usual)
            if has_ink.any():
                nearby[has_ink] = running_median(width[has_ink], NEARBY_POINTS, "edge")
            # The edges of a branch pull the centre before the width shows it.
            wide = width > tuned.WIDE * np.maximum(nearby, usual) + tuned.STEP_PX
            joined = has_ink & binary_dilation(has_ink & wide, iterations=max(1, round(usual)))
            # Where the ends of a ring cross, they enclose a small hole. The ink nearest to the path
            # may be that of either of its sides.
            for run in runs(~joined, True) if closed else ():
                if len(run) <= MAX_BRANCH_PX / 2:
                    joined[run] = True
            alone = has_ink & ~joined
            if alone.sum() < tuned.MIN_PROFILES:
                return drawn_by_hand(path, closed)
            # A spline through what was measured; without ink the path goes on beside it.
            spline = fit_spline(points + offset[:, None] * normal, alone, mass, smooth_px, closed)
            smooth = ((spline(np.arange(len(points))) - points) * normal).sum(axis=1)
            residual = np.where(alone, offset - smooth, 0.0)
            points = points + faded(smooth, alone, closed)[:, None] * normal
            passed = past_branches(points, joined, alone)
        deviation = deviation_of(residual, alone, smooth_px, noisy, BEYOND[closed])
        sigma = np.hypot(deviation, INK_SIGMA_PX)
        # Ink that joins the line, as a letter or the ends of a ring may, pulls the centre aside by
        # at most half of what it adds to the width. It does so at once, and a pressed pen does not.
        lasting = np.where(alone, mass, 1.0)
        wider = running_median(lasting, OVERLAP_POINTS, BEYOND[closed])
        if closed:
            wider = np.maximum(wider, running_median(mass, NEARBY_POINTS, "wrap"))
        is_joined = sudden_changes(lasting.clip(1)).max() > tuned.SUDDEN
        if closed or (is_joined and has_ink.mean() > WITHOUT_GAPS):
            nearby = usual
        sigma = np.hypot(sigma, (usual * wider - nearby).clip(0) / 4)
        if closed:
            # Where it is carried past them, all of its width is ink. What lacks on one side says
            # how far off it may be, and where to move it.
            lack = self.lacking(points, alone, usual)
            carried = np.hypot(ENDS_SIGMA_PX, LACK_SHARE * lack)
            for _ in range(2):
                move = gaussian(np.where(passed, lack, 0.0), tuned.SMOOTH_PX, "wrap")
                points = points + move[:, None] * normals(points, True)
                lack = self.lacking(points, alone, usual)
        else:
            carried = BRANCH_SIGMA_PX
        sigma[passed] = np.hypot(sigma, carried)[passed]
        # A point beside ink that ends, as under a cover, is not confirmed by that ink.
        has_ink = binary_erosion(alone | passed, iterations=BORDER_POINTS, border_value=True)
        sigma[~has_ink] = np.maximum(sigma[~has_ink], HAND_SIGMA_PX)
        sigma = fading(sigma, closed)
        return Stroke(points, closed, sigma, edited=~has_ink, hidden=profiles.hidden)

    def lacking(self, ring: NDArray, alone: Flags, pen_px: float) -> Array:
        """(M,) what a ring's ink lacks on one side [px], with the sign of the other side's normal.

        alone: (M,) the points that no other ink joins, of which half the width is known
        """
        profiles = read_profiles(self.found, ring, normals(ring, True), pen_px)
        # The middle of the line counts by half on either side.
        sides = np.column_stack([np.heaviside(-profiles.x, 0.5), np.heaviside(profiles.x, 0.5)])
        ink = profiles.coverage.clip(0) @ sides * tuned.STEP_PX
        left, right = (np.median(ink[alone]) - ink).clip(0).T
        return left - right

    def draw(self, path: NDArray, closed: bool, reach_px: float, free: tuple[bool, bool]) -> Stroke:
        """Measure a path that a hand drew; a free end near the end of its ink moves there.

        Where ink goes on from there, or other ink joins, the end stays where the hand put it.

        free: whether the (first, last) end is free, and does not lie on another line
        """
        line = self.measure(path, closed, reach_px)
        if closed or not any(free):
            return line
        width = self.width_along(line.points, False)
        moved, _ = self._to_its_ends(line, free, width, reach_px)
        away = _core.nearest(moved.points, self.bones[0])[0] - width / 2 - tuned.EDGE_BLUR_PX
        others = self.bones[0][(away > 0) & (away <= STEP_OF_BONES_PX)]
        away = np.hypot(*(others[:, None] - moved.end_points).T)
        stays = free & (away.min(1, initial=np.inf) <= reach_px)
        line, ends_px = self._to_its_ends(line, tuple(free & ~stays), width, reach_px)
        line = MendedStroke.of(line)
        for end, way in ((1, path), (0, path[::-1])):
            if free[end]:
                line = line.with_drawn_end(way, stays[end], ends_px[end])
            line = line.reversed()
        return line

    def trace(self, path: NDArray, closed: bool) -> Stroke:
        """Measure a line along its skeleton, and carry it on to the ends of its ink."""
        path = np.asarray(path, float)
        if closed:
            path = without_spurs(path, self.bones[0])
        path = gaussian(path, tuned.SMOOTH_PX, BEYOND[closed])
        width = self.width_along(path, closed)
        line = self.measure(path, closed, max(CLOSE_PX, width), width)
        if not closed:
            line, _ = self._to_its_ends(line, (True, True), width, 2 * tuned.TAPER_REACH_PX)
        return bridging(line, line.edited)

    def _to_its_ends(
        self, line: Stroke, free: tuple[bool, bool], width: float, reach_px: float
    ) -> tuple[Stroke, Array]:
        """The line with each free end where its ink ends, if that is within reach.

        Also these ends' deviations along the line [px]; 0 of an end that stays.
        """
        before = onward(line.points[::-1])[::-1]
        carried = np.vstack([before, line.points, onward(line.points)])
        profiles = read_profiles(self.found, carried, normals(carried, False), width)
        valid = without_ink_ahead(profiles.valid)
        if line.edited.all() or valid.sum() < tuned.MIN_PROFILES:
            return line, np.zeros(2)
        ends = find_ends(profiles, valid, is_noisy(self.found, line.points, width))
        known = len(before) + np.array([0.0, len(line.points) - 1])
        found = np.array([end.place for end in ends])
        is_moved = free & ~valid[[0, -1]] & (np.abs(found - known) < reach_px)
        start, stop = np.where(is_moved, found, known)
        if stop - start < tuned.MIN_PROFILES:
            return line, np.zeros(2)
        path = values_at(carried, np.linspace(start, stop, round(stop - start) + 1))
        # Beyond the picture no ink shows where the line ends.
        path = path[((path > -0.5) & (path < self.found.size - 0.5)).all(axis=1)]
        return self.measure(path, False, CLOSE_PX, width), is_moved * [end.sigma for end in ends]

    def with_hidden(self, line: Stroke) -> Stroke:
        """A line of a bundle, with where another colour lies over it."""
        width = self.width_along(line.points, line.closed)
        profiles = read_profiles(self.found, line.points, normals(line.points, line.closed), width)
        return replace(line, hidden=profiles.hidden)

    def width_along(self, path: NDArray, closed: bool) -> float:
        """The usual width of the ink along a path [px]; 3 where there is none."""
        _, has_ink, width = self.nearest(evenly(path, closed), closed, REACH_PX)
        return float(np.median(width[has_ink])) if has_ink.any() else 3.0


def fading(sigma: NDArray, closed: bool) -> Array:
    """Deviations along a line that fall beside a place that is off as its errors do."""
    # So falls the equivalent kernel of a smoothing spline, which carries the errors along.
    steps = np.abs(np.arange(-FADE_POINTS, FADE_POINTS + 1))
    kernel = np.exp(-steps / (np.sqrt(2) * tuned.SMOOTH_NOISY_PX))
    return (windows(sigma, len(kernel), BEYOND[closed]) * kernel).max(axis=1)


def bridging(line: Stroke, gaps: Flags) -> Stroke:
    """The line with these points, which show no ink, as bridges: no hand placed them."""
    bridged = line.bridged | gaps
    sigma = with_sway(replace(line, bridged=gaps), usual_bend(line.points, bridged))
    return replace(line, sigma=sigma, bridged=bridged, edited=line.edited & ~gaps)


def drawn_by_hand(path: NDArray, closed: bool) -> Stroke:
    """The stroke along a path that no ink confirms."""
    points = evenly(path, closed)
    sigma = np.full(len(points), HAND_SIGMA_PX)
    return Stroke(points, closed, sigma, edited=sigma > 0)


def measured(path: NDArray, closed: bool, ink: SliceInk | None, free: tuple[bool, bool]) -> Stroke:
    """The stroke along a path that a hand drew, on its ink where there is any; see `draw`."""
    return drawn_by_hand(path, closed) if ink is None else ink.draw(path, closed, REACH_PX, free)


@dataclass(frozen=True, eq=False, kw_only=True)
class MendedStroke(Stroke):
    """A stroke on the slice, with what a person needs to mend it.

    Parameters
    ----------
    is_knot
        (M,) bool, the points that can be moved.
    """

    is_knot: Flags

    @classmethod
    def of(cls, stroke: Stroke) -> MendedStroke:
        """A stroke with its knots at equal steps of arc.

        One that was drawn as vectors has a deviation of 0.
        """
        sigma = np.zeros(len(stroke.points)) if stroke.sigma is None else stroke.sigma
        is_knot = spread_knots(stroke.points, stroke.closed)
        return cls(**vars(stroke) | {"sigma": sigma, "known_length": None, "is_knot": is_knot})

    @property
    def knots(self) -> Indices:
        """(K,) indices of the points that can be moved, rising."""
        return np.flatnonzero(self.is_knot)

    def move_knot(self, knot: int, to: NDArray, ink: SliceInk | None) -> MendedStroke:
        """Move a knot; the points between its neighbours follow, and are measured again."""
        before, moved, after = self._beside(knot, -1, 0, 1).tolist()
        # A place on the page has four decimals. A knot that is moved by less stays where it is.
        if np.abs(to - self.points[moved]).max() <= 1e-4:
            return self
        # One run of indices, which on a closed stroke may lead through its seam.
        points = self.points[self._run(before, after)]
        middle = (moved - before) % len(self.points)
        arc = arc_lengths(points, False)
        ends = middle == 0, 1, middle == len(points) - 1
        share = np.interp(arc, arc[[0, middle, -1]], ends)
        # The quintic smooth step has no slope and no bend at either end.
        share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        drawn = points + share[:, None] * (to - self.points[moved])
        return self._with_stretch(before, after, drawn, ink, knot_at=drawn[middle])

    def insert_knot(self, at: NDArray) -> MendedStroke:
        """A further knot at the point nearest to a place."""
        nearest = nearest_to(at, self.points)
        if self.is_knot[nearest]:
            raise SettingError(
                f"There is a knot at ({at[0]:z.1f}, {at[1]:z.1f}) already. Choose a place between "
                "two knots.",
                code="knot-exists",
            )
        return replace(self, is_knot=self.is_knot | (np.arange(len(self.points)) == nearest))

    def delete_knot(self, knot: int, ink: SliceInk | None) -> MendedStroke:
        """Draw the stretch between a knot's neighbours anew, without it; an end is cut back."""
        count = len(self.knots)
        if count <= 2 + self.closed:
            text = f"The stroke has {count} knots and needs them. Cut it, or draw it anew."
            raise SettingError(text, code="too-few-knots")
        if not self.closed and knot in (0, count - 1):
            return self.part(self._run(*np.delete(self.knots, knot)[[0, -1]]))
        # The spline through the knots around shows how the line would run without this one.
        around = self._beside(knot, -2, -1, 1, 2).tolist()
        before, after = around[1:3]
        spline = path_through(self.points[list(dict.fromkeys(around))], False)
        first = nearest_to(self.points[before], spline)
        last = nearest_to(self.points[after], spline)
        drawn = np.vstack([self.points[before], spline[first + 1 : last], self.points[after]])
        return self._with_stretch(before, after, drawn, ink)

    def cut(self, start: NDArray | None, end: NDArray | None) -> MendedStroke:
        """Without what lies before the place `start` and behind the place `end`."""
        stroke = self
        if self.closed:
            # A ring is opened at the first cut, so that a single cut leaves all of it.
            first = nearest_to(end if start is None else start, self.points)
            # The point of the seam becomes the first and the last.
            stroke = self.part(self._run(first, first))
        is_opened = self.closed and start is None
        first = 0 if start is None else nearest_to(start, stroke.points)
        last = len(stroke.points) - 1
        if end is not None and not is_opened:
            last = nearest_to(end, stroke.points)
        if last - first < 3:
            raise SettingError(
                "Nothing of the stroke is left between the cuts. The start has to lie before the "
                "end.",
                code="nothing-left",
            )
        return stroke.part(np.arange(first, last + 1))

    def reversed(self) -> MendedStroke:
        """The same line, drawn the other way round."""
        return self._selected(np.arange(len(self.points))[::-1])

    def meets(self, drawn: NDArray) -> bool:
        """Whether a drawn path begins or ends on the stroke, or runs along it."""
        near, index = self._near(drawn)
        return bool(near[0] or near[-1] or (near.any() and np.ptp(index[near]) > ALONG_PX))

    def _near(self, drawn: NDArray) -> tuple[Flags, Indices]:
        """Which points of a path lie on the stroke, and which of its points is nearest to each."""
        distance, index = _core.nearest(self.points, drawn)
        return distance <= JOIN_PX, index

    def redraw(self, drawn: NDArray, ink: SliceInk | None) -> MendedStroke:
        """Put a drawn path in place of the stretch that it overlaps, or carry an end on.

        `drawn` is a (M, 2) path that meets the stroke.
        """
        near, index = self._near(drawn)
        count = len(self.points)
        if near[0] and near[-1]:
            first, last = index[[0, -1]]
            is_turned = first > last
            if self.closed:
                # The ends cut a ring into two parts. The one nearer to the drawing is replaced.
                middle = drawn[len(drawn) // 2]
                forward = distance_to(middle, self.points[self._run(first, last)])
                backward = distance_to(middle, self.points[self._run(last, first)])
                is_turned = backward < forward
            if is_turned:
                first, last, drawn = last, first, drawn[::-1]
            if self.closed and first == last:
                raise SettingError(
                    "The drawn stretch begins and ends at one point of the curve. Let it span a "
                    "part.",
                    code="stretch-too-short",
                )
            stretch = np.vstack([self.points[first], drawn[1:-1], self.points[last]])
            return self._with_stretch(first, last, stretch, ink)
        if self.closed:
            text = "The drawn stretch leaves a closed curve at one end. Let both ends lie on it."
            raise SettingError(text, code="stretch-off-curve")
        if not near[0] and not near[-1]:
            # It comes from elsewhere, runs along the stroke and goes on: it is the stroke now.
            return self._with_stretch(0, count - 1, drawn, ink, free=(True, True))
        if not near[0]:
            near, index, drawn = near[::-1], index[::-1], drawn[::-1]
        # It leaves the stroke in the direction in which it ran along it, else at the nearer end.
        first, last = index[near][[0, -1]]
        goes_on = last > first if abs(last - first) > ALONG_PX else first >= count / 2
        if goes_on:
            stretch = np.vstack([self.points[first], drawn[1:]])
            return self._with_stretch(first, count - 1, stretch, ink, free=(False, True))
        stretch = np.vstack([drawn[:0:-1], self.points[first]])
        return self._with_stretch(0, first, stretch, ink, free=(True, False))

    def join(self, other: MendedStroke, ink: SliceInk | None) -> MendedStroke:
        """Both strokes as one, joined where two of their ends lie nearest."""
        pairs = product((self, self.reversed()), (other, other.reversed()))
        first, second = min(
            pairs, key=lambda pair: np.hypot(*(pair[0].points[-1] - pair[1].points[0]))
        )
        reach = min(10, len(first.points) - 1, len(second.points) - 1)
        last, count = len(first.points) - 1, len(first.points)
        whole = concatenated([first, second], False)
        # A smooth stretch over the gap, from a little before it to a little behind it.
        around = whole.points[[last - reach, last, count, count + reach]]
        around = around[np.r_[True, np.hypot(*np.diff(around, axis=0).T) > 1e-6]]
        path = path_through(around, False)
        joined = whole._with_stretch(last - reach, count + reach, path, ink)
        gaps = joined.edited.copy()
        gaps[: last - reach] = gaps[len(joined.points) - len(second.points) + reach + 1 :] = False
        bridged = bridging(joined, gaps)
        # Without ink nothing asks about bridges, but what a hand drew is told.
        return replace(joined, sigma=bridged.sigma) if ink is None else bridged

    def with_drawn_end(self, path: NDArray, stays: bool, along_px: float) -> MendedStroke:
        """With what a hand knows of the last end: where it drew it along a path, and how well.

        stays: whether it lies where it was drawn, if no ink confirms it. Beyond its confirmed ink a
        line may have been moved onto that of another one.
        along_px: the deviation along the line of an end of ink, 0 of another end
        """
        # Other ink that leads the end away from where the hand put it is not followed.
        is_led_away = stays and np.hypot(*(self.points[-1] - path[-1])) > HAND_SIGMA_PX
        away = np.abs(self.points - self.points[-1]).max(axis=1)
        known = np.flatnonzero(~self.edited & (away >= REACH_PX * is_led_away))
        if not len(known):
            return self
        # Where no ink shows it, the line is as good as the hand was where ink does.
        distance, nearest = _core.nearest(path, self.points[known])
        hand_px = max(HAND_SIGMA_PX, rms(distance))
        stroke, end = self, self.points[known[-1]]
        if stays and np.hypot(*(path[-1] - end)) >= HAND_SIGMA_PX:
            drawn = np.vstack([end, path[nearest[-1] + ONTO_PATH_POINTS : -1], path[-1]])
            stroke = self._with_stretch(known[-1], len(self.points) - 1, drawn, None)
        sigma = stroke.sigma.copy()
        sigma[known[-1] + 1 :] = hand_px
        # An end that moved farther than a hand errs may still lie where the hand put it.
        moved_px = np.hypot(*(stroke.points[-1] - path[-1]))
        is_far = moved_px > HAND_SIGMAS * HAND_SIGMA_PX
        sigma[-1] = max(sigma[-1], along_px or hand_px, is_far * moved_px / 2)
        return replace(stroke, sigma=fading(sigma, False))

    def without_ink_in(self, box: Box) -> MendedStroke:
        """The stroke as if a hand had drawn its part in a box, (u, v, width, height) [px]."""
        low = np.array(box[:2]) - 0.5
        inside = ((self.points >= low) & (self.points <= low + box[2:])).all(axis=1)
        sigma = np.where(inside, np.maximum(self.sigma, HAND_SIGMA_PX), self.sigma)
        return replace(self, sigma=sigma, edited=self.edited | inside)

    def part(self, order: Indices) -> MendedStroke:
        """The open stroke along these points, with a knot at either end."""
        stroke = replace(self._selected(order), closed=False)
        stroke.is_knot[[0, -1]] = True
        return stroke

    def _selected(self, order: Indices) -> MendedStroke:
        """The stroke with these of its points, in this order."""
        return replace(self, **{name: getattr(self, name)[order] for name in PER_POINT})

    def _beside(self, knot: int, *steps: int) -> Indices:
        """The points of the knots so many steps beside one; of an open stroke no further ones."""
        return self.knots.take(knot + np.array(steps), mode="wrap" if self.closed else "clip")

    def _run(self, first: int, last: int) -> Indices:
        """Indices from one point to another, on a closed stroke through its seam if need be."""
        if first < last or (first == last and not self.closed):
            return np.arange(first, last + 1)
        return np.r_[first : len(self.points), 0 : last + 1]

    def _with_stretch(
        self, first: int, last: int, drawn: NDArray, ink: SliceInk | None, *,
        knot_at: NDArray | None = None, free: tuple[bool, bool] = (False, False),
    ) -> MendedStroke:  # fmt: skip
        """The stroke with a drawn path, moved onto its ink, between two of its points.

        `knot_at` is where a knot shall lie on the new stretch; without it knots lie as far apart
        as elsewhere. `free` says whether the first and the last end of the path may move to the end
        of its ink.
        """
        if arc_lengths(drawn, False)[-1] < 1.0:
            raise SettingError(
                "The stretch would be shorter than a pixel. Move the knot elsewhere, or delete it.",
                code="stretch-too-short",
            )
        # Measured: moved onto the ink, and joined to the points on either side.
        line = measured(drawn, False, ink, free)
        count = len(self.points)
        keeps_start = self.closed or first > 0
        keeps_end = self.closed or last < count - 1
        # Shifted so that they meet the curve's points at either end, over eight pixels.
        points = line.points.copy()
        fade = np.exp(-0.5 * (np.arange(len(points)) / 3.0) ** 2)
        if keeps_start:
            points += fade[:, None] * (drawn[0] - points[0])
        if keeps_end:
            points += fade[::-1, None] * (drawn[-1] - points[-1])
        is_knot = spread_knots(points, False, self.length / max(len(self.knots), 1))
        if knot_at is not None:
            is_knot = np.arange(len(points)) == nearest_to(knot_at, points)
            is_knot[[0, -1]] = True
        values = {"points": points, "width": self.width, "is_knot": is_knot}
        stretch = MendedStroke(**vars(line) | values)
        stroke = self
        if self.closed and last <= first:
            # The stretch leads through the seam: the ring is turned, so that it ends at the seam.
            stroke = self._selected(np.r_[last:count, 0:last])
            stretch = stretch._selected(np.arange(len(points) - 1))
            first, last = (first - last) % count, count
        head = stroke._selected(np.arange(first))
        tail = stroke._selected(np.arange(last + 1, count))
        return concatenated([head, stretch, tail], self.closed)


def concatenated(parts: list[MendedStroke], closed: bool) -> MendedStroke:
    """Strokes as one, one behind the other."""
    values = {name: np.concatenate([getattr(part, name) for part in parts]) for name in PER_POINT}
    return replace(parts[0], **values, closed=closed)


def spread_knots(points: NDArray, closed: bool, spacing_px: float | None = None) -> Flags:
    """(M,) bool, points at equal steps of arc; of an open stroke the first and the last too."""
    arc = arc_lengths(points, closed)
    if spacing_px is None:
        spacing_px = arc[-1] / KNOTS
    # Closer than 10 px the handles of knots overlap.
    steps = max(4 if closed else 1, round(arc[-1] / max(spacing_px, 10.0)))
    at = np.linspace(0.0, arc[-1], steps + 1)
    index = np.searchsorted(arc, at[: len(at) - closed] - 1e-9)
    is_knot = np.zeros(len(points), bool)
    is_knot[np.clip(index, 0, len(points) - 1)] = True
    return is_knot
