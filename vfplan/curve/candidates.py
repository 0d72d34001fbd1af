"""Marks -> candidates: lines joined over pen lifts, told open from closed, in a fixed order."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.joining import chains_of, ends_at, ink_beyond, joined_ends
from vfplan.curve.marks import Mark


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

    @property
    def length_px(self) -> float:
        """Along the path, closing step included [px]."""
        if self.junctions:
            return self.marks[0].length_px
        path = np.vstack([self.path, self.path[:1]]) if self.closed else self.path
        return float(np.hypot(*np.diff(path, axis=0).T).sum())

    @property
    def width_px(self) -> float:
        """Mean width of the pen."""
        return sum(m.area_px for m in self.marks) / sum(m.area_px / m.width_px for m in self.marks)

    @property
    def mark(self) -> Mark:
        """The largest of its marks; its pen stands for all."""
        return max(self.marks, key=lambda m: m.area_px)


def candidates_of(
    marks: list[Mark], mask: NDArray[np.bool_], max_gap_px: float, rgb: NDArray
) -> list[Candidate]:
    """Join the marks that are lines over gaps of up to `max_gap_px`; the longest comes first.

    A gap is what is left between the inked pixels of the (H, W) mask.

    A gap is bridged where both tangents agree with each other and with the gap, both pens are the
    same, and neither end has a second partner nearly as good. Where the (H, W, 3) image shows a
    handle in the gap, as an editor draws on the corners of a polygon, the tangents meet under it.
    """
    lines = [m for m in marks if m.kind == "curve"]
    paths = [m.branches[0].path.astype(float) for m in lines]
    closed = [m.branches[0].closed for m in lines]
    ends = [e for i, m in enumerate(lines) if not closed[i] for e in ends_at(i, paths[i], m)]
    ends = [replace(e, ink=ink_beyond(e, mask)) for e in ends]
    joins = joined_ends(ends, paths, max_gap_px, rgb)
    found = [
        Candidate(path, True, np.zeros(len(path), bool), (mark,))
        for path, mark, ring in zip(paths, lines, closed, strict=True)
        if ring
    ]
    found += [_chain(c, paths, lines) for c in chains_of(len(lines), closed, joins)]
    found += [
        Candidate(
            m.branches[0].path.astype(float),
            False,
            np.zeros(0, bool),
            (m,),
            m.junctions,
            "junction",
        )
        for m in marks
        if m.kind == "junction"
    ]
    return sorted((_canonical(c) for c in found), key=_rank)


def _rank(candidate: Candidate) -> tuple:
    return (-candidate.length_px, *candidate.path[0].tolist())


def ends_of(line: Candidate) -> list[tuple[NDArray, NDArray]]:
    """Where an open line ends (u, v) [px], and the unit direction in which it would go on."""
    if line.closed or line.junctions:
        return []
    return [(e.at, e.outward) for e in ends_at(0, line.path, line.mark)]


def inked_ends(line: Candidate, mask: NDArray[np.bool_]) -> list[tuple[NDArray, NDArray]]:
    """As `ends_of`, but where the line's ink ends in the (H, W) mask."""
    if line.closed or line.junctions:
        return []
    ends = ends_at(0, line.path, line.mark)
    return [(e.at + ink_beyond(e, mask) * e.outward, e.outward) for e in ends]


def _chain(
    chain: tuple[list[tuple[int, bool]], bool], paths: list[NDArray], lines: list[Mark]
) -> Candidate:
    order, ring = chain
    runs = [paths[i][::-1] if backwards else paths[i] for i, backwards in order]
    parts, bridged = [runs[0]], [np.zeros(len(runs[0]), bool)]
    for run in [*runs[1:], *([runs[0]] if ring else [])]:
        filling, body = _straight(parts[-1][-1], run[0]), run
        if run is runs[0]:  # back at the first: only the way there is missing
            body = run[:0]
        parts += [filling, body]
        bridged += [np.ones(len(filling), bool), np.zeros(len(body), bool)]
    marks = tuple(lines[i] for i, _ in order)
    return Candidate(np.vstack(parts), ring, np.concatenate(bridged), marks)


def _straight(a: NDArray, b: NDArray) -> NDArray:
    steps = max(1, int(np.ceil(np.hypot(*(b - a)))))
    at = np.arange(1, steps)[:, None] / steps
    return a + at * (b - a)


def _canonical(candidate: Candidate) -> Candidate:
    """Begin an open line at the end nearer the top left; a ring there, clockwise as seen."""
    path, bridged = candidate.path, candidate.bridged
    if candidate.junctions or len(path) < 2:
        return candidate
    if candidate.closed:
        if _signed_area(path) < 0:
            path, bridged = path[::-1], bridged[::-1]
        start = int(np.argmin(path.sum(1)))
        path, bridged = np.roll(path, -start, 0), np.roll(bridged, -start)
    # By u + v above all, then by v and u of ends as near to the corner.
    elif tuple(path[0][::-1] + path[0].sum() * 1e3) > tuple(path[-1][::-1] + path[-1].sum() * 1e3):
        path, bridged = path[::-1], bridged[::-1]
    return Candidate(path, candidate.closed, bridged, candidate.marks)


def _signed_area(path: NDArray) -> float:
    after = np.roll(path, -1, 0)
    return float(np.sum(path[:, 0] * after[:, 1] - after[:, 0] * path[:, 1])) / 2
