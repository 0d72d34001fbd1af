"""The measured curve held against the ink: what it explains of the red, and what it leaves.

Every pixel of the mask belongs to the curve, to a mark that was taken for something else, or to
neither. What could belong to the curve and was not followed is told with its place and length: ink
ahead of an end, ink that hangs together with the curve, ink under a bridge. A bridge longer than
the caller allows is refused, as is a fit that left the ink.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.beside import Piece, turned
from vfplan.curve.candidates import ALIKE, Candidate, angle_deg, inked_ends
from vfplan.curve.path import runs
from vfplan.curve.ridge import Centreline
from vfplan.errors import CurveError

OWN_WIDTHS, OWN_PX = 1.5, 6.0  # ink this far beyond its edge is no blot, glyph or arrow's head
AHEAD_DEG, UNEVEN_DEG = 60.0, 35.0  # from an end's direction; between both halves of a bend
REACH, SHARE = 3.0, 0.1  # of its own length or the line's, beyond `max_gap`: where a piece is
SAME, STROKE, STROKE_PX = 1.3, 3.0, 14.0  # nearly so wide, so many times as long: a stroke of it
SPECKS, SPECK = 2, 0.25  # of so much of a width at least: JPEG leaves crumbs beside a broad pen
TOUCHING, TOUCHING_PX = 2.0, 8.0  # widths, px from an end: a sign that the line runs into
NO_CONTINUATION = ("text", "frame", "scale bar", "leader", "offshoot", "other colour")
LEFT = 0.5  # of a width, and a pixel: an honest fit does not leave the ink by more
BRIDGE_WIDTHS, BRIDGE_PX = 2.0, 4.0  # beside a gap, where profiles lack a side


def unexplained(
    chosen: list[tuple[Candidate, Centreline]],
    pieces: list[Piece],
    mask: NDArray[np.bool_],
    max_gap_px: float,
) -> tuple[list[Piece], list[str]]:
    """The pieces that may carry a chosen line on, and a warning for each place of such ink."""
    carrying, warnings = [], []
    for line, found in chosen:
        for at, outward in inked_ends(line, mask):
            piece, told = _beyond(line, at, outward, pieces, max_gap_px)
            carrying += piece
            warnings += told + (_crossed(line, at) or turned(line, found, at, pieces))
    return carrying, warnings + _hanging(chosen, pieces)


def _crossed(line: Candidate, at: NDArray) -> list[str]:
    """A warning where a thinner stroke leaves the line near an end, as a letter's or a cross's."""
    reach = TOUCHING * line.width_px + TOUCHING_PX
    places = [p for m in line.marks for p in m.offshoots if np.hypot(*(p - at)) < reach]
    if not places:
        return []
    (u, v), (p, q) = at, places[0]
    return [
        f"the curve ends at ({u:.0f}, {v:.0f}), where a thinner stroke leaves it at ({p}, {q}): "
        "what touches the end there, as a letter does, may be no part of it"
    ]


def _beyond(
    line: Candidate,
    at: NDArray,
    outward: NDArray,
    pieces: list[Piece],
    max_gap: float,
) -> tuple[list[Piece], list[str]]:
    """What lies ahead of an end: the nearest piece that may carry the line on, or specks."""
    near, specks = [], 0
    for piece in pieces:
        away = piece.pixels - at
        distance = np.hypot(*away.T)
        gap = float(distance.min())
        reach = max_gap + max(REACH * piece.length_px, SHARE * line.length_px)
        if gap > reach or piece.kind in NO_CONTINUATION:
            continue
        aside = angle_deg(outward, away[distance.argmin()]) if gap else 0.0
        whole = piece.length_px >= SPECK * line.width_px
        specks += gap <= max_gap and aside <= 90.0 and piece.kind == "speck" and whole
        if piece.kind != "own" and _carries_on(line, piece, gap, aside, at, outward, max_gap):
            near.append((gap, piece))
    if near:
        gap, piece = min(near, key=lambda item: item[0])
        u, v = (piece.pixels.min(0) + piece.pixels.max(0)) / 2
        what = "a mark" if piece.kind == "speck" else f"a mark ({piece.kind})"
        return [piece], [
            f"{what} of {piece.length_px:.0f} px at ({u:.0f}, {v:.0f}) lies about {gap:.0f} px "
            "beyond the curve's end and is not part of it"
        ]
    if specks >= SPECKS:
        u, v = at
        return [], [f"the curve ends at ({u:.0f}, {v:.0f}) among {specks} specks of its colour"]
    return [], []


def _carries_on(
    line: Candidate,
    piece: Piece,
    gap: float,
    aside: float,
    at: NDArray,
    outward: NDArray,
    max_gap: float,
) -> bool:
    wider = max(piece.width_px / line.width_px, line.width_px / piece.width_px)
    if wider > ALIKE:
        return False
    if gap <= max_gap:
        return aside <= AHEAD_DEG
    stroke = wider <= SAME and piece.length_px >= max(STROKE * piece.width_px, STROKE_PX)
    if stroke and gap <= max_gap + REACH * piece.length_px:
        return aside < 90.0
    # An arc turns by as much again beyond its chord's middle.
    way = piece.middle - at
    along = piece.along if piece.along @ way > 0 else -piece.along
    if piece.length_px < ALIKE * piece.width_px:
        along = way  # a dot or a short dash has no direction
    first, then = _turn(outward, way), _turn(way, along)
    return abs(first) <= AHEAD_DEG and abs(first - then) <= UNEVEN_DEG


def _turn(a: NDArray, b: NDArray) -> float:
    """From one direction to another, with its sign [degrees]."""
    return float(np.degrees(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)))


def _hanging(chosen: list[tuple[Candidate, Centreline]], pieces: list[Piece]) -> list[str]:
    """Ink that hangs together with a line, the nearest, and lies too far beside it."""
    from scipy.spatial import cKDTree

    lines = [(cKDTree(found.points), line.width_px) for line, found in chosen]
    warnings = []
    for piece in pieces:
        if piece.kind == "own":
            away = ((tree.query(piece.pixels)[0], width) for tree, width in lines)
            distance, width = min(away, key=lambda near: near[0].min())
            if distance.max() > width / 2 + max(OWN_WIDTHS * width, OWN_PX):
                u, v = piece.pixels[distance.argmax()]
                warnings.append(
                    f"ink of {piece.length_px:.0f} px that hangs together with the curve reaches "
                    f"to ({u}, {v}), {distance.max():.0f} px beside it, and is not part of it"
                )
    return warnings


def doubted_bridges(
    line: Candidate,
    found: Centreline,
    mask: NDArray[np.bool_],
    max_gap_px: float,
) -> list[str]:
    """A warning for each bridge that runs over ink, beyond what its edges lack of a profile.

    Raises `CurveError` where more than a caller allows could not be measured.
    """
    warnings = []
    slack = BRIDGE_WIDTHS * line.width_px + BRIDGE_PX
    for run in runs(found.bridged, found.closed):
        points, (u, v) = found.points[run], found.points[run[len(run) // 2]]
        length = float(np.hypot(*np.diff(points, axis=0).T).sum())
        if length > max_gap_px + slack:
            raise CurveError(
                f"{length:.0f} px of the line cannot be measured, for something lies over or "
                f"against it; no more than --max-gap ({max_gap_px:g} px) is bridged",
                where=f"pixel ({u:.0f}, {v:.0f})",
            )
        p, q = np.rint(points).astype(int).T
        inked = mask[q.clip(0, mask.shape[0] - 1), p.clip(0, mask.shape[1] - 1)].sum()
        if inked > slack:
            warnings.append(
                f"{inked} px of visible ink around ({u:.0f}, {v:.0f}) could not be measured: the "
                "curve is carried across from both sides"
            )
    return warnings


def refuse_strayed(line: Candidate, found: Centreline) -> None:
    """Raise `CurveError` where the fitted line left the ink it was measured in."""
    from scipy.spatial import cKDTree

    measured = found.points[~found.bridged]
    if not len(measured):
        return
    distance, nearest = cKDTree(line.path).query(measured)
    if not line.closed:  # beyond its ends the path does not say where the line goes
        distance[(nearest == 0) | (nearest == len(line.path) - 1)] = 0.0
    worst = int(distance.argmax())
    if distance[worst] > (1 + LEFT) * line.width_px + 2.0:
        u, v = measured[worst]
        raise CurveError(
            f"the fitted line left its ink by {distance[worst]:.0f} px: the drawing is not one "
            "smooth line there",
            where=f"pixel ({u:.0f}, {v:.0f})",
        )
