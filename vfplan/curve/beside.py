"""Ink beside a measured curve: what it leaves, each piece with its kind, and dots that touch it.

A dot of the same pen moves the measured line along, so it is not told by its distance from that. It
makes the ink wide over a short run, and the line leaves the way on which it comes and goes on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate
from vfplan.curve.marks import LEADER, Mark
from vfplan.curve.path import normals, runs
from vfplan.curve.ridge import Centreline

EDGE_PX = 1.5  # beyond half a width from the curve ink is its own blur
LEAST_PIXELS = 3

# Of the usual width, and a pixel and a half more: ink of more than the line. From one to so many
# widths long, and so many of line on either side say where it runs.
WIDE, WIDE_PX, LONGEST, FLANK = 1.4, 1.5, 4.0, 3.0
# So many widths beyond the wide ink the line is seen to come and to go. It leaves its way by so
# much; ink to both sides of that, on the one more than such a share of the other, is a bead.
MARGIN, OFF_PX, BOTH = 0.6, 0.8, 0.6
PRESSED = 4.0  # times the widths' own spread: a pen that is pressed varies all along
STEP_PX, SPARE_PX = 0.5, 6
SLIM = 3.0  # times longer than wide: a leader
TURN_DEG, TURN_WIDTHS = 40.0, 1.5  # over so many widths: a sign's turn
END_PX = 25.0  # so near an end what leaves the line may carry it on


@dataclass(frozen=True, eq=False)
class Piece:
    """Connected ink that the curve does not explain."""

    pixels: NDArray[np.int64]  # (N, 2) int64 (u, v)
    kind: str  # "own" where it hangs together with the curve, else what its mark was taken for
    # (2,) its centre, and the unit direction in which it extends
    middle: NDArray[np.float64]
    along: NDArray[np.float64]
    # Along that direction, and its area over that length
    length_px: float
    width_px: float

    @classmethod
    def of_pixels(cls, pixels: NDArray, kind: str) -> Piece:
        """Measure connected pixels."""
        middle = pixels.mean(0)
        off = pixels - middle
        along = np.linalg.svd(off.T @ off)[0][:, 0]
        length = float(np.ptp(off @ along)) + 1.0
        return cls(pixels, kind, middle, along, length, len(pixels) / length)


def pieces_beside(
    mask: NDArray[np.bool_],
    chosen: list[tuple[Candidate, Centreline]],
    told: list[Candidate],
    marks: list[Mark],
) -> tuple[list[Piece], dict[str, int]]:
    """What of the (H, W) mask the chosen lines leave, and how many pixels each kind has."""
    import cv2

    ink = mask.view(np.uint8)
    left, top, width, height = cv2.boundingRect(ink)
    ink, corner = ink[top : top + height, left : left + width], np.array([left, top])
    rest = ink.copy()
    for line, found in chosen:
        points = found.points if found.widening else line.path  # unmeasured ones have no order
        _wipe(rest, points - corner, found.closed, line.width_px / 2 + EDGE_PX)
    _, whole = cv2.connectedComponents(ink, connectivity=8)
    kind = _kinds(whole, corner, [line for line, _ in chosen], told, marks)
    rows, cols = np.nonzero(rest)
    _, label = cv2.connectedComponents(rest, connectivity=8)
    label = label[rows, cols]
    order = np.argsort(label, kind="stable")
    cuts = np.split(order, np.flatnonzero(np.diff(label[order])) + 1) if len(order) else []
    pixels = {"curve": int(np.count_nonzero(ink) - np.count_nonzero(rest))}
    pieces = []
    for cut in cuts:
        name = kind.get(int(whole[rows[cut[0]], cols[cut[0]]]), "speck")
        pixels[name] = pixels.get(name, 0) + len(cut)
        if len(cut) >= LEAST_PIXELS:
            piece = Piece.of_pixels(np.column_stack([cols[cut], rows[cut]]) + corner, name)
            if name == "own" and all(_leaves(piece, *each) for each in chosen):
                piece = replace(piece, kind="offshoot")
                pixels["own"] -= len(cut)
                pixels["offshoot"] = pixels.get("offshoot", 0) + len(cut)
            pieces.append(piece)
    return pieces, pixels


def _leaves(piece: Piece, line: Candidate, found: Centreline) -> bool:
    """Whether ink is a straight line of a thinner pen that leaves the curve, not near an end."""
    if piece.length_px < SLIM * piece.width_px or piece.width_px >= LEADER * line.width_px:
        return False
    away = np.hypot(*(found.points[:, None] - piece.pixels[:: max(len(piece.pixels) // 99, 1)]).T)
    foot = found.points[away.min(0).argmin()]
    return found.closed or not _within(END_PX, found.points[[0, -1]], foot).any()


def _wipe(ink: NDArray[np.uint8], points: NDArray, closed: bool, reach: float) -> None:
    import cv2

    fine, shift = 16, 4
    places = np.rint(points * fine).astype(np.int32)[:, None]
    cv2.polylines(ink, [places], closed, 0, max(1, round(2 * reach)), cv2.LINE_8, shift)


def _kinds(
    whole: NDArray,
    corner: NDArray,
    chosen: list[Candidate],
    told: list[Candidate],
    marks: list[Mark],
) -> dict[int, str]:
    """The kind of each connected label of the mask."""
    named = [(m.kind, m.branches[0].path) for m in marks if m.branches]
    named += [(line.kind, line.pixels) for line in told]
    named += [("own", line.pixels) for line in chosen]
    kinds: dict[int, str] = {}
    for name, pixels in named:
        u, v = (pixels - corner).T
        on = (u >= 0) & (v >= 0) & (u < whole.shape[1]) & (v < whole.shape[0])
        kinds |= dict.fromkeys(whole[v[on], u[on]].tolist(), name)
    kinds.pop(0, None)
    return kinds


def set_aside(
    marks: list[Mark],
    lines: list[Candidate],
    chosen: list[Candidate],
    specks: Sequence[Piece] = (),
) -> tuple[dict, ...]:
    """What was not used, with its place: panels, lines of other kinds or not chosen, `specks`.

    `lines` are all that were told apart, the candidates first.
    """
    aside = [
        {"kind": m.kind, "box": m.box, "area_px": m.area_px}
        for m in marks
        if m.kind in ("panel", "other colour")
    ]
    for number, line in enumerate((c for c in lines if c.kind != "speck"), 1):
        if not any(line is c for c in chosen):
            entry = {"kind": line.kind, "box": line.box, "length_px": round(line.length_px, 1)}
            entry["stroke"] = number
            if line.junctions:
                entry["junctions"] = list(line.junctions)
            aside.append(entry)
    for piece in specks:
        if piece.kind in ("speck", "offshoot"):
            low, high = piece.pixels.min(0), piece.pixels.max(0)
            box = tuple(int(x) for x in (*low, *(high - low + 1)))
            aside.append({"kind": piece.kind, "box": box, "length_px": round(piece.length_px, 1)})
    return tuple(aside)


def turned(line: Candidate, found: Centreline, at: NDArray, pieces: list[Piece]) -> list[str]:
    """A warning where the line turns sharply near its end and leaves ink beside it, as in a sign.

    A corner that the pen drew leaves none, and in a dot or an arrow's head no line turns so far.
    """
    near = [p for p in pieces if p.kind == "own" and _within(END_PX, p.pixels, at).any()]
    points = found.points[_within(END_PX, found.points, at)]
    step = max(round(TURN_WIDTHS * line.width_px / 2), 3)
    if not near or found.widening is None or len(points) <= 2 * step:
        return []
    way = points[step:] - points[:-step]
    way = way / np.hypot(*way.T)[:, None]
    turn = np.degrees(np.arccos((way[step:] * way[:-step]).sum(1).clip(-1, 1).min()))
    if turn < TURN_DEG:
        return []
    u, v = at
    return [
        f"the curve ends at ({u:.0f}, {v:.0f}) shortly beyond a turn of {turn:.0f} degrees, and "
        "leaves ink beside it there: what touches the end, as a letter does, may be no part of it"
    ]


def _within(reach: float, points: NDArray, at: NDArray) -> NDArray[np.bool_]:
    return np.hypot(*(points - at).T) < reach


def intruders(line: Candidate, found: Centreline, mask: NDArray[np.bool_]) -> list[str]:
    """A warning for each dot beside the line."""
    if len(found.points) <= FLANK * max(line.width_px, 3.0) + SPARE_PX:
        return []  # too short for one
    beside = _reaches(found.points, found.closed, mask, line.width_px)
    warnings = []
    for place, length, off in _dots(line, found, beside, mask):
        u, v = place
        warnings.append(
            f"the ink is wider to one side around ({u:.0f}, {v:.0f}), over {length:.0f} px, and "
            f"draws the curve {off:.1f} px off the way on which it comes and goes on"
        )
    return warnings


def _reaches(points: NDArray, closed: bool, mask: NDArray, width: float) -> NDArray[np.float64]:
    """(2, M) how far ink goes on from points to either side [px]."""
    away = np.arange(STEP_PX, FLANK * width + SPARE_PX, STEP_PX)
    across = away[:, None, None] * normals(points, closed)
    shape = np.array(mask.shape[::-1])
    reaches = []
    for at in (points + across, points - across):
        u, v = np.moveaxis(np.rint(at).astype(int).clip(0, shape - 1), 2, 0)
        reaches.append(np.logical_and.accumulate(mask[v, u]).sum(0) * STEP_PX)
    return np.array(reaches)


def _dots(
    line: Candidate, found: Centreline, beside: NDArray, mask: NDArray
) -> Iterator[tuple[NDArray, int, float]]:
    """Place, length and what it moves the line by, of each dot beside it."""
    points, width = found.points, beside.sum(0)
    usual = float(np.median(width))
    most = usual + PRESSED * 1.48 * float(np.median(np.abs(width - usual)))
    margin, stretch = round(MARGIN * line.width_px) + 1, 2 * round(line.width_px) + SPARE_PX - 2
    for run in runs(width > max(WIDE * usual, usual + WIDE_PX), found.closed):
        longest = LONGEST * line.width_px + SPARE_PX
        if not line.width_px <= len(run) <= longest or width[run].max() <= most:
            continue
        at = np.arange(run[0] - margin - stretch, run[0] + len(run) + margin + stretch)
        if found.closed and len(at) <= len(points):
            at = at % len(points)
        elif found.closed or min(at[0], len(points) - 1 - at[-1]) < -stretch // 2:
            continue  # at an end, or round a small ring: where it goes is not seen on both sides
        at = at[(at >= 0) & (at < len(points))]
        near = np.isin(at, np.arange(run[0] - margin, run[0] + len(run) + margin) % len(points))
        comes, *_, goes = np.flatnonzero(near)
        way = _way(points[at], comes, goes)
        off = np.hypot(*(points[at[near]][:, None] - way).T).min(0)
        sides = _reaches(way, False, mask, line.width_px).max(1)
        if sides.min() < BOTH * sides.max() and off.max() > OFF_PX:
            yield points[run[len(run) // 2]], len(run), float(off.max())


def _way(points: NDArray, comes: int, goes: int) -> NDArray[np.float64]:
    """(K, 2) from one point of a line to a later one as an arc would: by the tangents there."""
    ends, row = points[[comes, goes]], np.arange(len(points))
    before = np.polyfit(row[: comes + 1] - comes, points[: comes + 1], 2)[1]
    after = np.polyfit(row[goes:] - goes, points[goes:], 2)[1]
    along = np.array([before, after]) / np.hypot(*np.array([before, after]).T)[:, None]
    chord, turn = np.hypot(*(ends[1] - ends[0])), np.arccos(np.clip(along[0] @ along[1], -1, 1))
    reach = chord / (3 * np.cos(turn / 4) ** 2)
    t = np.arange(0, chord, STEP_PX)[:, None] / chord
    corners = ends[0], ends[0] + reach * along[0], ends[1] - reach * along[1], ends[1]
    weights = (1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3
    return sum(weight * corner for weight, corner in zip(weights, corners, strict=True))
