"""Pieces of ink with their skeletons' branches and junctions, joined over pen lifts into lines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import compress, product

import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.curve import tuned
from vfplan.curve.coverage import Ink, Pixels
from vfplan.errors import CurveError
from vfplan.fixture import Stroke
from vfplan.geometry.lines import Array, Flags, arc_lengths, evenly, length_of, ring_of

# Dots of a dotted line at least: fewer may be specks in a row.
MIN_DOTS = 8

# Pieces of ink at most among which it is looked for: the distances of all pairs are taken.
MAX_DOTS = 600

# Lines, the longest, that are joined over gaps at most: the distances of all pairs are taken.
MAX_JOINED = 300

# Deviation [px] of a dotted line: dots lie on their line to a fraction of their size.
DOT_SIGMA_PX = 0.3

# Times by which a staircase of pixels is longer than its line.
STAIR = 1.05


@dataclass(frozen=True, eq=False)
class Candidate:
    """One or several pieces of ink that may be the line, joined over gaps; not measured yet.

    Parameters
    ----------
    path
        (M, 2) (u, v) about a point a pixel, with straight runs over the gaps [px].
    closed
        Whether the last point joins the first.
    bridged
        (M,) bool, the points in gaps.
    junctions
        (J, 2) where the line forks or crosses itself [px].
    length, width
        Of the drawn line, and of the pen [px].
    strength
        Mean coverage along the path.
    pieces
        (N, 2) the pixels (u, v) of each piece of ink that it was joined from.
    """

    path: Array
    closed: bool
    bridged: Flags
    junctions: Pixels
    length: float
    width: float
    strength: float
    pieces: tuple[Pixels, ...]

    @property
    def middle(self) -> Array:
        """(2,) the point in the middle of its path."""
        return self.path[len(self.path) // 2]

    @property
    def ink_px(self) -> int:
        """How many pixels of ink it has."""
        return sum(len(pixels) for pixels in self.pieces)

    @property
    def may_go_on(self) -> bool:
        """Whether it has two plain ends that a gap may join to others."""
        return not self.closed and len(self.junctions) == 0 and len(self.path) > 4

    def tangent(self, end: int) -> Array:
        """(2,) unit direction in which the line would go on at its first (0) or last (-1) point."""
        run = self.path[::-1] if end == -1 else self.path
        bent = round(self.width / 2)
        run = run[: tuned.TANGENT_PX + bent]
        run = run[min(bent, len(run) // 3) :]  # Thinning bends the last pixels.
        degree = 2 if len(run) > tuned.TANGENT_PX // 2 else 1
        slope = np.polynomial.polynomial.polyfit(np.arange(len(run)), run, degree)[1]
        return -slope / max(np.hypot(*slope), 1e-9)

    def backwards(self) -> Candidate:
        """The same line from its other end."""
        return replace(self, path=self.path[::-1], bridged=self.bridged[::-1])

    def in_order(self) -> Candidate:
        """The line from the end closer to the top left corner; a ring from there, clockwise."""
        if not self.closed:
            return self if self.path[0].sum() <= self.path[-1].sum() else self.backwards()
        u, v = self.path.T
        is_clockwise = (u * np.roll(v, -1) - v * np.roll(u, -1)).sum() >= 0
        line = self if is_clockwise else self.backwards()
        start = -int(np.argmin(line.path.sum(1)))
        path = np.roll(line.path, start, axis=0)
        return replace(line, path=path, bridged=np.roll(line.bridged, start))


# Lines of ink in the order of their numbers, or some of them.
Candidates = list[Candidate]


def branches_of(bone: Flags) -> tuple[list[tuple[Pixels, bool]], Pixels]:
    """The pixels (u, v) of each branch of a skeleton in order, and whether it is a ring.

    Also returns the (J, 2) pixels at which three or more branches meet. The (H, W) skeleton has a
    border of one free pixel. The branches come in the order of their first pixels, by row.
    """
    pixels, edges = skeleton_graph(bone)
    junction = np.bincount(edges.ravel(), minlength=len(pixels)) > 2
    inner = edges[~junction[edges].any(1)].tolist()
    beside: list[list[int]] = [[] for _ in pixels]
    for a, b in inner:
        beside[a].append(b)
        beside[b].append(a)
    waiting = ~junction
    branches = []
    for start in np.flatnonzero(waiting).tolist():
        if waiting[start] and len(beside[start]) < 2:
            branches.append((_walk(start, beside, waiting), False))
    # What is left are rings. Each is cut between two neighbours, and walked the other way.
    for start, _ in inner:
        if waiting[start]:
            branches.append((_walk(start, beside, waiting), True))
    branches.sort(key=lambda branch: min(branch[0]))
    return [(pixels[branch], closed) for branch, closed in branches], pixels[junction]


def skeleton_graph(bone: Flags) -> tuple[Pixels, Pixels]:
    """The pixels (N, 2) (u, v) of a skeleton by rows, and the (E, 2) pairs of neighbours.

    Two diagonal neighbours that share a straight one are no edge: the corner of a stair is no fork.
    """
    v, u = np.nonzero(bone)
    place = v * bone.shape[1] + u
    pairs = []
    for dv, du in ((0, 1), (1, 0), (1, 1), (1, -1)):
        wanted = place + dv * bone.shape[1] + du
        target = np.minimum(np.searchsorted(place, wanted), len(place) - 1)
        keep = place[target] == wanted
        if dv and du:
            keep &= ~bone[v + dv, u] & ~bone[v, u + du]
        pairs.append(np.column_stack([np.flatnonzero(keep), target[keep]]))
    return np.column_stack([u, v]), np.concatenate(pairs)


def walked_back(before: NDArray, start: int, stop: int) -> list[int]:
    """The way from `start` to `stop` through a graph, by each place's predecessor."""
    path = [stop]
    while path[-1] != start:
        path.append(before[path[-1]])
    return path[::-1]


def _walk(start: int, beside: list[list[int]], waiting: Flags) -> list[int]:
    """A branch from one of its pixels on; its pixels wait no longer."""
    path = []
    ahead = [start]
    while ahead:
        path.append(ahead[-1])
        waiting[ahead[-1]] = False
        ahead = [k for k in beside[ahead[-1]] if waiting[k]]
    return path


def box_of(pixels: Pixels, border: int = 0) -> tuple[Flags, Pixels]:
    """(H, W) bool of the pixels (N, 2) in the box around them, and (2,) its first pixel."""
    corner = pixels.min(0) - border
    columns, rows = pixels.max(0) - corner + border + 1
    box = np.zeros((rows, columns), bool)
    u, v = (pixels - corner).T
    box[v, u] = True
    return box, corner


def connected(pixels: Pixels) -> list[Pixels]:
    """The rows of the pixels (N, 2) of each connected piece."""
    import cv2

    if len(pixels) == 0:
        return []
    box, corner = box_of(pixels)
    kind = cv2.CV_32S if len(pixels) >= 2**16 else cv2.CV_16U  # There may be as many pieces.
    _, labels = cv2.connectedComponents(box.view(np.uint8), connectivity=8, ltype=kind)
    u, v = (pixels - corner).T
    label = labels[v, u].astype(np.int64)
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)


def find_groups(ink: Ink) -> list[Pixels]:
    """The pixels (N, 2) of each connected piece of ink that is no speck.

    Raises `CurveError` where there are more than anybody draws.
    """
    groups = [ink.pixels[rows] for rows in connected(ink.pixels) if len(rows) >= tuned.SPECK_PX]
    if len(groups) > tuned.MAX_PIECES:
        raise CurveError(
            f"There are {len(groups)} pieces of ink in the pen's colour, so this is noise or a "
            "coloured picture. Look in a part of it: --roi U,V,WIDTH,HEIGHT.",
            code="too-many-pieces",
            numbers={"pieces": len(groups), "pieces_max": tuned.MAX_PIECES},
        )
    return groups


def pen_mask(ink: Ink, groups: list[Pixels]) -> Flags:
    """(H, W) bool, the pixels that the pen covers by half of its own strength.

    Unlike `Ink.mask` it is not smoothed, so a crisp line is as wide in it as it was drawn.
    """
    mask = np.zeros(ink.mask.shape, bool)
    for group in groups:
        u, v = half_covered(ink, group).T
        mask[v, u] = True
    return mask


def half_covered(ink: Ink, pixels: Pixels) -> Pixels:
    """Those of a piece's pixels that have half of its own strength."""
    coverage = ink.coverage_at(pixels)
    return pixels[coverage > tuned.HALF * np.quantile(coverage, 0.9)]


def find_pieces(ink: Ink, groups: list[Pixels]) -> Candidates:
    """The line of every piece of ink that may be one or a part of one, the longest first."""
    large = [group for group in groups if np.ptp(group, axis=0).max() > tuned.SPECK_PX]
    lines = [line for group in large if (line := _line_of(group, ink)) is not None]
    return sorted(lines, key=lambda line: (-line.length, *line.path[0]))


def _line_of(pixels: Pixels, ink: Ink) -> Candidate | None:
    """The longest branch of a piece; `None` where its skeleton is a pixel or junctions only."""
    box, corner = box_of(pixels, 2)
    branches, junctions = branches_of(_core.thinned(box).astype(bool))
    if len(junctions) and max(box.shape) > tuned.CRUMB_PX / 2:  # A letter has no handles.
        branches, junctions = branches_of(_without_handles(box))
    if not branches:
        return None
    path, closed = max(branches, key=lambda branch: len(branch[0]))
    path = path + corner
    drawn_px = sum(_length(*branch) for branch in branches)
    length, width = _length(path, closed), len(pixels) / drawn_px
    return Candidate(
        path.astype(float),
        closed and len(junctions) == 0,
        np.zeros(len(path), bool),
        junctions + corner,
        length,
        width,
        strength_along(ink, path),
        (pixels,),
    )


def _without_handles(box: Flags) -> Flags:
    """The skeleton of a piece of ink, through the handles that a program draws on an outline.

    The hole of a hollow handle counts as ink, and a branch that ends within the ink around its
    junction, as in the corner of a square, or within half a handle, is none.
    """
    import cv2

    inked, box = box, box.astype(np.uint8)
    _, labels, holes, _ = cv2.connectedComponentsWithStats(1 - box, connectivity=4)
    size = holes[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
    size[labels[0, 0]] = tuned.HANDLE_PX  # What lies around the piece is no hole.
    box |= (size < tuned.HANDLE_PX)[labels].astype(np.uint8)
    bone = _core.thinned(box.astype(bool)).astype(bool)
    to_paper = cv2.distanceTransform(box, cv2.DIST_L2, 5)
    while True:
        branches, junctions = branches_of(bone)
        crowd = cv2.filter2D(bone.astype(np.uint8), -1, np.ones((3, 3), np.uint8))
        spurs = []
        for path, _ in branches if len(junctions) else []:
            to_junction = np.abs(junctions[:, None] - path[[0, -1]]).max(2).min(1)
            u, v = junctions[to_junction.argmin()]
            # An end has a single neighbour.
            is_free = crowd[tuple(path[[0, -1]].T[::-1])].min() <= 2
            if is_free and len(path) <= max(tuned.SPUR_RADII * to_paper[v, u], tuned.HANDLE_PX / 2):
                spurs.append(path)
        if len(spurs) in (0, len(branches)):
            # A line does not run in holes, as the way through a letter does.
            return bone if inked[bone].mean() > tuned.HALF else _core.thinned(inked).astype(bool)
        bone[tuple(np.concatenate(spurs).T[::-1])] = False
        bone = _core.thinned(bone).astype(bool)


def _length(path: NDArray, closed: bool) -> float:
    """Length along pixels, less what the staircase adds [px]."""
    return length_of(path, closed) / STAIR + 1.0


def find_candidates(pieces: Candidates, max_gap_px: float) -> Candidates:
    """The lines of pieces, joined over gaps where tangents agree; the longest first."""
    # A dot and a panel are no part of a line.
    lines = [piece for piece in pieces if piece.length >= tuned.MIN_ASPECT / 2 * piece.width]
    while pair := _best_gap(lines, max_gap_px):
        lines = _joined(lines, *pair)
    long = [line for line in lines if line.length >= tuned.MIN_ASPECT * line.width]
    return sorted(long, key=lambda line: (-line.length, *line.path[0]))


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
    ends = "natural" if len(clicks) == 3 else "not-a-knot"
    if closed:
        ends = "periodic"
    spline = CubicSpline(arc, ring_of(clicks, closed), bc_type=ends)
    dense = spline(np.linspace(0.0, arc[-1], 4 * max(2, round(arc[-1])) + 1))
    return evenly(dense[: len(dense) - closed], closed)


def dotted_line(ink: Ink, groups: list[Pixels]) -> Stroke | None:
    """The line through the middles of dots in a row; `None` where the pen drew none.

    Its deviation is that of a hand which sets dots on a line.
    """
    from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree
    from scipy.spatial.distance import cdist

    if not MIN_DOTS <= len(groups) <= MAX_DOTS:
        return None
    sides, areas = np.array([(np.ptp(group, axis=0).max() + 1, len(group)) for group in groups]).T
    # JPEG leaves specks beside dots, which are much smaller.
    is_dot = areas >= np.median(areas) / tuned.ALIKE**2
    is_dot &= sides <= tuned.ALIKE * np.median(sides)
    dots = list(compress(groups, is_dot))
    weights = [ink.coverage_at(group).astype(float) for group in dots]
    places = np.array([w @ dot / w.sum() for w, dot in zip(weights, dots, strict=True)])
    apart = cdist(places, places)
    np.fill_diagonal(apart, np.inf)
    spacing = float(np.median(apart.min(axis=0)))
    # The longest way from dot to dot, without a step of more than twice the usual.
    near = np.where(apart <= tuned.ALIKE * spacing, apart, 0.0)
    way, before = dijkstra(minimum_spanning_tree(near), directed=False, return_predecessors=True)
    way[np.isinf(way)] = -1.0
    start, stop = np.unravel_index(way.argmax(), way.shape)
    path = walked_back(before[start], start, stop)[::-1]
    # Letters are dots as well, but stand too close; noise lies all over the picture.
    is_row = len(path) >= max(MIN_DOTS, tuned.HALF * len(dots))
    if not is_row or spacing < np.median(sides[is_dot]):
        return None
    closed = bool(apart[start, stop] <= tuned.ALIKE * spacing)
    points = path_through(places[path], closed)
    sigma = np.full(len(points), DOT_SIGMA_PX)
    area = areas[is_dot][path].mean()
    return Stroke(points, closed, sigma, width=float(np.sqrt(4 * area / np.pi)))


def _best_gap(lines: Candidates, max_gap_px: float) -> tuple[int, int, int, int] | None:
    """The gap that is bridged at the least cost, as (line, end, line, end)."""
    longest = sorted((i for i, line in enumerate(lines) if line.may_go_on),
                     key=lambda i: -lines[i].length)[:MAX_JOINED]  # fmt: skip
    ends = [(i, end) for i in sorted(longest) for end in (0, -1)]
    places = np.array([lines[i].path[end] for i, end in ends]).reshape(-1, 2)
    apart = np.hypot(*np.moveaxis(places[:, None] - places, 2, 0))
    reach = max_gap_px + max((line.width for line in lines), default=0.0) + tuned.FLANK_PX
    lowest_cost, best = np.inf, None
    for a, b in np.argwhere(np.triu(apart <= reach, 1)):
        (i, end_i), (j, end_j) = ends[a], ends[b]
        one, other = lines[i], lines[j]
        gap = gap_px(one, end_i, other, end_j)
        turns = _turns_deg(one, end_i, other, end_j)
        # One pen went on over it, so that it bends little. The less it bends, the less it costs.
        if gap > min(max_gap_px, one.length, other.length) or max(turns) > tuned.MAX_TURN_DEG:
            continue
        cost = max(gap, 0.0) + apart[a, b] * sum(turns) / tuned.MAX_TURN_DEG
        if cost < lowest_cost and _same_pen(one, other):
            lowest_cost, best = cost, (i, end_i, j, end_j)
    return best


def gap_px(one: Candidate, end: int, other: Candidate, other_end: int) -> float:
    """Pixels of paper between the ends of two lines, which their round tips stand out from."""
    across = other.path[other_end] - one.path[end]
    return float(np.hypot(*across) - (one.width + other.width) / 2)


def gap_ahead(line: Candidate, other: Candidate) -> tuple[float, Array, Array]:
    """The gap over which another line goes on from a line; infinite where it does not [px].

    It may be too long to be bridged. A part of the line counts that is long beside the gap, or that
    has a direction of its own beyond a gap which is short beside the line. Also returns the ends
    (u, v) of the line and of the other one at the gap.
    """
    nearest = np.inf, line.path[-1], other.path[0]
    if not (line.may_go_on and other.may_go_on and _same_pen(line, other)):
        return nearest
    longest = tuned.AHEAD_LENGTHS * min(line.length, other.length)
    if other.length > tuned.TANGENT_PX:
        longest = max(longest, tuned.AHEAD_SHARE * line.length)
    for end, other_end in product((0, -1), repeat=2):
        gap = gap_px(line, end, other, other_end)
        turn = max(_turns_deg(line, end, other, other_end))
        if gap <= longest and turn <= tuned.MAX_TURN_DEG and gap < nearest[0]:
            nearest = gap, line.path[end], other.path[other_end]
    return nearest


def is_open_ring(line: Candidate) -> bool:
    """Whether the ends of an open line face each other, so that it may be a ring."""
    return line.may_go_on and max(_turns_deg(line, -1, line, 0)) <= tuned.MAX_TURN_DEG


def _turns_deg(one: Candidate, end: int, other: Candidate, other_end: int) -> tuple[float, float]:
    """By how many degrees each of two lines turns at its end to run straight over the gap."""
    across = other.path[other_end] - one.path[end]
    # An end may lie two pixels off its line, which is a large angle over a short gap.
    slack = np.degrees(np.arctan2(tuned.FLANK_PX, np.hypot(*across)))
    cosines = np.array([one.tangent(end), -other.tangent(other_end)]) @ across
    turns = np.degrees(np.arccos(np.clip(cosines / max(np.hypot(*across), 1e-9), -1, 1)))
    return tuple((turns - slack).clip(0.0).tolist())


def strength_along(ink: Ink, path: NDArray) -> float:
    """The mean coverage along a path."""
    return float(ink.coverage_at(path).mean(dtype=np.float32))


def _same_pen(one: Candidate, other: Candidate) -> bool:
    pairs = (one.width, other.width), (one.strength, other.strength)
    return all(1 / tuned.ALIKE < x / max(y, 1e-9) < tuned.ALIKE for x, y in pairs)


def _joined(lines: Candidates, i: int, end_i: int, j: int, end_j: int) -> Candidates:
    """The lines with two of them joined at these ends, or one closed to a ring."""
    one, other = lines[i], lines[j]
    others = [line for k, line in enumerate(lines) if k not in (i, j)]
    one = one.backwards() if end_i == 0 else one
    other = other.backwards() if end_j == -1 else other
    other = one if i == j else other
    start, stop = one.path[-1], other.path[0]
    steps = max(1, round(np.hypot(*(stop - start))))
    gap = start + np.arange(1, steps)[:, None] / steps * (stop - start)
    path = np.vstack([one.path, gap])
    bridged = np.concatenate([one.bridged, np.ones(len(gap), bool)])
    length = one.length + steps
    if i == j:
        return [*others, replace(one, path=path, bridged=bridged, closed=True, length=length)]
    share = one.length / (one.length + other.length)
    both = replace(
        one,
        path=np.vstack([path, other.path]),
        bridged=np.concatenate([bridged, other.bridged]),
        length=length + other.length,
        width=share * one.width + (1 - share) * other.width,
        strength=share * one.strength + (1 - share) * other.strength,
        pieces=one.pieces + other.pieces,
    )
    return [*others, both]
