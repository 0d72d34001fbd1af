"""Marks -> candidates: lines joined over pen lifts, told open from closed, in a fixed order.

A gap is bridged where both tangents agree with each other and with the gap, neither line is shorter
than it, and both pens are the same. Where the picture shows a handle in the gap, as an editor draws
on the corners of a polygon, the line may turn under it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.marks import Mark
from vfplan.curve.path import arc_length
from vfplan.errors import CurveError

TANGENT_PX = 14  # length of line from which an end's direction is taken
MAX_TURN_DEG = 60.0  # between the directions on both sides of a gap
MAX_ASIDE_DEG = 45.0  # between a direction and the gap itself
BLUR_PX = 2.0  # by which an end may lie aside: over a short gap, a large angle
# A handle's size at most; its border's and its middle's grey; pixels of either.
HANDLE_PX, HANDLE_GREY, HANDLE_PIXELS = 16.0, (60.0, 225.0), 6
ALIKE = 2.0  # of one pen: the factor of its strength and its width
CROWD, CROWD_SHARE = 4, 4.0  # so many specks, at most so many times shorter than a line's own marks


@dataclass(frozen=True, eq=False)
class Candidate:
    """One line that may be the planned curve."""

    # (M, 2) float64 (u, v), about one point a pixel, gaps filled with straight runs
    path: NDArray[np.float64]
    closed: bool  # whether it ends where it began
    bridged: NDArray[np.bool_]  # (M,) bool, points on a bridged gap
    marks: tuple[Mark, ...]  # the marks it was joined from
    # (u, v) where it forks or crosses itself; it cannot be used when there are any
    junctions: tuple[tuple[int, int], ...] = ()
    kind: str = "curve"  # "curve", "junction", or what it was taken for instead
    cut: tuple[bool, bool] = (False, False)  # whether a person cut off its (first, last) end

    @classmethod
    def of_mark(cls, mark: Mark) -> Candidate:
        """A mark by itself, along its first branch."""
        branch = mark.branches[0]
        closed = branch.closed and mark.kind == "curve"
        path = branch.path.astype(float)
        return cls(path, closed, np.zeros(len(path), bool), (mark,), mark.junctions, mark.kind)

    @property
    def is_candidate(self) -> bool:
        """Whether it may be the planned curve."""
        return self.kind in ("curve", "junction")

    @property
    def pixels(self) -> NDArray[np.int64]:
        """(M, 2) skeleton pixels (u, v) of all its marks, in no order across marks."""
        return np.vstack([b.path for m in self.marks for b in m.branches])

    @property
    def box(self) -> tuple[int, int, int, int]:
        """(u, v, width, height) of all its marks [px]."""
        boxes = np.array([m.box for m in self.marks])
        low, high = boxes[:, :2].min(0), (boxes[:, :2] + boxes[:, 2:]).max(0)
        return tuple(int(x) for x in (*low, *(high - low)))

    @cached_property
    def length_px(self) -> float:
        """Along the path, closing step included [px]."""
        whole = (
            self.marks[0].length_px if self.junctions else arc_length(self.path, self.closed)[-1]
        )
        return float(whole)

    @property
    def width_px(self) -> float:
        """Mean width of the pen."""
        return sum(m.area_px for m in self.marks) / sum(m.area_px / m.width_px for m in self.marks)

    @property
    def mark(self) -> Mark:
        """The largest of its marks; its pen stands for all."""
        return max(self.marks, key=lambda m: m.area_px)

    def backwards(self) -> Candidate:
        """The same line from its other end."""
        return replace(self, path=self.path[::-1], bridged=self.bridged[::-1])


@dataclass(frozen=True, eq=False)
class End:
    """An end of a line."""

    line: int  # its number
    at: NDArray  # (u, v), the path's last point
    outward: NDArray  # unit direction in which it would go on
    ink: float  # how far the ink runs on beyond `at` [px]


def candidates_of(
    marks: list[Mark], mask: NDArray[np.bool_], max_gap_px: float, rgb: NDArray
) -> list[Candidate]:
    """Join the marks that are lines over gaps of up to `max_gap_px`; the longest comes first.

    A gap is what is left between the inked pixels of the (H, W) mask of the (H, W, 3) image.
    """
    lines = [Candidate.of_mark(m) for m in marks if m.kind == "curve"]
    forked = [Candidate.of_mark(m) for m in marks if m.kind == "junction"]
    ends = [
        End(i, at, outward, _ink_beyond(at, outward, line.width_px, mask))
        for i, line in enumerate(lines)
        for at, outward in ends_of(line)
    ]
    found = _joined(lines, _pairs(ends, lines, max_gap_px, rgb))
    found = [*map(_canonical, found), *forked]
    return sorted(found, key=lambda c: (-c.length_px, *c.path[0].tolist()))


def refuse_crowd(
    candidates: list[Candidate],
    others: list[Candidate],
    marks: list[Mark],
    colour: str,
    max_gap_px: float,
) -> None:
    """Raise `CurveError` for specks alone, or when the longest line's marks are but more of them.

    Noise makes short lines of red, and lines joined from them, among hundreds nearly as long, and
    dashes that were not joined lie beside some that were; a drawing does neither.
    """
    named = [*candidates, *(c for c in others if c.kind != "speck")]
    own = {id(m) for c in named for m in c.marks}
    least = max((m.length_px for c in candidates[:1] for m in c.marks), default=0.0) / CROWD_SHARE
    loose = (m for m in marks if m.kind != "panel" and id(m) not in own)
    count = sum(m.length_px >= least for m in loose)
    if count > CROWD and (candidates or not named):
        line = f"a line of {candidates[0].length_px:.0f} px" if candidates else "no line"
        raise CurveError(
            f"no planned curve: {line} in {colour} among {count} specks (at most {CROWD}): "
            "noise, a coloured picture, or dots or dashes; look in a part of it (--roi). A dashed "
            "line is followed where its dashes are longer than its gaps and these no longer than "
            f"--max-gap ({max_gap_px:g} px); draw it solid, or give it as vectors (--curve)"
        )


def ends_of(line: Candidate) -> list[tuple[NDArray, NDArray]]:
    """Where an open line ends (u, v) [px], if not cut off, and the unit direction of going on."""
    reach = min(TANGENT_PX, len(line.path) - 1)
    if line.closed or line.junctions or reach < 3:
        return []
    skip = reach // 6  # thinning, and what hides the line, bend its last pixels
    runs = line.path[: reach + 1], line.path[::-1][: reach + 1]
    ends = zip(runs, line.cut, strict=True)
    return [(run[0], _direction(run[skip:])) for run, cut in ends if not cut]


def inked_ends(line: Candidate, mask: NDArray[np.bool_]) -> list[tuple[NDArray, NDArray]]:
    """As `ends_of`, but where the line's ink ends in the (H, W) mask."""
    width = line.mark.width_px
    return [(at + _ink_beyond(at, out, width, mask) * out, out) for at, out in ends_of(line)]


def angle_deg(a: NDArray, b: NDArray) -> float:
    """Between two directions, 0..180."""
    cosine = np.dot(a, b) / (np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _ink_beyond(at: NDArray, outward: NDArray, width: float, mask: NDArray[np.bool_]) -> float:
    """How far the ink runs on from a thinned end [px]: thinning takes half a width, or more."""
    t = np.arange(0.0, 2 * width + 6, 0.25)
    u, v = np.rint(at + t[:, None] * outward).astype(int).T
    on = (u >= 0) & (v >= 0) & (u < mask.shape[1]) & (v < mask.shape[0])
    on[on] = mask[v[on], u[on]]
    return float(t[np.argmin(on)] if not on.all() else t[-1])


def _direction(run: NDArray) -> NDArray:
    """Unit direction at the first point of a run, pointing away from the rest of it."""
    degree = 2 if len(run) > 7 else 1  # a parabola follows a bend up to the end
    slope = np.polynomial.polynomial.polyfit(np.arange(len(run)), run, degree)[1]
    return -slope / np.hypot(*slope)


def _pairs(
    ends: list[End], lines: list[Candidate], max_gap: float, rgb: NDArray
) -> list[tuple[End, End]]:
    """The ends that belong together, each in one pair at most: the surest come first."""
    if len(ends) < 2:
        return []
    from scipy.spatial import cKDTree

    reach = max_gap + 2 * max(e.ink for e in ends)
    near = sorted(cKDTree([e.at for e in ends]).query_pairs(reach))
    costs = [(_cost(ends[i], ends[j], lines, max_gap, rgb), i, j) for i, j in near]
    free, pairs = set(range(len(ends))), []
    for _, i, j in sorted(c for c in costs if c[0] < np.inf):
        if i in free and j in free:
            free -= {i, j}
            pairs.append((ends[i], ends[j]))
    return pairs


def _cost(a: End, b: End, lines: list[Candidate], max_gap: float, rgb: NDArray) -> float:
    """The way between two ends, the longer the more it bends; infinite where it cannot be."""
    first, second = lines[a.line].mark, lines[b.line].mark
    across = b.at - a.at
    distance = float(np.hypot(*across))
    gap = distance - a.ink - b.ink
    shorter = min(len(lines[end.line].path) for end in (a, b)) + first.width_px
    if gap > min(max_gap, shorter) or not _same_pen(first, second):
        return np.inf
    turn = angle_deg(a.outward, -b.outward)
    aside = max(angle_deg(a.outward, across), angle_deg(-b.outward, across))
    aside = max(aside - np.degrees(np.arctan2(BLUR_PX, distance)), 0.0)
    if distance < min(first.width_px, second.width_px):
        aside = 0.0  # nearer than two strokes can lie: one, cut on a slant
    bent = turn > MAX_TURN_DEG or aside > MAX_ASIDE_DEG
    if bent and not (distance <= HANDLE_PX and _is_handle(rgb, (a.at + b.at) / 2, distance)):
        return np.inf
    return distance * (1 + (turn + aside) / MAX_ASIDE_DEG)


def _is_handle(rgb: NDArray, at: NDArray, size: float) -> bool:
    """Whether there is a small bright square with a dark border."""
    u, v = np.rint(at).astype(int)
    reach = int(size // 2) + 2
    grey = rgb[max(v - reach, 0) : v + reach + 1, max(u - reach, 0) : u + reach + 1].mean(2)
    grey = grey * (255.0 / np.iinfo(rgb.dtype).max)
    dark, bright = (grey < HANDLE_GREY[0]).sum(), (grey > HANDLE_GREY[1]).sum()
    return bool(min(dark, bright) >= HANDLE_PIXELS)


def _same_pen(a: Mark, b: Mark) -> bool:
    """Whether two marks are alike in strength and width."""
    ratios = (a.pen.strength / b.pen.strength, a.width_px / b.width_px)
    return all(1 / ALIKE < ratio < ALIKE for ratio in ratios)


def _joined(lines: list[Candidate], pairs: list[tuple[End, End]]) -> list[Candidate]:
    """The lines, those of each pair of ends made one by a straight run between these."""
    whole = list(lines)  # what each line is now part of
    for a, b in pairs:
        one, other = whole[a.line], whole[b.line]
        ring = one is other
        first = one if (one.path[-1] == a.at).all() else one.backwards()
        second = other if (other.path[0] == b.at).all() else other.backwards()
        steps = max(1, int(np.ceil(np.hypot(*(b.at - a.at)))))
        way = a.at + np.arange(1, steps)[:, None] / steps * (b.at - a.at)
        parts = [first.path, way] if ring else [first.path, way, second.path]
        flags = [first.bridged, np.ones(len(way), bool), *([] if ring else [second.bridged])]
        marks = one.marks if ring else one.marks + other.marks
        joined = Candidate(np.vstack(parts), ring, np.concatenate(flags), marks)
        whole = [joined if c is one or c is other else c for c in whole]
    return list(dict.fromkeys(whole))


def _canonical(line: Candidate) -> Candidate:
    """Begin an open line at the end nearer the top left; a ring there, clockwise as seen."""
    if line.closed:
        import cv2

        if cv2.contourArea(line.path.astype(np.float32), oriented=True) < 0:
            line = line.backwards()
        start = -int(np.argmin(line.path.sum(1)))
        return replace(
            line, path=np.roll(line.path, start, 0), bridged=np.roll(line.bridged, start)
        )
    first, last = ((*at.sum(keepdims=True), at[1]) for at in line.path[[0, -1]])
    return line if first <= last else line.backwards()
