"""A stroke that a person can mend: its points, and the knots by which they are moved.

A measured curve has a point a pixel; nobody wants to drag those. About thirty knots lie on it. A
knot that is moved takes the points between its neighbours along. Every edit returns a new stroke.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError
from vfplan.review.ink import Ink, Measured
from vfplan.review.paths import arc_length, evenly, nearest_point, spline_through

KNOTS = 30
"""Knots of a stroke: few enough to grasp each, enough for every bend that a hand draws."""

MIN_KNOT_SPACING_PX = 10.0
"""Distance [px] of neighbouring knots on a short stroke: less, and their handles overlap."""

HAND_SIGMA_PX = 1.0
"""Deviation [px] of a point that a hand placed where there is no ink: a hand is good to a pixel."""

REACH_PX = 8.0
"""How far [px] from a drawn stretch ink is looked for: a click misses its line by less."""

JOIN_PX = 12.0
"""Distance [px] from the curve within which a drawn stretch begins or ends on it."""


@dataclass(frozen=True, eq=False)
class Stroke:
    """One line of the curve.

    Parameters
    ----------
    points
        (M, 2) pixels (u, v), in drawing order.
    sigma
        (M,) standard deviation across the line [px].
    closed
        Whether the last point joins the first.
    bridged
        (M,) bool, points that lie on a bridged gap.
    edited
        (M,) bool, points that a hand placed and no ink confirms.
    seen
        (M,) bool, points that the person had in view at full size.
    knots
        (K,) indices of the points that can be moved, rising.
    """

    points: NDArray[np.float64]
    sigma: NDArray[np.float64]
    closed: bool
    bridged: NDArray[np.bool_]
    edited: NDArray[np.bool_]
    seen: NDArray[np.bool_]
    knots: NDArray[np.int64]

    @classmethod
    def measured(
        cls,
        points: NDArray,
        sigma: NDArray | None,
        closed: bool,
        bridged: NDArray | None = None,
        edited: NDArray | None = None,
    ) -> Stroke:
        """A stroke that nobody has looked at yet, with its knots at equal steps of arc."""
        count = len(points)
        none = np.zeros(count, bool)
        return cls(
            points=np.array(points, float),
            sigma=np.zeros(count) if sigma is None else np.array(sigma, float),
            closed=bool(closed),
            bridged=none if bridged is None else np.array(bridged, bool),
            edited=none if edited is None else np.array(edited, bool),
            seen=none,
            knots=spread_knots(points, bool(closed)),
        )

    @classmethod
    def from_ink(cls, line: Measured, closed: bool) -> Stroke:
        """A stroke of a path that was moved onto the ink; edited where there was none."""
        shown = line.is_confirmed
        sigma = np.where(shown, line.sigma, HAND_SIGMA_PX)
        return cls.measured(line.points, sigma, closed, edited=~shown)

    @property
    def length_px(self) -> float:
        """Length along the stroke, the closing step included."""
        return float(arc_length(self.points, self.closed)[-1])

    @property
    def knots_px(self) -> NDArray[np.float64]:
        """(K, 2) where the knots lie."""
        return self.points[self.knots]

    def look_at(self, start: float, stop: float) -> Stroke:
        """The stroke with the part between two shares of its length seen."""
        arc = arc_length(self.points, False)
        share = arc / arc[-1]
        inside = (share >= start - 1e-9) & (share <= stop + 1e-9)
        return replace(self, seen=self.seen | inside)

    def move_knot(self, knot: int, to: NDArray, ink: Ink | None) -> Stroke:
        """Move a knot; the points between its neighbours follow, and are measured again."""
        before, own, after = self._around(knot)
        # One run of indices, which on a closed stroke may lead through its seam.
        stretch = self._stretch(before, after)
        points = self.points[stretch]
        middle = (own - before) % len(self.points) if self.closed else own - before
        arc = arc_length(points, False)
        share = np.ones(len(points))
        if middle > 0:
            share[: middle + 1] = _eased(arc[: middle + 1] / arc[middle])
        if middle < len(points) - 1:
            rest = arc[middle:] - arc[middle]
            share[middle:] = _eased(1.0 - rest / rest[-1])
        moved = points + share[:, None] * (to - self.points[own])
        return self._with_stretch(before, after, moved, ink, at=moved[middle])

    def insert_knot(self, at: NDArray) -> Stroke:
        """A further knot at the point nearest to a place."""
        nearest, _ = nearest_point(self.points, at)
        if nearest in self.knots:
            raise SettingError(
                f"there is a knot at ({at[0]:.1f}, {at[1]:.1f}) already; choose a place between "
                "two knots",
                code="knot-exists",
                numbers={"u": float(at[0]), "v": float(at[1])},
            )
        return replace(self, knots=np.sort(np.append(self.knots, nearest)))

    def delete_knot(self, knot: int, ink: Ink | None) -> Stroke:
        """Draw the stretch between a knot's neighbours anew, without it; an end is cut back."""
        if len(self.knots) <= (3 if self.closed else 2):
            raise SettingError(
                f"the stroke has {len(self.knots)} knots and needs them; cut it, or draw it anew",
                code="too-few-knots",
                numbers={"knots": len(self.knots)},
            )
        if not self.closed and knot in (0, len(self.knots) - 1):
            if knot == 0:
                return self.part(int(self.knots[1]), len(self.points))
            return self.part(0, int(self.knots[-2]) + 1)
        before, _, after = self._around(knot)
        # The spline through the knots around shows how the line would run without this one.
        count = len(self.knots)
        around = [knot + k for k in (-2, -1, 1, 2)]
        if self.closed:
            around = list(dict.fromkeys(k % count for k in around))
        else:
            around = [k for k in around if 0 <= k < count]
        spline = spline_through(self.knots_px[around], False)
        first, _ = nearest_point(spline, self.points[before])
        last, _ = nearest_point(spline, self.points[after])
        drawn = spline[first : last + 1]
        drawn = np.vstack([self.points[before], drawn[1:-1], self.points[after]])
        return self._with_stretch(before, after, drawn, ink, at=None)

    def cut(self, start: NDArray | None, end: NDArray | None) -> Stroke:
        """Without what lies before the place `start` and behind the place `end`."""
        stroke = self
        if stroke.closed:
            seam = start if start is not None else end
            first, _ = nearest_point(stroke.points, seam)
            stroke = stroke._opened(first)
        first, last = 0, len(stroke.points) - 1
        if start is not None and not self.closed:
            first, _ = nearest_point(stroke.points, start)
        if end is not None and not (self.closed and start is None):
            last, _ = nearest_point(stroke.points, end)
        if last - first < 3:
            raise SettingError(
                "nothing of the stroke is left between the cuts; the start lies before the end",
                code="nothing-left",
                numbers={"points": max(last - first + 1, 0)},
            )
        return stroke.part(first, last + 1)

    def reversed(self) -> Stroke:
        """The same line, drawn the other way round."""
        return Stroke(
            self.points[::-1],
            self.sigma[::-1],
            self.closed,
            self.bridged[::-1],
            self.edited[::-1],
            self.seen[::-1],
            len(self.points) - 1 - self.knots[::-1],
        )

    def redraw(self, drawn: NDArray, ink: Ink | None) -> Stroke:
        """Put a drawn stretch in place of the part between its ends, or carry an end on.

        `drawn` is a (M, 2) path of which at least one end lies within `JOIN_PX` of the stroke.
        """
        first, first_off = nearest_point(self.points, drawn[0])
        last, last_off = nearest_point(self.points, drawn[-1])
        if first_off <= JOIN_PX and last_off <= JOIN_PX:
            if self.closed:
                return self._redraw_closed(first, last, drawn, ink)
            if first > last:
                first, last, drawn = last, first, drawn[::-1]
            stretch = np.vstack([self.points[first], drawn[1:-1], self.points[last]])
            return self._with_stretch(first, last, stretch, ink, at=None)
        if self.closed:
            raise SettingError(
                "the drawn stretch leaves a closed curve at one end; let both ends lie on it",
                code="stretch-off-curve",
                numbers={"off_px": max(first_off, last_off)},
            )
        if last_off <= JOIN_PX:
            first, drawn = last, drawn[::-1]
        # The stretch carries on the nearer end of the stroke.
        count = len(self.points)
        if first >= count / 2:
            stretch = np.vstack([self.points[first], drawn[1:]])
            return self._with_stretch(first, count - 1, stretch, ink, at=None, free_end=True)
        stretch = np.vstack([drawn[:0:-1], self.points[first]])
        return self._with_stretch(0, first, stretch, ink, at=None, free_start=True)

    def join(self, other: Stroke, ink: Ink | None) -> Stroke:
        """Both strokes as one, joined where two of their ends lie nearest."""
        pairs = []
        for own_end in (0, -1):
            for other_end in (0, -1):
                gap = self.points[own_end] - other.points[other_end]
                pairs.append((float(np.hypot(*gap)), own_end, other_end))
        _, own_end, other_end = min(pairs)
        first = self.reversed() if own_end == 0 else self
        second = other.reversed() if other_end == -1 else other
        reach = min(10, len(first.points) - 1, len(second.points) - 1)
        around = np.vstack(
            [
                first.points[[-1 - reach, -1]],
                second.points[[0, reach]],
            ]
        )
        spline = spline_through(around, False)
        start, _ = nearest_point(spline, first.points[-1])
        stop, _ = nearest_point(spline, second.points[0])
        gap = spline[start + 1 : stop]
        count = len(gap)
        knots = np.r_[first.knots, len(first.points) + count + second.knots]
        whole = Stroke(
            np.vstack([first.points, gap, second.points]),
            np.r_[first.sigma, np.full(count, HAND_SIGMA_PX), second.sigma],
            False,
            np.r_[first.bridged, np.zeros(count, bool), second.bridged],
            np.r_[first.edited, np.ones(count, bool), second.edited],
            np.r_[first.seen, np.zeros(count, bool), second.seen],
            knots,
        )
        if count < 2:
            return whole
        last = len(first.points) - 1
        return whole._with_stretch(last, last + count + 1, whole.points[last : last + count + 2],
                                   ink, at=None)  # fmt: skip

    def part(self, start: int, stop: int) -> Stroke:
        """The open stroke from one point to before another, with a knot at either end."""
        own = slice(start, stop)
        count = stop - start
        inner = self.knots[(self.knots > start) & (self.knots < stop - 1)] - start
        return Stroke(
            self.points[own],
            self.sigma[own],
            False,
            self.bridged[own],
            self.edited[own],
            self.seen[own],
            np.r_[0, inner, count - 1].astype(np.int64),
        )

    def _opened(self, first: int) -> Stroke:
        """A closed stroke, opened at a point, which becomes its first and its last."""
        order = np.r_[first : len(self.points), 0 : first + 1]
        place = (self.knots - first) % len(self.points)
        inner = place[place > 0]
        return Stroke(
            self.points[order],
            self.sigma[order],
            False,
            self.bridged[order],
            self.edited[order],
            self.seen[order],
            np.r_[0, np.sort(inner), len(order) - 1].astype(np.int64),
        )

    def _redraw_closed(self, first: int, last: int, drawn: NDArray, ink: Ink | None) -> Stroke:
        """Of the two parts between the drawn stretch's ends the one nearer to it is replaced."""
        count = len(self.points)
        middle = drawn[len(drawn) // 2]
        forward = self._stretch(first, last)
        backward = self._stretch(last, first)
        _, forward_off = nearest_point(self.points[forward], middle)
        _, backward_off = nearest_point(self.points[backward], middle)
        if backward_off < forward_off:
            first, last, drawn = last, first, drawn[::-1]
        if (last - first) % count < 1:
            raise SettingError(
                "the drawn stretch begins and ends at one point of the curve; let it span a part",
                code="stretch-too-short",
                numbers={"points": len(drawn)},
            )
        stretch = np.vstack([self.points[first], drawn[1:-1], self.points[last]])
        return self._with_stretch(first, last, stretch, ink, at=None)

    def _around(self, knot: int) -> tuple[int, int, int]:
        """The points of the knot before, the knot itself and the knot behind it."""
        count = len(self.knots)
        own = int(self.knots[knot])
        if self.closed:
            return int(self.knots[knot - 1]), own, int(self.knots[(knot + 1) % count])
        return int(self.knots[max(knot - 1, 0)]), own, int(self.knots[min(knot + 1, count - 1)])

    def _stretch(self, first: int, last: int) -> NDArray[np.int64]:
        """Indices from one point to another, through the seam where need be."""
        if first <= last and not (self.closed and first == last):
            return np.arange(first, last + 1)
        return np.r_[first : len(self.points), 0 : last + 1]

    def _with_stretch(
        self,
        first: int,
        last: int,
        drawn: NDArray,
        ink: Ink | None,
        at: NDArray | None,
        free_start: bool = False,
        free_end: bool = False,
    ) -> Stroke:
        """The stroke with a drawn path, moved onto its ink, between two of its points.

        at: where a knot shall lie on the new stretch; `None`: knots as far apart as elsewhere
        free_start, free_end: whether that end of the path may move to the end of its ink
        """
        if arc_length(drawn, False)[-1] < 1.0:
            raise SettingError(
                "the stretch would be shorter than a pixel; move the knot elsewhere, or delete it",
                code="stretch-too-short",
                numbers={"points": len(drawn)},
            )
        ends = drawn[[0, -1]]
        if ink is None:
            points = evenly(drawn, False)
            sigma = np.full(len(points), HAND_SIGMA_PX)
            edited = np.ones(len(points), bool)
        else:
            free = (free_start, free_end)
            line = ink.draw(drawn, False, REACH_PX, free)
            points = line.points
            edited = ~line.is_confirmed
            sigma = np.where(edited, HAND_SIGMA_PX, line.sigma)
        count = len(self.points)
        whole = not self.closed and first == 0 and last == count - 1
        keeps_start = self.closed or first > 0
        keeps_end = self.closed or last < count - 1
        points = _meeting(points, ends, keeps_start, keeps_end)
        none = np.zeros(len(points), bool)
        new = Stroke(points, sigma, False, none, edited, none, np.zeros(0, np.int64))
        if at is None:
            inner = spread_knots(points, False, self._knot_spacing())[1:-1]
        else:
            inner = np.array([nearest_point(points, at)[0]])
            inner = inner[(inner > 0) & (inner < len(points) - 1)]
        if whole:
            knots = np.unique(np.r_[0, inner, len(points) - 1])
            return replace(new, knots=knots)
        if self.closed and last <= first:  # the stretch leads through the seam: the ring is turned
            turn = last
            order = np.r_[turn:count, 0:turn]
            turned = self._ordered(order, np.sort((self.knots - turn) % count))
            return turned._spliced((first - turn) % count, count, new, inner)
        return self._spliced(first, last, new, inner)

    def _ordered(self, order: NDArray, knots: NDArray) -> Stroke:
        return Stroke(
            self.points[order],
            self.sigma[order],
            self.closed,
            self.bridged[order],
            self.edited[order],
            self.seen[order],
            knots,
        )

    def _spliced(self, first: int, last: int, new: Stroke, inner: NDArray) -> Stroke:
        """The points before `first`, the new stretch, the points behind `last`.

        On a closed stroke `last` may be the number of points: the stretch ends at the first one.
        """
        count = len(self.points)
        if last == count:
            new = new.part(0, len(new.points) - 1)
            inner = inner[inner < len(new.points)]
        head = slice(0, first)
        tail = slice(last + 1, count)

        def joined(name: str) -> NDArray:
            own = getattr(self, name)
            return np.concatenate([own[head], getattr(new, name), own[tail]])

        shift = first + len(new.points) - (last + 1)
        kept_before = self.knots[self.knots < first]
        kept_after = self.knots[self.knots > last] + shift
        border = [first]
        if last < count:
            border.append(first + len(new.points) - 1)
        knots = np.unique(np.r_[kept_before, border, first + inner, kept_after])
        return Stroke(
            joined("points"),
            joined("sigma"),
            self.closed,
            joined("bridged"),
            joined("edited"),
            joined("seen"),
            knots.astype(np.int64),
        )

    def _knot_spacing(self) -> float:
        return self.length_px / max(len(self.knots), 1)


def spread_knots(points: NDArray, closed: bool, spacing_px: float | None = None) -> NDArray:
    """(K,) indices of points at equal steps of arc; of an open stroke the first and the last."""
    arc = arc_length(points, closed)
    if spacing_px is None:
        spacing_px = max(arc[-1] / KNOTS, MIN_KNOT_SPACING_PX)
    steps = max(4 if closed else 1, round(arc[-1] / max(spacing_px, MIN_KNOT_SPACING_PX)))
    at = np.linspace(0.0, arc[-1], steps + 1)
    if closed:
        at = at[:-1]
    index = np.searchsorted(arc, at - 1e-9)
    return np.unique(np.clip(index, 0, len(points) - 1)).astype(np.int64)


def _eased(share: NDArray) -> NDArray[np.float64]:
    """From 0 to 1 with no slope and no bend at either end (the quintic smooth step)."""
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def _meeting(
    points: NDArray, ends: NDArray, keeps_start: bool, keeps_end: bool
) -> NDArray[np.float64]:
    """The points shifted so that they meet the curve's own at either end, over eight pixels."""
    points = points.copy()
    step = np.arange(len(points))
    if keeps_start:
        fade = np.exp(-0.5 * (step / 3.0) ** 2)
        points += fade[:, None] * (ends[0] - points[0])
    if keeps_end:
        fade = np.exp(-0.5 * (step[::-1] / 3.0) ** 2)
        points += fade[:, None] * (ends[1] - points[-1])
    return points
