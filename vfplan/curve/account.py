"""All ink that is not the curve's, and the places that a person should look at."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vfplan import _core
from vfplan.curve import choose, tuned
from vfplan.curve.candidates import (
    Candidate,
    Candidates,
    box_of,
    connected,
    find_pieces,
    gap_ahead,
    gap_px,
    half_covered,
    is_open_ring,
    strength_along,
)
from vfplan.curve.centreline import MeasuredStroke, middle_of
from vfplan.curve.choose import finding_at
from vfplan.curve.coverage import OTHER_UNIT, Box, Ink, Pen, Pixels, brightness
from vfplan.findings import Finding, note
from vfplan.fixture import Stroke
from vfplan.geometry.lines import Array, Flags, evenly, normals, running_median, runs, windows

# Pieces of ink of one sort that have a finding of their own; the account lists all.
NAMED = 3

# Share of a stroke that lies beyond a gap, below which it may be a leader line or a letter. Of 500
# leader lines of tests/making/as_people_draw.py none had more than 0.19. People lift the pen along
# the whole of a line: with 0.2, 17 % of the slices with two lifts are asked about, with 0.25, 46 %.
NEAR_END_SHARE = 0.2

# The same where that part runs straight or is thin, as leader lines and letters' strokes are. Of
# 21 leader lines that were bridged none had more than 0.33.
LEADER_SHARE = 0.35

# Pixels to either side of a corner that the spline rounds.
ROUNDED_PX = 4

# Pixels beyond a corner that run straight, and the range of their headings at most [degrees].
LEADER_PX, LEADER_DEG = 40, 14.0

# Times the longest gap that is bridged, up to which a person is asked whether a line goes on beyond
# it, and is offered the lines joined over it. Hands that lift a pen put it down again before that.
JOINED_GAPS = 3.0

# Degrees of a corner from which a straight stretch beyond it may be a leader line. Of 29 leader
# lines that left the end of a curve by 35 degrees or more 28 are asked about; of 312 open curves of
# tests/making/extraction_kinds.py, 1.
MIN_CORNER_DEG = 30.0

# Degrees of a corner from which a stretch beyond it, too short to be straight, may be a letter's
# stroke. At 1,920 ends of clear lines of tests/making/extraction_kinds.py all turned by 56 at most
# but one line that was wrong; letters L and T that an end ran into turned by 75 and more.
HOOK_DEG = 65.0

# Points of the curve that are held against all later ones at once.
FOLD_ROWS = 256

# Most of those later ones. More lie near each other only where a curve runs often over itself.
FOLD_COLUMNS = 1024

# Largest cosine of the turn with which a stroke runs back on its own ink; a corner turns by less.
MAX_BACK_COSINE = -0.8

# Largest cosine of the angle at which two stretches cross; at a smaller angle they are a fold.
MAX_CROSSING_COSINE = 0.9


@dataclass(frozen=True, eq=False)
class Leftover:
    """A connected piece of ink beyond the edge of every curve.

    Parameters
    ----------
    places
        (N, 2) its pixels (u, v).
    middle
        (2,) its pixel that is closest to the middle of the box around it; the place that findings
        and lists name.
    nearest
        (2,) its pixel that is closest to a curve.
    size
        Its longest side [px].
    edge_distance
        From the closest curve's edge to its closest pixel [px].
    end_distance
        From the closest end of an open curve to its closest pixel [px].
    is_ahead
        Whether it lies in the direction of that end, or is about as strong as the curve.
    is_onward
        Whether it lies in that direction, is about as strong, and is a line that runs along it.
    is_dot
        Whether it is too short beside the pen's width to carry a line on.
    """

    places: Pixels
    middle: NDArray[np.int64]
    nearest: NDArray[np.int64]
    size: float
    edge_distance: float
    end_distance: float
    is_ahead: bool
    is_onward: bool
    is_dot: bool

    @property
    def touches(self) -> bool:
        """Whether it reaches the blurred edge of a curve."""
        return self.edge_distance <= 2 * tuned.EDGE_BLUR_PX

    def is_at_end(self, max_gap_px: float) -> bool:
        """Whether it lies so near to an end that it may carry the curve on."""
        is_near = self.end_distance <= tuned.END_REACH_GAPS * max_gap_px
        return is_near and self.is_ahead and not self.is_dot

    @property
    def mask(self) -> Flags:
        """(height, width) bool, its pixels in the box around it."""
        return box_of(self.places)[0]

    @property
    def outline(self) -> list[list[list[float]]]:
        """Its outlines, half a pixel outside of it: a list of (K, 2) places."""
        import cv2

        padded = np.pad(self.mask.view(np.uint8), 1)
        contours, _ = cv2.findContours(padded, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        corner = self.places.min(0) - 1.0
        return [(contour[:, 0] + corner).round(1).tolist() for contour in contours]


@dataclass(frozen=True, eq=False)
class AccountEntry:
    """A piece of ink that was not taken for the curve, or a stretch of curve that does not show.

    Parameters
    ----------
    number
        From 1, the largest first.
    u, v
        Its middle [px].
    pixels
        How many pixels it has; of a stretch, how many points of the curve.
    share
        The same, over all pixels of the pen's ink.
    size_px
        Its longest side; of a stretch, its length.
    what
        "ink", or of a stretch "bridge" (a gap) or "hidden" (under another colour).
    piece
        The ink; `None` of a stretch.
    """

    number: int
    u: float
    v: float
    pixels: int
    share: float
    size_px: float
    what: Literal["ink", "bridge", "hidden"]
    piece: Leftover | None = None

    @property
    def middle(self) -> tuple[float, float]:
        """(u, v) [px]."""
        return self.u, self.v

    @property
    def box(self) -> Box:
        """(u, v, width, height) [px] of the ink."""
        low = self.piece.places.min(0)
        return (*low.tolist(), *(self.piece.places.max(0) - low + 1).tolist())


def find_leftover(ink: Ink, curves: Sequence[Stroke]) -> list[Leftover]:
    """The ink beyond the curves' own edges, piece by piece, the largest first."""
    edge_distance = np.full(len(ink.pixels), np.inf)
    for curve in curves:
        points = curve.points
        if np.hypot(*np.diff(points, axis=0).T).max(initial=0) > 2 * tuned.EDGE_BLUR_PX:
            points = evenly(points, curve.closed)
        to_curve, _ = _core.nearest(points, ink.pixels)
        edge_distance = np.minimum(edge_distance, to_curve - curve.width / 2)
    outside = edge_distance > tuned.EDGE_BLUR_PX
    pixels, edge_distance = ink.pixels[outside], edge_distance[outside]
    least_size = tuned.MIN_ASPECT / 2 * min((curve.width or 0.0 for curve in curves), default=0.0)
    pieces = []
    for members in connected(pixels):
        if len(members) >= tuned.SPECK_PX:
            places = pixels[members]
            end_distance, is_ahead, is_onward = _to_end(ink, places, curves)
            low, high = places.min(0), places.max(0)
            size = float((high - low).max() + 1)
            piece = Leftover(
                places=places,
                middle=places[np.hypot(*(places - (low + high) / 2).T).argmin()],
                nearest=places[edge_distance[members].argmin()],
                size=size,
                edge_distance=float(edge_distance[members].min()),
                end_distance=end_distance,
                is_ahead=is_ahead,
                is_onward=is_onward and size >= least_size,
                is_dot=size < least_size,
            )
            pieces.append(piece)
    return sorted(pieces, key=lambda piece: (-len(piece.places), *piece.middle))


def _to_end(ink: Ink, places: NDArray, curves: Sequence[Stroke]) -> tuple[float, bool, bool]:
    """How far ink is from the end closest to it [px], and its `is_ahead` and `is_onward`."""
    distance, is_ahead, is_onward = np.inf, False, False
    for curve in curves:
        for end, heading in zip(curve.end_points, headings_of(curve), strict=False):
            away = np.hypot(*(places - end).T)
            if away.min() < distance:
                distance = float(away.min())
                # So far an end may lie off its line.
                slack_deg = np.degrees(np.arctan2(tuned.FLANK_PX, distance))
                turn_deg = turn_between(heading, places[away.argmin()] - end) - slack_deg
                strength = strength_along(ink, half_covered(ink, places))
                is_strong = strength > tuned.PALE * strength_along(ink, curve.points)
                is_along = turn_deg <= tuned.MAX_TURN_DEG
                is_ahead = is_along or is_strong
                is_onward = is_along and is_strong and runs_from(end, places)
    return distance, bool(is_ahead), bool(is_onward)


def turn_between(one: NDArray, other: NDArray) -> float:
    """Degrees from 0 to 180 between two directions (u, v)."""
    return abs(np.degrees(np.angle(complex(*one).conjugate() * complex(*other))))


def runs_from(end: NDArray, places: NDArray) -> bool:
    """Whether ink is longer than wide, roughly along the way to its middle from an end."""
    middle = places.mean(axis=0)
    _, sizes, axes = np.linalg.svd(places - middle, full_matrices=False)
    turn_deg = turn_between(axes[0], middle - end)
    is_along = min(turn_deg, 180 - turn_deg) <= tuned.MAX_TURN_DEG
    return is_along and sizes[0] > tuned.ALIKE * sizes[1]


def headings_of(curve: Stroke) -> Array:
    """(2, 2) the directions in which a line would go on at its ends."""
    inward = min(tuned.TANGENT_PX, len(curve.points) - 1)
    return curve.points[[0, -1]] - curve.points[[inward, -1 - inward]]


def list_account(
    leftover: Sequence[Leftover], curves: Sequence[Stroke], ink: Ink
) -> tuple[AccountEntry, ...]:
    """All other ink, and every stretch of curve that does not show, the largest first."""
    rows: list[tuple] = [(len(one.places), one.middle, one.size, "ink", one) for one in leftover]
    rows += [
        (len(run), curve.points[middle_of(run)], float(len(run)), what)
        for curve in curves
        for what, run in _stretches(curve)
    ]
    rows.sort(key=lambda row: (-row[0], *row[1]))
    total = max(len(ink.pixels), 1)
    return tuple(
        AccountEntry(number, float(u), float(v), pixels, pixels / total, *more)
        for number, (pixels, (u, v), *more) in enumerate(rows, 1)
    )


def _stretches(curve: Stroke) -> Iterator[tuple[str, NDArray]]:
    """Each stretch of a curve at which no ink shows, as the reason and its points' numbers."""
    for run in runs(curve.bridged | curve.hidden, curve.closed):
        yield "hidden" if curve.hidden[run].any() else "bridge", run


def around(plane: NDArray, place: NDArray, reach: float) -> NDArray:
    """The pixels of a (H, W) plane that lie within reach of a place, along u and along v."""
    left, top = np.maximum(np.floor(place - reach), 0).astype(int)
    right, bottom = np.ceil(place + reach).astype(int) + 1
    return plane[top:bottom, left:right]


def end_findings(ink: Ink, curve: MeasuredStroke, leftover: list[Leftover]) -> Iterator[Finding]:
    """Another colour at an end, faint ink beyond it, and an end that is not known well.

    leftover: other ink, which has findings of its own
    """
    ends = zip(curve.points[[0, -1]], headings_of(curve), curve.ends, strict=False)
    for point, heading, end in ends:
        reach = curve.width + tuned.FLANK_PX
        other = around(ink.other, point, reach) > OTHER_UNIT * tuned.FOREIGN
        if other.sum() >= tuned.SPECK_PX:
            text = "another colour lies at the end of the curve. Does it hide more of the curve?"
            yield finding_at(point, "end-other-colour", text)
        to_border = np.minimum(point, ink.size - 1 - point).min()
        if to_border <= tuned.FLANK_PX:
            continue
        if is_at_cover(ink, point, heading, curve.width, to_border):
            text = "the curve ends where an even grey begins. Does it hide more of the curve?"
            yield finding_at(point, "end-other-colour", text)
        is_listed = any(
            not piece.is_dot and np.hypot(*(piece.nearest - point)) <= tuned.TAPER_REACH_PX
            for piece in leftover
        )
        if end.continues and not is_listed:
            text = "faint ink goes on beyond the end. Does the curve go on?"
            yield finding_at(point, "ink-at-end", text)
        if end.sigma > tuned.UNSURE_PX:
            text = f"the end of the curve is known to {end.sigma:.1f} px only. Is it right?"
            yield finding_at(point, "end-unsure", text)


def is_at_cover(ink: Ink, end: NDArray, heading: NDArray, width: float, to_border: float) -> bool:
    """Whether a line ends where a grey begins that is more even than the ground beside it.

    heading: (2,) in which the line would go on
    to_border: from the end to the picture's border [px]
    """
    # As complex numbers: a square ahead, and one behind to either side of the line.
    onward = complex(*heading) / max(np.hypot(*heading), 1e-9)
    along = np.arange(tuned.COVER_PX)
    out = (width / 2 + 2 * tuned.FLANK_PX + along)[:, None]
    ways = ((1, 1j), (1j - 1, 1), (-1j - 1, 1))
    squares = [out * way + (along - tuned.COVER_PX // 2) * aside for way, aside in ways]
    squares = complex(*end) + onward * np.array(squares)
    ahead, *beside = brightness(ink.rgb, squares.real, squares.imag)
    if to_border <= out[-1] + tuned.COVER_PX:
        return False
    rough = [float(ground.std()) for ground in beside]
    step = min(abs(ahead.mean() - ground.mean()) for ground in beside)
    if min(rough) <= tuned.COVER_GROUND or ahead.mean() <= tuned.COVER_BLACK:
        return False  # The ground may be as even, as the air around a body is.
    if np.ptp(ahead) <= tuned.COVER_FLAT:
        return max(rough) < tuned.COVER_EDGE
    # JPEG makes a cover uneven. Then the ground must be plainly another grey, and no edge of bone.
    is_even = ahead.std() <= min(tuned.COVER_EVEN, tuned.COVER_SHARE * step)
    return bool(is_even and step > tuned.COVER_STEP and max(rough) < tuned.COVER_EDGE_NOISY)


def leftover_findings(leftover: Sequence[Leftover], max_gap_px: float) -> Iterator[Finding]:
    """The largest pieces of ink close to an end, and of ink that touches the curve."""
    reach = tuned.END_REACH_GAPS * max_gap_px
    dots = [p for p in leftover if p.is_dot and not p.touches and p.end_distance <= reach]
    # One dot carries no line on, while several are dashes, or a pen that ran dry.
    dashes = dots if len(dots) > 1 else []
    at_end = [p for p in leftover if p.is_at_end(max_gap_px) or p in dashes]
    touching = [p for p in leftover if p.touches and p not in at_end]
    for piece in at_end[:NAMED]:
        text = (
            f"ink of {piece.size:.0f} px lies {piece.end_distance:.0f} px from the end of the "
            "curve. Does the curve go on there?"
        )
        yield finding_at(piece.middle, "ink-at-end", text)
    for piece in touching[:NAMED]:
        text = f"ink of {piece.size:.0f} px touches the curve. Is it a part of the curve?"
        yield finding_at(piece.middle, "ink-touches", text)


def doubts_of_line(line: Candidate, lines: Candidates, ink: Ink, pen: Pen) -> list[Finding]:
    """What makes a line look like a part of the picture's surroundings, and what to take instead.

    A bar on the border, a scale, a box or an icon is told apart by where it lies, its shape and its
    length; and ink that outweighs the line is named.
    """
    doubts = []
    pen_px = len(ink.pixels)
    flush = choose.on_border(line, ink)
    if len(flush) >= tuned.WIDE_RUN_WIDTHS * line.width:
        text = f"{len(flush)} px of the curve lie flush with the picture's border. Is it a frame?"
        middle = flush[np.hypot(*(flush - np.median(flush, axis=0)).T).argmin()]
        doubts.append(finding_at(middle, "curve-on-border", text))
    elif choose.is_frame(line, ink) or choose.is_level(line):
        text = "the curve runs straight along rows and columns. Is it a bar, a box or a scale?"
        doubts.append(finding_at(line.middle, "curve-straight", text))
    if line.length < tuned.CRUMB_PX:
        text = f"the curve is {line.length:.0f} px long only. Is it a part of a letter or a sign?"
        doubts.append(finding_at(line.middle, "curve-short", text))
    for number, other in enumerate(choose.in_number_order(lines, ink), 1):
        size, times = np.ptp(other.path, axis=0), other.ink_px / line.ink_px
        # A frame around the whole picture is expected.
        is_around = (size >= tuned.FRAME_SHARE * ink.size).all()
        if is_around and other.pieces is not line.pieces:
            pen_px -= other.ink_px
        if times > 1 and size.max() > np.ptp(line.path, axis=0).max() and not is_around:
            # No number takes a line that forks.
            way = "vfplan review IMAGE" if len(other.junctions) else f"--stroke {number}"
            text = (
                f"line {number} has {times:.1f} times the ink of the curve. If it is meant: {way}."
            )
            doubts.append(finding_at(other.middle, "ink-outweighs", text))
    share = line.ink_px / pen_px
    if share < tuned.SMALL_SHARE and not any(f.code == "ink-outweighs" for f in doubts):
        text = f"the curve is {share:.0%} of the pen's ink only. Is the curve meant?"
        doubts.append(finding_at(line.middle, "ink-outweighs", text))
    if not doubts and line.length >= 2 * tuned.CRUMB_PX:
        return doubts
    if others := choose.lines_of_other_pens(ink, pen, line.length / tuned.RIVAL_SHARE):
        text = f"another pen drew a longer line. If it is meant: {choose.advice_on_pens(others)}."
        doubts.insert(0, finding_at(others[0][1].middle, "ink-outweighs", text))
    return doubts


def shorter_findings(left: Candidates, lines: Candidates, ink: Ink) -> list[Finding]:
    """A doubt for each line that is no frame, and too short to be one of all candidates."""
    drawn = [line for line in lines if not choose.is_frame(line, ink)]
    least = tuned.SMALL_SHARE * max(line.length for line in drawn)
    text = "is shorter than half of the longest, and was not taken. Is it a part of the curve?"
    return [
        finding_at(line.middle, "line-left-out", f"a line of {line.length:.0f} px {text}")
        for line in drawn if line in left and line.length >= least
    ]  # fmt: skip


def ahead_findings(line: Candidate, others: Candidates, max_gap_px: float) -> Iterator[Finding]:
    """Lines that were left out, beyond a gap that is too long for ink at an end."""
    nearest = tuned.END_REACH_GAPS * max_gap_px - line.width
    for other in others:
        gap, _, place = gap_ahead(line, other)
        if nearest < gap < np.inf:
            text = (
                f"a line of {other.length:.0f} px begins here, beyond a gap of {gap:.0f} px from "
                "the end of the curve. Does the curve go on there?"
            )
            yield finding_at(place, "ink-at-end", text)


def gap_findings(strokes: Sequence[Candidate]) -> Iterator[Finding]:
    """A doubt for each two strokes of the curve of which one goes on in the other's direction."""
    for earlier, later in combinations(strokes, 2):
        gap, end, place = gap_ahead(later, earlier)
        if gap < np.inf:
            text = f"between two strokes of the curve is a gap of {gap:.0f} px. Is it meant?"
            yield finding_at((end + place) / 2, "ink-at-end", text)


def ring_findings(line: Candidate, max_gap_px: float) -> Iterator[Finding]:
    """An open curve whose ends face each other over a gap that is a little too long to bridge."""
    gap = gap_px(line, -1, line, 0)
    # The length comes first, because the directions of the ends want a fit and its import.
    if gap > tuned.END_REACH_GAPS * max_gap_px or not is_open_ring(line):
        return
    text = (
        f"both ends of the curve face each other over a gap of {gap:.0f} px. Is the curve a ring? "
        f"Then close it: --max-gap {np.ceil(gap):.0f}."
    )
    yield finding_at((line.path[0] + line.path[-1]) / 2, "ink-at-end", text)


def join_findings(
    leftover: Sequence[Leftover],
    lines: Sequence[Candidate],
    ink: Ink,
    max_gap_px: float,
    known: Sequence[Finding],
) -> Iterator[Finding]:
    """A doubt for each piece of ink that joins the curve, or in which a line may go on.

    There is none for a piece that a known finding on it speaks of.
    """
    # Taken before the first finding: `known` may be the list that grows by them.
    known_places = np.reshape([f.place_px for f in known if f.place_px], (-1, 2)).astype(float)
    for piece in leftover:
        away, _ = _core.nearest(piece.places.astype(float), known_places)
        if min(away, default=np.inf) < 0.6:
            continue
        if piece.touches:
            where = "joins the curve"
        elif piece.is_at_end(max_gap_px) or _goes_on(lines, piece, ink, max_gap_px):
            where = f"lies {piece.end_distance:.0f} px from the end of the curve"
        else:
            continue
        text = f"ink of {piece.size:.0f} px {where} and was left out. Is it a part of it?"
        yield finding_at(piece.middle, "ink-joins", text)


def line_of(stroke: Stroke, ink: Ink) -> Candidate:
    """A stroke as a line of ink, to ask whether other ink goes on from it."""
    none = np.zeros((0, 2), np.int64)
    return Candidate(
        stroke.points, stroke.closed, stroke.bridged, none, stroke.length, stroke.width,
        strength_along(ink, stroke.points), (),
    )  # fmt: skip


def _goes_on(lines: Sequence[Candidate], piece: Leftover, ink: Ink, max_gap_px: float) -> bool:
    """Whether a piece, or a line of its ink, carries on one of these lines from farther away."""
    if piece.is_onward and piece.end_distance <= JOINED_GAPS * max_gap_px:
        return True
    if piece.size <= tuned.TANGENT_PX or not lines:
        return False
    others = find_pieces(ink, [piece.places])
    return any(gap_ahead(line, other)[0] < np.inf for line in lines for other in others)


def fold_findings(strokes: Sequence[Stroke]) -> Iterator[Finding]:
    """A doubt for each stretch that lies on another one, or close beside, and one for crossings."""
    if not strokes:
        return
    points = np.concatenate([stroke.points for stroke in strokes])
    headings = np.concatenate([np.gradient(stroke.points, axis=0) for stroke in strokes])
    headings /= np.maximum(np.hypot(*headings.T), 1e-9)[:, None]
    steps = np.concatenate([
        np.diff(stroke.points, axis=0, append=stroke.points[[0 if stroke.closed else -1]])
        for stroke in strokes
    ])  # fmt: skip
    counts = [len(stroke.points) for stroke in strokes]
    number = np.repeat(np.arange(len(strokes)), counts)
    ring_length = np.where([stroke.closed for stroke in strokes], counts, np.inf)
    width = max(stroke.width or 0.0 for stroke in strokes)
    reach = 2 * max(width, tuned.FLANK_PX)
    is_folded, is_turned, is_crossed = np.zeros((3, len(points)), bool)
    for start in range(0, len(points), FOLD_ROWS):
        block = points[start : start + FOLD_ROWS]
        # Each point of the block is held against the later ones in the box around the block.
        is_in_box = (points >= block.min(axis=0) - reach) & (points <= block.max(axis=0) + reach)
        candidates = start + np.flatnonzero(is_in_box.all(axis=1)[start:])
        candidates = candidates[:: len(candidates) // FOLD_COLUMNS + 1]
        is_close = ((block[:, None] - points[candidates]) ** 2).sum(axis=2) <= reach**2
        earlier, later = np.nonzero(is_close)
        earlier, later = start + earlier, candidates[later]
        # Neighbours along a stroke are no fold; the ends of a closed one are neighbours.
        along = np.minimum(later - earlier, ring_length[number[earlier]] - (later - earlier))
        is_fold = number[earlier] != number[later]
        is_fold |= along > tuned.WIDE_RUN_WIDTHS * max(width, 2)
        cosine = (headings[earlier] * headings[later]).sum(axis=1)
        is_back = np.hypot(*(points[earlier] - points[later]).T) <= width
        is_back &= (cosine < MAX_BACK_COSINE) & (later > earlier)
        is_turned[earlier[is_back]] = True
        is_fold = (is_fold & (later > earlier)) | is_back
        # A crossing is no fold.
        cosine = np.abs(cosine)
        is_steep = is_fold & (cosine < MAX_CROSSING_COSINE) & (number[earlier] == number[later])
        is_fold &= cosine > np.sqrt(0.5)
        is_folded[earlier[is_fold]] = True
        earlier, later = earlier[is_steep], later[is_steep]
        # As complex numbers, of which the product has the area that two steps span.
        between, first, second = (
            rows @ [1, 1j]
            for rows in (points[later] - points[earlier], steps[earlier], steps[later])
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = (np.conj(between) * [second, first]).imag / (np.conj(first) * second).imag
        is_crossed[earlier[((shares >= 0) & (shares < 1)).all(axis=0)]] = True
    is_near_fold = windows(is_folded, 2 * tuned.SUDDEN_PX + 1, "constant").any(axis=1)
    for run in runs(is_near_fold, False):
        length = np.count_nonzero(is_folded[run])
        if length > tuned.SUDDEN_PX or is_turned[run].any():
            text = (
                f"{length} px of the curve lie on another part of it, or close beside. Was it "
                "drawn twice there, or do its ends overlap?"
            )
            yield finding_at(points[middle_of(run)], "curve-folds", text)
            is_crossed[run] = False
    if is_crossed.any():
        places = points[is_crossed]
        more = {1: "", 2: " and once more"}.get(len(places), f" and {len(places) - 1} times more")
        text = f"the curve crosses itself here{more}. Is it meant to?"
        yield finding_at(places[0], "curve-crosses", text)


def headings_along(stroke: Stroke) -> Array:
    """(M - 1,) the direction of each step along a stroke [degrees]."""
    return np.degrees(np.unwrap(np.arctan2(*np.diff(stroke.points, axis=0).T[::-1])))


def runs_straight(heading: Array) -> bool:
    """Whether a line of these headings begins straight, as a leader line does."""
    straight = heading[ROUNDED_PX:LEADER_PX]
    return len(straight) >= tuned.TANGENT_PX and np.ptp(straight) <= LEADER_DEG


def corner_findings(stroke: Stroke) -> list[Finding]:
    """A doubt for the outermost corners of an open curve, where a leader line or letter begins."""
    heading = headings_along(stroke)
    if stroke.closed or not stroke.is_ordered or len(heading) < tuned.CRUMB_PX:
        return []
    turn = choose.changes(heading, ROUNDED_PX)
    largest = windows(turn, 2 * tuned.TANGENT_PX).max(axis=1)
    corners = np.flatnonzero((turn == largest) & (turn >= MIN_CORNER_DEG))
    findings = []
    for at in sorted({*corners[:1], *corners[-1:]}):
        beyond = min(heading[:at][::-1], heading[at:], key=len)
        if runs_straight(beyond) or (len(beyond) <= tuned.TANGENT_PX and turn[at] >= HOOK_DEG):
            text = (
                f"the curve turns by {turn[at]:.0f} degrees. Do the {len(beyond)} px beyond the "
                "corner belong to the curve?"
            )
            findings.append(finding_at(stroke.points[at], "corner-near-end", text))
    return findings


def border_findings(stroke: Stroke, size: NDArray) -> list[Finding]:
    """A doubt for each end at which the line runs out of the picture."""
    reach = (stroke.width or 0.0) / 2 + tuned.FLANK_PX
    text = "the curve runs out of the picture. Is what the picture shows all that is needed?"
    return [
        finding_at(end, "leaves-picture", text)
        for end in stroke.end_points
        if min(*end, *(size - 1 - end)) <= reach
    ]


def dotted_finding(stroke: Stroke) -> Finding:
    """A doubt that a dotted line is one line."""
    text = f"the line is dotted; {stroke.length:.0f} px were taken as one line. Is that right?"
    return finding_at(middle_of(stroke.points), "line-dotted", text)


def stretch_findings(curve: Stroke) -> list[Finding]:
    """A note for each stretch of a curve that does not show.

    It is a doubt where the stretch is long, where a small share of the stroke lies beyond a gap,
    and where a ring has one gap, so that it joins both ends of a line.
    """
    findings = []
    closes = curve.closed and [reason for reason, _ in _stretches(curve)].count("bridge") == 1
    heading = headings_along(curve)
    for reason, run in _stretches(curve):
        place, length = curve.points[middle_of(run)], len(run)
        carried = f"the curve is carried across a gap of {length} px."
        if reason == "hidden":
            carried = f"another colour hides {length} px of the curve."
        # What lies beyond the gap may be a leader line or a letter, if it is short.
        beyond = min(heading[: run[0]][::-1], heading[run[-1] :], key=len)
        share = len(beyond) / len(curve.points)
        is_short = share < NEAR_END_SHARE or (share < LEADER_SHARE and runs_straight(beyond))
        is_near_end = is_short and not curve.closed and length >= tuned.FLANK_PX
        if is_near_end and reason != "hidden":
            text = f"{carried} Do the {len(beyond)} px beyond it belong to the curve?"
            if not len(beyond):
                text = f"no ink shows the last {length} px of the curve. Does it end here?"
            findings.append(finding_at(place, "bridge-near-end", text))
        elif closes and reason == "bridge" and length >= tuned.FLANK_PX:
            text = f"{carried} It joins both ends of the line. Is the curve a ring?"
            findings.append(finding_at(place, "bridge-near-end", text))
        elif length > tuned.LONG_STRETCH_PX:
            code = "stretch-hidden" if reason == "hidden" else "bridge-long"
            findings.append(finding_at(place, code, f"{carried} Does it run as drawn here?"))
        elif curve.bridged[run].any():
            findings.append(finding_at(place, "bridge", carried, note))
    return findings


def sudden_widths(curve: MeasuredStroke) -> Array:
    """(M,) changes at once of the relative width, away from ends, gaps and other colours."""
    sudden = choose.sudden_changes(choose.relative_width(curve))
    is_small = sudden <= max(tuned.SUDDEN, 1.0 / curve.width)
    return np.where(is_small | _is_expected(curve), 0.0, sudden)


def width_findings(ink: Ink, curve: MeasuredStroke) -> list[Finding]:
    """A finding where the width changes, away from ends, gaps and other colours."""
    sudden, ratio = sudden_widths(curve), choose.relative_width(curve)
    at, largest = int(sudden.argmax()), float(sudden.max())
    if largest == 0:
        unexpected = np.flatnonzero(~_is_expected(curve))
        window = max(2 * tuned.SUDDEN_PX, round(tuned.WIDE_RUN_WIDTHS * curve.width))
        if len(unexpected) < 3 * window:
            return []
        aside = (curve.width / 2 + tuned.FLANK_PX) * normals(curve.path, curve.closed)
        beside = (curve.path + np.array([aside, -aside]))[:, unexpected]
        ground = brightness(ink.rgb, *np.moveaxis(beside, 2, 0)).mean(axis=0)
        # A second run may leave the first one slowly. Medians leave out what is short.
        lasting = ratio[unexpected]
        # Programs that blend light as lamps do, and JPEG, draw a line the narrower, the brighter
        # its ground is.
        ground -= ground.mean()
        slope = ground @ lasting / max(ground @ ground, 1e-9)
        lasting = lasting - np.clip(slope, -tuned.GROUND_PX / (255 * curve.width), 0) * ground
        lasting = running_median(lasting, window)
        largest = float(np.ptp(lasting))
        if largest <= max(tuned.LASTING, tuned.LASTING_PX / curve.width):
            return []
        at = unexpected[choose.changes(lasting, (window + tuned.SUDDEN_PX) // 2).argmax()]
        ratio = running_median(ratio, 2 * tuned.SUDDEN_PX + 1)
    text = (
        f"the width of the line changes by {largest * curve.width:.1f} px. Is all of it the curve?"
    )
    # It lies in the wide stretch beside the change. Where all the rest of the line is as wide, it
    # lies in the thin one, a letter's stroke or a drawn out end.
    around = ratio[max(at - tuned.SUDDEN_PX, 0) : at + tuned.SUDDEN_PX + 1]
    is_wide = ratio > (around.min() + around.max()) / 2
    is_line = (curve.inside >= 0).all(axis=0)
    wide, thin = (
        min(runs(flags, curve.closed), key=lambda run: np.abs(run - at).min(), default=[at])
        for flags in (is_wide, ~is_wide & is_line)
    )
    is_line[thin] = False
    is_short = len(thin) < LEADER_SHARE * is_line.sum()
    is_odd = is_short and is_wide[is_line].mean() > tuned.FRAME_SHARE
    return [finding_at(curve.path[middle_of(thin if is_odd else wide)], "width-changes", text)]


def with_joined_ink(ink: Ink, curve: MeasuredStroke) -> MeasuredStroke:
    """The curve with a larger deviation where other ink may make it wide.

    The ends of a closed one may cross or overlap there, or a letter may lie on it. They pull the
    centre aside by at most half of what they add to the width. A letter does so at once, and a
    pressed pen does not.
    """
    mode = "wrap" if curve.closed else "edge"
    widest = choose.lasting_width(curve) if curve.closed else np.ones(len(curve.path))
    if sudden_widths(curve).any() or (curve.closed and width_findings(ink, curve)):
        sudden = windows(choose.relative_width(curve), tuned.SUDDEN_PX, mode).max(axis=1)
        widest = np.maximum(widest, sudden)
    wider_px = curve.width * (widest[_core.nearest(curve.path, curve.points)[1]] - 1).clip(0)
    return replace(curve, sigma=np.hypot(curve.sigma, wider_px / 4))


def _is_expected(curve: MeasuredStroke) -> Flags:
    """(M,) bool, whether a gap, another colour or an end is so close that it changes the width."""
    profiles = curve.profiles
    expected = ~curve.whole | profiles.hidden | ~profiles.is_line[:, profiles.core].all(1)
    ahead = np.gradient(curve.path, axis=0)
    turn = choose.changes(np.unwrap(np.arctan2(*ahead.T[::-1])), tuned.SUDDEN_PX // 2)
    for end, inside in zip(curve.ends, curve.inside, strict=True):
        expected |= np.abs(inside) < curve.width / 2
        fall = np.abs(inside) < end.fall + curve.width / 2
        # A letter turns off, a drawn out pen goes on.
        if np.degrees(turn[fall].max(initial=0.0)) < tuned.MAX_TURN_DEG:
            expected |= fall
    return windows(expected, tuned.SUDDEN_PX + 1).any(axis=1)
