"""Marks -> candidates: lines joined over pen lifts, told open from closed, in a fixed order."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.handles import under_handle
from vfplan.curve.marks import Mark

TANGENT_PX = 14.0  # length of line from which an end's direction is taken
MAX_TURN_DEG = 60.0  # between the directions on both sides of a gap
MAX_ASIDE_DEG = 45.0  # between a direction and the gap itself
PIXEL_NOISE = 2.0
INK_WIDTHS, INK_PX, INK_STEP_PX = 2.0, 6.0, 0.25  # how far beyond a thinned end ink is looked for
EDGE_PX = 0.5  # by which a gap between inked pixels may seem wider than it is


@dataclass(frozen=True, eq=False)
class Candidate:
    """One line that may be the planned curve.

    Parameters
    ----------
    path
        (M, 2) float64 (u, v), about one point a pixel, gaps filled with straight runs.
    closed
        Whether it ends where it began.
    bridged
        (M,) bool, points on a bridged gap.
    marks
        The marks it was joined from.
    junctions
        (u, v) where it forks or crosses itself; it cannot be used when there are any.
    kind
        "curve", "junction", or what it was taken for instead.
    """

    path: NDArray[np.float64]
    closed: bool
    bridged: NDArray[np.bool_]
    marks: tuple[Mark, ...]
    junctions: tuple[tuple[int, int], ...] = ()
    kind: str = "curve"

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


@dataclass(frozen=True, eq=False)
class _End:
    piece: int
    last: bool
    at: NDArray
    outward: NDArray
    mark: Mark
    ink: float = 0.0  # how far the ink runs on beyond `at`


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
    ends = [e for i, m in enumerate(lines) if not closed[i] for e in _ends(i, paths[i], m)]
    ends = [replace(e, ink=_ink_beyond(e, mask)) for e in ends]
    joins = _joins(ends, paths, max_gap_px, rgb)
    found = [
        Candidate(path, True, np.zeros(len(path), bool), (mark,))
        for path, mark, ring in zip(paths, lines, closed, strict=True)
        if ring
    ]
    found += [_chain(c, paths, lines) for c in _chains(len(lines), closed, joins)]
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


def _ends(piece: int, path: NDArray, mark: Mark) -> list[_End]:
    reach = min(int(TANGENT_PX), len(path) - 1)
    if reach < 3:
        return []
    skip = reach // 6  # thinning, and what hides the line, bend its last pixels
    out = []
    for last, run in ((False, path[skip : reach + 1]), (True, path[::-1][skip : reach + 1])):
        outward = _direction(run)
        out.append(_End(piece, last, path[-1 if last else 0], outward, mark))
    return out


def ends_of(line: Candidate) -> list[tuple[NDArray, NDArray]]:
    """Where an open line ends (u, v) [px], and the unit direction in which it would go on."""
    if line.closed or line.junctions:
        return []
    return [(e.at, e.outward) for e in _ends(0, line.path, line.mark)]


def _ink_beyond(end: _End, mask: NDArray[np.bool_]) -> float:
    """How far the ink runs on from a thinned end [px]: thinning takes half a width, or more."""
    t = np.arange(0.0, INK_WIDTHS * end.mark.width_px + INK_PX, INK_STEP_PX)
    u, v = np.rint(end.at + t[:, None] * end.outward).astype(int).T
    on = (u >= 0) & (v >= 0) & (u < mask.shape[1]) & (v < mask.shape[0])
    on[on] = mask[v[on], u[on]]
    return float(t[np.argmin(on)] if not on.all() else t[-1])


def inked_ends(line: Candidate, mask: NDArray[np.bool_]) -> list[tuple[NDArray, NDArray]]:
    """As `ends_of`, but where the line's ink ends in the (H, W) mask."""
    if line.closed or line.junctions:
        return []
    ends = _ends(0, line.path, line.mark)
    return [(e.at + _ink_beyond(e, mask) * e.outward, e.outward) for e in ends]


def _direction(run: NDArray) -> NDArray:
    """Unit direction at the first point of a run, pointing away from the rest of it."""
    t = np.arange(len(run), dtype=float)
    degree = 2 if len(run) > 7 else 1  # a parabola follows a bend up to the end
    slope = np.polynomial.polynomial.polyfit(t, run, degree)[1]
    return -slope / np.hypot(*slope)


def _joins(
    ends: list[_End], paths: list[NDArray], max_gap: float, rgb: NDArray
) -> list[tuple[_End, _End]]:
    costs: dict[tuple[int, int], float] = {}
    rivals: dict[int, list[tuple[float, tuple[int, int]]]] = {}
    for pair in _near(ends, max_gap):
        cost = _cost(ends[pair[0]], ends[pair[1]], paths, max_gap, rgb)
        if cost is not None:
            costs[pair] = cost
            for end in pair:
                rivals.setdefault(end, []).append((cost, pair))
    joined, used = [], set()
    for pair, cost in sorted(costs.items(), key=lambda item: (item[1], item[0])):
        others = [c for end in pair for c, other in rivals[end] if other != pair]
        if used & set(pair) or any(c < 1.5 * cost for c in others):
            continue
        used |= set(pair)
        joined.append((ends[pair[0]], ends[pair[1]]))
    return joined


def _near(ends: list[_End], max_gap: float) -> list[tuple[int, int]]:
    """Pairs of ends that may lie within `max_gap` of each other, in order."""
    if len(ends) < 2:
        return []
    from scipy.spatial import cKDTree

    reach = max_gap + EDGE_PX + 2 * max(e.ink for e in ends)
    return sorted(cKDTree([e.at for e in ends]).query_pairs(reach))


def _cost(a: _End, b: _End, paths: list[NDArray], max_gap: float, rgb: NDArray) -> float | None:
    width = (a.mark.width_px + b.mark.width_px) / 2
    across = b.at - a.at
    distance = float(np.hypot(*across))
    gap = distance - a.ink - b.ink
    if gap > max_gap + EDGE_PX or not same_pen(a.mark, b.mark):
        return None
    if min(len(paths[a.piece]), len(paths[b.piece])) + width < gap:
        return None
    if a.piece == b.piece and len(paths[a.piece]) < 3 * distance + 10:
        return None
    doubt = np.degrees(np.arctan2(PIXEL_NOISE, distance))  # a pixel aside is an angle, up close
    turn = angle_deg(a.outward, -b.outward)
    aside = max(angle_deg(a.outward, across), angle_deg(-b.outward, across)) - doubt
    bent = turn > MAX_TURN_DEG or aside > MAX_ASIDE_DEG
    if bent and not under_handle((a.at, a.outward), (b.at, b.outward), rgb):
        return None
    return distance * (1 + (turn + max(aside, 0.0)) / 45)


def same_pen(a: Mark, b: Mark) -> bool:
    """Whether two marks are alike in hue, strength and width."""
    hue = angle_deg(a.pen.along, b.pen.along)
    strength = a.pen.strength / b.pen.strength
    width = a.width_px / b.width_px
    return hue < 20 and 0.5 < strength < 2 and 0.5 < width < 2


def angle_deg(a: NDArray, b: NDArray) -> float:
    """Between two directions, 0..180."""
    cosine = np.dot(a, b) / (np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _chains(
    count: int, closed: list[bool], joins: list[tuple[_End, _End]]
) -> list[tuple[list[tuple[int, bool]], bool]]:
    """Pieces in order, each with whether it runs backwards; and whether the chain is a ring."""
    link = {}
    for a, b in joins:
        link[a.piece, a.last] = (b.piece, b.last)
        link[b.piece, b.last] = (a.piece, a.last)
    chains, seen = [], {i for i in range(count) if closed[i]}
    starts = [(i, last) for i in range(count) for last in (False, True) if (i, last) not in link]
    starts += [(i, False) for i in range(count)]  # what is left are rings
    for piece, entry in starts:
        if piece in seen:
            continue
        chain, ring = [], False
        while True:
            seen.add(piece)
            chain.append((piece, entry))
            onward = link.get((piece, not entry))
            if onward is None:
                break
            if onward[0] in seen:
                ring = True
                break
            piece, entry = onward
        chains.append((chain, ring))
    return chains


def _chain(
    chain: tuple[list[tuple[int, bool]], bool], paths: list[NDArray], lines: list[Mark]
) -> Candidate:
    order, ring = chain
    runs = [paths[i][::-1] if backwards else paths[i] for i, backwards in order]
    parts, bridged = [runs[0]], [np.zeros(len(runs[0]), bool)]
    for run in [*runs[1:], *([runs[0][:1]] if ring else [])]:
        filling = _straight(parts[-1][-1], run[0])
        body = run if run is not runs[0][:1] else run[:0]
        if ring and len(run) == 1:
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
    elif tuple(path[0][::-1] + path[0].sum() * 1e3) > tuple(path[-1][::-1] + path[-1].sum() * 1e3):
        path, bridged = path[::-1], bridged[::-1]
    return Candidate(path, candidate.closed, bridged, candidate.marks)


def _signed_area(path: NDArray) -> float:
    after = np.roll(path, -1, 0)
    return float(np.sum(path[:, 0] * after[:, 1] - after[:, 0] * path[:, 1])) / 2
