"""The pen's ink on a slice: what there is, and where a line runs near a path.

`vfplan.extract_curve` measures a curve that it finds by itself. Here a person says where the curve
runs, and the ink close to that path is measured again.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.curve.coverage import find_ink
from vfplan.curve.pen import Pen
from vfplan.curve.region import Box, Region
from vfplan.geometry.polyline import arc_lengths, evenly, normals
from vfplan.review.profiles import (
    SMOOTH_PX,
    is_strong,
    is_valley,
    jumps,
    past_branches,
    smoothed,
    trend_scatter,
    usual_nearby,
)

HUE_GATE_DEG = 32.0
"""Degrees of hue from the pen's at which a pixel shows none of it; magenta is 60 from red."""

CHROMA_FLOOR = 18.0
"""Grey levels (0 to 255) of colour below which nothing is ink: JPEG's noise reaches 12."""

MIN_LINE_PX = 20.0
"""Length [px] from which ink counts as a line, as in `vfplan extract`."""

STEP_PX = 0.5
"""Distance [px] of samples across a path: two a pixel lose nothing of what the picture holds."""

INK_SIGMA_PX = 0.05
"""Deviation [px] that a measured point has at least, which no scatter along the line shows."""

FAINTEST = 0.25
"""Of the pen's usual strength: fainter colour is no ink to move a path to."""

BORDER_POINTS = 3
"""Points beside a stretch without ink whose profiles that stretch may cut: a pen's width."""

CORRELATED = 20.0
"""Factor by which independent noise understates the deviation in JPEG, at most: JPEG's errors hang
together over a block of 8 or, in colour, 16 pixels. It keeps a clean line's deviation small where
the hand's own bends would count as errors.
"""

WIDER = 1.25
"""Of the pen's width: where the ink is wider, other ink joins the line."""

BRANCH_SIGMA_PX = 0.3
"""Deviation [px] of the line where other ink joins it and it is carried past."""

ROUND_END = 0.4
"""Of the pen's width, from half of the ink's fall back to the pen's centre, at a round end."""


@dataclass(frozen=True)
class Measured:
    """A path, moved onto the ink where there is any.

    Parameters
    ----------
    points
        (M, 2) pixels (u, v), about one a pixel.
    sigma
        (M,) standard deviation across the path [px]; meaningless where there is no ink.
    has_ink
        (M,) bool, whether ink was measured there.
    """

    points: NDArray[np.float64]
    sigma: NDArray[np.float64]
    has_ink: NDArray[np.bool_]

    @property
    def is_confirmed(self) -> NDArray[np.bool_]:
        """(M,) bool, whether ink shows the point; not beside ink that ends, as under a cover."""
        from scipy.ndimage import binary_erosion

        return binary_erosion(self.has_ink, iterations=BORDER_POINTS, border_value=True)


class Ink:
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
        self._pen = Pen.of_colour(colour)
        self._region = Region.of(roi, exclude, rgb.shape)

    def without(self, exclude: tuple[Box, ...]) -> Ink:
        """The same ink but for what lies in the boxes."""
        return Ink(self.rgb, self.colour, exclude, self.roi)

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """(H, W) bool, the pixels that are ink, as `vfplan extract` has them."""
        return find_ink(self.rgb, self._pen, self._region).mask

    @cached_property
    def score(self) -> NDArray[np.uint8]:
        """(H, W) how strongly each pixel shows the pen's colour, 0 to 255; grey shows none."""
        picture = self.rgb
        if picture.dtype != np.uint8:
            picture = cv2.convertScaleAbs(picture, alpha=255.0 / np.iinfo(picture.dtype).max)
        # Of a pixel within the hue gate both parts are positive; below 0 the bytes stay at 0.
        slope = 1.0 / np.tan(np.radians(HUE_GATE_DEG))
        along, across = self._pen.along, self._pen.across
        rows = np.array([along - slope * across, along + slope * across])
        parts = cv2.transform(picture, rows)
        score = np.minimum(parts[..., 0], parts[..., 1])
        self._region.clear_outside(score, (slice(0, score.shape[0]), slice(0, score.shape[1])))
        return score

    @cached_property
    def strength(self) -> float:
        """The score in the middle of the pen's line."""
        inked = self.score[self.mask]
        if not len(inked):
            return 255.0
        return float(np.quantile(inked, 0.75))

    def along_path(
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
            (M,) each: how far the line's centre lies off the path along its normal [px], whether
            there is one, and how wide its ink is there [px].
        """
        half = int(np.ceil((2.0 * reach_px + 4.0) / STEP_PX))
        x = np.arange(-half, half + 1) * STEP_PX
        normal = normals(path, closed)
        u = (path[:, :1] + normal[:, :1] * x).astype(np.float32)
        v = (path[:, 1:] + normal[:, 1:] * x).astype(np.float32)
        score = cv2.remap(
            self.score, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0
        ).astype(float)
        # Half of the strongest ink of each profile, as blur does not move a half-height edge.
        threshold = np.maximum(0.5 * score.max(axis=1), max(CHROMA_FLOOR, FAINTEST * self.strength))
        inked = (score > threshold[:, None]) & ~is_valley(score)
        nearest = np.where(inked, np.abs(x), np.inf).argmin(axis=1)
        row = np.arange(len(path))
        has_ink = inked[row, nearest] & (np.abs(x[nearest]) <= reach_px)
        # The run of ink that holds the nearest sample, from its first to its last sample.
        column = np.arange(len(x))
        gap_before = np.maximum.accumulate(np.where(inked, -1, column), axis=1)[row, nearest]
        after = np.where(inked, len(x), column)[:, ::-1]
        gap_after = np.minimum.accumulate(after, axis=1)[:, ::-1][row, nearest]
        width = (gap_after - gap_before - 1) * STEP_PX
        has_ink &= (gap_before >= 0) & (gap_after < len(x))
        has_ink &= is_strong(np.where(inked, score, 0.0).max(axis=1), has_ink)
        # The centroid reads the line's blurred edges as well, alike on both sides, and at most to
        # the middle of the gap to other ink.
        before = np.maximum.accumulate(np.where(inked, column, -len(x)), axis=1)
        before = gap_before - before[row, np.maximum(gap_before, 0)]
        after = np.where(inked, column, 2 * len(x))[:, ::-1]
        after = np.minimum.accumulate(after, axis=1)[:, ::-1]
        after = after[row, np.minimum(gap_after, len(x) - 1)] - gap_after
        edge = np.minimum(round(2.0 / STEP_PX), np.minimum(before, after) // 2)
        first = (gap_before - edge)[:, None]
        last = (gap_after + edge)[:, None]
        own = (column >= first) & (column <= last)
        weight = np.where(own, score, 0.0)
        offset = (weight @ x) / np.maximum(weight.sum(axis=1), 1e-9)
        return np.where(has_ink, offset, 0.0), has_ink, width

    def measure(
        self, path: NDArray, closed: bool, reach_px: float, pen_px: float | None = None
    ) -> Measured:
        """Move a path onto the ink near it; where there is none it stays as it is.

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
        from scipy.ndimage import binary_dilation

        points = path
        for reach in (reach_px, max(0.5 * reach_px, 3.0), 3.0, 3.0):
            points = evenly(points, closed)
            offset, has_ink, width = self.along_path(points, closed, reach)
            if not has_ink.any():
                return _without_ink(path, closed)
            usual = np.median(width[has_ink]) if pen_px is None else pen_px
            joined = has_ink & (width > WIDER * usual_nearby(width, has_ink, usual) + 0.5)
            # The edges of a branch pull the centre before the width shows it.
            joined = has_ink & binary_dilation(joined, iterations=max(1, round(usual)))
            alone = has_ink & ~joined
            alone &= ~jumps(offset, alone)
            if not alone.any():
                return _without_ink(path, closed)
            smooth = smoothed(offset, alone, closed)
            points = points + smooth[:, None] * normals(points, closed)
            points, passed = past_branches(points, joined, alone)
            has_ink = alone | passed
        # Independent noise of this scatter would leave a deviation of `averaged` after smoothing.
        scatter = offset[alone] - smooth[alone]
        noise = 1.4826 * float(np.median(np.abs(scatter)))
        averaged = noise / np.sqrt(2.0 * np.sqrt(np.pi) * SMOOTH_PX)
        deviation = min(trend_scatter(points, alone, closed), CORRELATED * averaged)
        sigma = np.full(len(points), np.hypot(deviation, INK_SIGMA_PX))
        sigma[passed] = BRANCH_SIGMA_PX
        return Measured(points, sigma, has_ink)

    def draw(
        self, path: NDArray, closed: bool, reach_px: float, free: tuple[bool, bool]
    ) -> Measured:
        """Measure a path that a hand drew; a free end near the end of its ink moves there.

        free: whether the (first, last) end is free, and does not lie on another line
        """
        line = self.measure(path, closed, reach_px)
        if closed or not any(free) or not line.has_ink.any():
            return line
        # Straight on from both ends: where the ink ends there, the line was meant to end.
        pen = self.width_along(line.points, False)
        reach = round(reach_px + pen)
        before, after = reach * int(free[0]), reach * int(free[1])
        carried = _carried_on(line.points, before, after)
        _, inked, _ = self.along_path(carried, False, 2.0)
        arc = arc_lengths(carried, False)
        start, stop = arc[before], arc[-1 - after]
        at = arc[inked]
        if len(at) and free[0] and 1.0 < at[0] < 2.0 * reach:
            start = at[0] + ROUND_END * pen
        if len(at) and free[1] and 1.0 < arc[-1] - at[-1] < 2.0 * reach:
            stop = at[-1] - ROUND_END * pen
        if stop - start < 4.0:
            return line
        at = np.linspace(start, stop, round(stop - start) + 1)
        path = np.column_stack([np.interp(at, arc, carried[:, k]) for k in (0, 1)])
        return self.measure(path, False, 3.0, pen)

    def trace(self, path: NDArray, closed: bool) -> Measured:
        """Measure a line along its skeleton, and carry it on to the ends of its ink."""
        from scipy.ndimage import gaussian_filter1d

        mode = "wrap" if closed else "nearest"
        path = gaussian_filter1d(np.asarray(path, float), 2.0, axis=0, mode=mode)
        width = self.width_along(path, closed)
        if not closed:
            path = _carried_on(path, width + 4.0, width + 4.0)
        line = self.measure(path, closed, max(3.0, width), width)
        if closed or not line.has_ink.any():
            return line
        arc = arc_lengths(line.points, False)
        at = arc[line.has_ink]
        back = ROUND_END * width
        if at[-1] - at[0] < 2.0 * back + 4.0:
            return line
        return _part(line, at[0] + back, at[-1] - back)

    def width_along(self, path: NDArray, closed: bool) -> float:
        """The usual width of the ink along a path [px]; 3 where there is none."""
        _, has_ink, width = self.along_path(evenly(path, closed), closed, 8.0)
        return float(np.median(width[has_ink])) if has_ink.any() else 3.0


def _without_ink(path: NDArray, closed: bool) -> Measured:
    """The path as it is."""
    points = evenly(path, closed)
    return Measured(points, np.ones(len(points)), np.zeros(len(points), bool))


def _part(line: Measured, start: float, stop: float) -> Measured:
    """The part of a measured path between two lengths of arc [px]."""
    arc = arc_lengths(line.points, False)
    at = np.linspace(start, stop, max(4, round(stop - start)) + 1)
    nearest = np.clip(np.rint(np.interp(at, arc, np.arange(len(arc)))).astype(int), 0, len(arc) - 1)
    points = np.column_stack([np.interp(at, arc, line.points[:, k]) for k in (0, 1)])
    return Measured(points, line.sigma[nearest], line.has_ink[nearest])


def _carried_on(path: NDArray, before_px: float, after_px: float) -> NDArray[np.float64]:
    """The path with a straight piece of a length at its start and one at its end."""
    reach = min(8, len(path) - 1)
    heading = path[-1] - path[-1 - reach]
    back = path[0] - path[reach]
    heading = heading / max(np.hypot(*heading), 1e-9)
    back = back / max(np.hypot(*back), 1e-9)
    head = np.arange(1.0, before_px + 1.0)[::-1, None] * back + path[0]
    tail = np.arange(1.0, after_px + 1.0)[:, None] * heading + path[-1]
    return np.vstack([head, path, tail])
