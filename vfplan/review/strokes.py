"""A stroke that a person can mend: its points, and the knots by which they are moved.

A measured curve has a point a pixel; nobody wants to drag those. About thirty knots lie on it. A
knot that is moved takes the points between its neighbours along. Every edit returns a new stroke.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError
from vfplan.fixture import Stroke
from vfplan.geometry.lines import arc_lengths, evenly, ring_of, runs
from vfplan.review.ink import SliceInk, measured

Array = NDArray[np.float64]


def path_through(clicks: NDArray, closed: bool) -> Array:
    """The cubic spline through places, at about one point a pixel.

    Its parameter is the length of the polygon through the places, as clicks lie unevenly; two
    places give a straight line.
    """
    from scipy.interpolate import CubicSpline

    clicks = np.asarray(clicks, float)
    if len(clicks) == 2:
        return evenly(clicks, False)
    arc = arc_lengths(clicks, closed)
    ends = "periodic" if closed else "natural" if len(clicks) == 3 else "not-a-knot"
    spline = CubicSpline(arc, ring_of(clicks, closed), bc_type=ends)
    dense = spline(np.linspace(0.0, arc[-1], 4 * max(2, round(arc[-1])) + 1))
    return evenly(dense[:-1] if closed else dense, closed)


def nearest_point(points: NDArray, place: NDArray) -> tuple[int, float]:
    """Which point is nearest to a place, and how far off it is [px]."""
    distance = np.hypot(*(points - np.asarray(place, float)).T)
    nearest = int(distance.argmin())
    return nearest, float(distance[nearest])


# Knots of a stroke: few enough to grasp each, enough for every bend that a hand draws.
KNOTS = 30

# Distance [px] of neighbouring knots on a short stroke: less, and their handles overlap.
MIN_KNOT_SPACING_PX = 10.0

# Distance [px] from the curve within which a drawn stretch begins or ends on it, and a finding
# belongs to the stretch that was mended.
JOIN_PX = 12.0

# Length [px] of a stroke along which a drawn path runs, and does not merely cross it.
ALONG_PX = 3 * JOIN_PX

# A place on the page has four decimals. A knot that is moved by less stays where it is.
SAME_PLACE_PX = 1e-4

# The fields of a stroke that have a value a point.
PER_POINT = ("points", "sigma", "bridged", "edited")


@dataclass(frozen=True, eq=False, kw_only=True)
class MendedStroke(Stroke):
    """A stroke on the slice, with what a person needs to mend it.

    Parameters
    ----------
    knots
        (K,) indices of the points that can be moved, rising.
    """

    knots: NDArray[np.int64]

    @classmethod
    def of(cls, stroke: Stroke) -> MendedStroke:
        """A stroke with its knots at equal steps of arc.

        One that was drawn as vectors has a deviation of 0.
        """
        sigma = np.zeros(len(stroke.points)) if stroke.sigma is None else stroke.sigma
        return cls(
            points=np.array(stroke.points, float),
            closed=stroke.closed,
            sigma=np.array(sigma, float),
            bridged=stroke.bridged,
            edited=stroke.edited,
            width=stroke.width,
            knots=spread_knots(stroke.points, stroke.closed),
        )

    @property
    def knots_px(self) -> NDArray[np.float64]:
        """(K, 2) where the knots lie."""
        return self.points[self.knots]

    def move_knot(self, knot: int, to: NDArray, ink: SliceInk | None) -> MendedStroke:
        """Move a knot; the points between its neighbours follow, and are measured again."""
        before, moved, after = self._around(knot)
        if np.abs(to - self.points[moved]).max() <= SAME_PLACE_PX:
            return self
        # One run of indices, which on a closed stroke may lead through its seam.
        run = self._run(before, after)
        points = self.points[run]
        middle = (moved - before) % len(self.points)
        arc = arc_lengths(points, False)
        share = np.ones(len(points))
        if middle > 0:
            share[: middle + 1] = _eased(arc[: middle + 1] / arc[middle])
        if middle < len(points) - 1:
            behind = arc[middle:] - arc[middle]
            share[middle:] = _eased(1.0 - behind / behind[-1])
        drawn = points + share[:, None] * (to - self.points[moved])
        return self._with_stretch(before, after, drawn, ink, knot_at=drawn[middle])

    def insert_knot(self, at: NDArray) -> MendedStroke:
        """A further knot at the point nearest to a place."""
        nearest, _ = nearest_point(self.points, at)
        if nearest in self.knots:
            text = (
                f"There is a knot at ({at[0]:.1f}, {at[1]:.1f}) already. Choose a place between "
                "two knots."
            )
            raise SettingError(text, code="knot-exists")
        return replace(self, knots=np.sort(np.append(self.knots, nearest)))

    def delete_knot(self, knot: int, ink: SliceInk | None) -> MendedStroke:
        """Draw the stretch between a knot's neighbours anew, without it; an end is cut back."""
        count = len(self.knots)
        if count <= (3 if self.closed else 2):
            text = f"The stroke has {count} knots and needs them. Cut it, or draw it anew."
            raise SettingError(text, code="too-few-knots")
        if not self.closed and knot == 0:
            return self.part(int(self.knots[1]), len(self.points))
        if not self.closed and knot == count - 1:
            return self.part(0, int(self.knots[-2]) + 1)
        before, _, after = self._around(knot)
        # The spline through the knots around shows how the line would run without this one.
        wanted = (knot - 2, knot - 1, knot + 1, knot + 2)
        if self.closed:
            around = list(dict.fromkeys(k % count for k in wanted))
        else:
            around = [k for k in wanted if 0 <= k < count]
        spline = path_through(self.knots_px[around], False)
        first, _ = nearest_point(spline, self.points[before])
        last, _ = nearest_point(spline, self.points[after])
        inner = spline[first + 1 : last]
        drawn = np.vstack([self.points[before], inner, self.points[after]])
        return self._with_stretch(before, after, drawn, ink)

    def cut(self, start: NDArray | None, end: NDArray | None) -> MendedStroke:
        """Without what lies before the place `start` and behind the place `end`."""
        stroke = self
        if self.closed:
            # A ring is opened at the first cut, so that a single cut leaves all of it.
            first, _ = nearest_point(self.points, end if start is None else start)
            # The point of the seam becomes the first and the last.
            order = np.r_[first : len(self.points), 0 : first + 1]
            place = (self.knots - first) % len(self.points)
            knots = np.r_[0, np.sort(place[place > 0]), len(order) - 1].astype(np.int64)
            stroke = replace(self._selected(order, knots), closed=False)
        first, last = 0, len(stroke.points) - 1
        if start is not None and not self.closed:
            first, _ = nearest_point(stroke.points, start)
        if end is not None and (start is not None or not self.closed):
            last, _ = nearest_point(stroke.points, end)
        if last - first < 3:
            raise SettingError(
                "Nothing of the stroke is left between the cuts. The start has to lie before the "
                "end.",
                code="nothing-left",
            )
        return stroke.part(first, last + 1)

    def reversed(self) -> MendedStroke:
        """The same line, drawn the other way round."""
        last = len(self.points) - 1
        return self._selected(np.arange(last, -1, -1), last - self.knots[::-1])

    def meets(self, drawn: NDArray) -> bool:
        """Whether a drawn path begins or ends on the stroke, or runs along it."""
        near, index = self._near(drawn)
        along = index[near]
        return bool(near[0] or near[-1] or (near.any() and np.ptp(along) > ALONG_PX))

    def _near(self, drawn: NDArray) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Which points of a path lie on the stroke, and which of its points is nearest to each."""
        from scipy.spatial import cKDTree

        distance, index = cKDTree(self.points).query(drawn)
        return distance <= JOIN_PX, index

    def redraw(self, drawn: NDArray, ink: SliceInk | None) -> MendedStroke:
        """Put a drawn path in place of the stretch that it overlaps, or carry an end on.

        `drawn` is a (M, 2) path that meets the stroke.
        """
        near, index = self._near(drawn)
        count = len(self.points)
        if near[0] and near[-1]:
            first, last = int(index[0]), int(index[-1])
            is_turned = first > last
            if self.closed:
                # The ends cut a ring into two parts. The one nearer to the drawing is replaced.
                middle = drawn[len(drawn) // 2]
                _, forward = nearest_point(self.points[self._run(first, last)], middle)
                _, backward = nearest_point(self.points[self._run(last, first)], middle)
                is_turned = backward < forward
            if is_turned:
                first, last, drawn = last, first, drawn[::-1]
            if self.closed and first == last:
                text = (
                    "The drawn stretch begins and ends at one point of the curve. Let it span a "
                    "part."
                )
                raise SettingError(text, code="stretch-too-short")
            stretch = np.vstack([self.points[first], drawn[1:-1], self.points[last]])
            return self._with_stretch(first, last, stretch, ink)
        if self.closed:
            raise SettingError(
                "The drawn stretch leaves a closed curve at one end. Let both ends lie on it.",
                code="stretch-off-curve",
            )
        if not near[0] and not near[-1]:
            # It comes from elsewhere, runs along the stroke and goes on: it is the stroke now.
            return self._with_stretch(0, count - 1, drawn, ink, free_start=True, free_end=True)
        if not near[0]:
            near, index, drawn = near[::-1], index[::-1], drawn[::-1]
        # It leaves the stroke in the direction in which it ran along it, else at the nearer end.
        first, last = int(index[0]), int(index[near][-1])
        goes_on = last > first if abs(last - first) > ALONG_PX else first >= count / 2
        if goes_on:
            stretch = np.vstack([self.points[first], drawn[1:]])
            return self._with_stretch(first, count - 1, stretch, ink, free_end=True)
        stretch = np.vstack([drawn[:0:-1], self.points[first]])
        return self._with_stretch(0, first, stretch, ink, free_start=True)

    def join(self, other: MendedStroke, ink: SliceInk | None) -> MendedStroke:
        """Both strokes as one, joined where two of their ends lie nearest."""
        pairs = [
            (float(np.hypot(*(self.points[end] - other.points[other_end]))), end, other_end)
            for end in (0, -1)
            for other_end in (0, -1)
        ]
        _, end, other_end = min(pairs)
        first = self.reversed() if end == 0 else self
        second = other.reversed() if other_end == -1 else other
        reach = min(10, len(first.points) - 1, len(second.points) - 1)
        last, count = len(first.points) - 1, len(first.points)
        whole = _concatenated([first, second], False, np.r_[first.knots, count + second.knots])
        # A smooth stretch over the gap, from a little before it to a little behind it.
        around = whole.points[[last - reach, last, count, count + reach]]
        return whole._with_stretch(last - reach, count + reach, path_through(around, False), ink)

    def measured_in(self, box: tuple[int, int, int, int], ink: SliceInk) -> MendedStroke:
        """The stroke with its parts in a box, (u, v, width, height) [px], measured again."""
        low = np.array(box[:2]) - 0.5
        high = low + box[2:]
        inside = ((self.points >= low) & (self.points <= high)).all(axis=1)
        stroke = self
        # From behind, so that the indices of the parts before stay right.
        for run in reversed(list(runs(inside, False))):
            first, last = max(run[0] - 1, 0), min(run[-1] + 1, len(self.points) - 1)
            if last - first >= 2:
                path = self.points[first : last + 1]
                stroke = stroke._with_stretch(first, last, path, ink)
        return stroke

    def part(self, start: int, stop: int) -> MendedStroke:
        """The open stroke from one point to before another, with a knot at either end."""
        inner = self.knots[(self.knots > start) & (self.knots < stop - 1)] - start
        knots = np.r_[0, inner, stop - start - 1].astype(np.int64)
        return replace(self._selected(np.arange(start, stop), knots), closed=False)

    def _selected(self, order: NDArray[np.int64], knots: NDArray[np.int64]) -> MendedStroke:
        """The stroke with these of its points, in this order."""
        values = {name: getattr(self, name)[order] for name in PER_POINT}
        return replace(self, **values, knots=knots)

    def _around(self, knot: int) -> tuple[int, int, int]:
        """The points of the knot before, the knot itself and the knot behind it."""
        count = len(self.knots)
        before, after = max(knot - 1, 0), min(knot + 1, count - 1)
        if self.closed:
            before, after = (knot - 1) % count, (knot + 1) % count
        return int(self.knots[before]), int(self.knots[knot]), int(self.knots[after])

    def _run(self, first: int, last: int) -> NDArray[np.int64]:
        """Indices from one point to another, on a closed stroke through its seam if need be."""
        if first < last or (first == last and not self.closed):
            return np.arange(first, last + 1)
        return np.r_[first : len(self.points), 0 : last + 1]

    def _with_stretch(
        self, first: int, last: int, drawn: NDArray, ink: SliceInk | None, *,
        knot_at: NDArray | None = None, free_start: bool = False, free_end: bool = False,
    ) -> MendedStroke:  # fmt: skip
        """The stroke with a drawn path, moved onto its ink, between two of its points.

        `knot_at` is where a knot shall lie on the new stretch; without it knots lie as far apart
        as elsewhere. `free_start` and `free_end` say whether that end of the path may move to the
        end of its ink.
        """
        if arc_lengths(drawn, False)[-1] < 1.0:
            raise SettingError(
                "The stretch would be shorter than a pixel. Move the knot elsewhere, or delete it.",
                code="stretch-too-short",
            )
        # Measured: moved onto the ink, and joined to the points on either side.
        line = measured(drawn, False, ink, (free_start, free_end))
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
        # Knots on the new stretch, but for its ends.
        if knot_at is None:
            spacing = self.length / max(len(self.knots), 1)
            inner = spread_knots(points, False, spacing)[1:-1]
        else:
            inner = np.array([nearest_point(points, knot_at)[0]])
            inner = inner[(inner > 0) & (inner < len(points) - 1)]
        stretch = MendedStroke(
            points=points, closed=False, sigma=line.sigma, edited=line.edited, width=self.width,
            knots=inner,
        )  # fmt: skip
        if not keeps_start and not keeps_end:
            return replace(stretch, knots=np.unique(np.r_[0, inner, len(points) - 1]))
        if self.closed and last <= first:
            # The stretch leads through the seam: the ring is turned, so that it ends at the seam.
            order = np.r_[last:count, 0:last]
            turned = self._selected(order, np.sort((self.knots - last) % count))
            return turned._spliced((first - last) % count, count, stretch)
        return self._spliced(first, last, stretch)

    def _spliced(self, first: int, last: int, stretch: MendedStroke) -> MendedStroke:
        """The points before `first`, the stretch, the points behind `last`.

        On a closed stroke `last` may be the number of points: the stretch ends at the first one.
        """
        count = len(self.points)
        inner = stretch.knots
        if last == count:
            inner = inner[inner < len(stretch.points) - 1]
            stretch = stretch._selected(np.arange(len(stretch.points) - 1), inner)
        border = [first, first + len(stretch.points) - 1] if last < count else [first]
        shift = first + len(stretch.points) - (last + 1)
        before = self.knots[self.knots < first]
        behind = self.knots[self.knots > last] + shift
        knots = np.unique(np.r_[before, border, first + inner, behind]).astype(np.int64)
        head = self._selected(np.arange(first), before)
        tail = self._selected(np.arange(last + 1, count), behind)
        return _concatenated([head, stretch, tail], self.closed, knots)


def _concatenated(parts: list[MendedStroke], closed: bool, knots: NDArray) -> MendedStroke:
    """Strokes as one, one behind the other, with these knots."""
    values = {name: np.concatenate([getattr(part, name) for part in parts]) for name in PER_POINT}
    return replace(parts[0], **values, closed=closed, knots=knots)


def spread_knots(points: NDArray, closed: bool, spacing_px: float | None = None) -> NDArray:
    """(K,) indices of points at equal steps of arc; of an open stroke the first and the last."""
    arc = arc_lengths(points, closed)
    if spacing_px is None:
        spacing_px = arc[-1] / KNOTS
    steps = max(4 if closed else 1, round(arc[-1] / max(spacing_px, MIN_KNOT_SPACING_PX)))
    at = np.linspace(0.0, arc[-1], steps + 1)
    index = np.searchsorted(arc, (at[:-1] if closed else at) - 1e-9)
    return np.unique(np.clip(index, 0, len(points) - 1)).astype(np.int64)


def _eased(share: NDArray) -> NDArray[np.float64]:
    """From 0 to 1 with no slope and no bend at either end (the quintic smooth step)."""
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
