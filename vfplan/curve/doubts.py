"""What may be wrong with a measured curve: a bit beyond its end, what a region cuts, an opening.

None of it proves the curve wrong, so it is told with its pixels; only two runs that surely lie side
by side are refused.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate, angle_deg, inked_ends, same_pen
from vfplan.curve.doubling import Widening
from vfplan.curve.marks import Mark
from vfplan.curve.pen import sample_pixels
from vfplan.curve.profile import FOREIGN
from vfplan.errors import CurveError

AHEAD_DEG = 60.0  # between an end's direction and the way to what may carry it on
NEAR_GAPS, NEAR_SHARE = 3.0, 0.1  # of the longest gap bridged, of the length: nearly closed
STRETCH, OVER_PX = 6, 4.0  # points back, px beyond a line's half width: the way ahead of an end
SMALL = ("speck", "symbol")  # what a last bit of the line is taken for


def left_over(
    lines: list[Candidate],
    marks: list[Mark],
    told: list[Candidate],
    mask: NDArray[np.bool_],
    max_gap_px: float,
    origin: tuple[int, int],
) -> tuple[list[Mark], list[str]]:
    """Small marks of the line's own pen just beyond an open line's ends, and a warning for each.

    Parameters
    ----------
    lines
        The chosen candidates.
    marks, told
        All marks, and all candidates with their kinds.
    mask
        (H, W) the pen's ink.
    max_gap_px
        How far from the end's ink.
    origin
        (u, v) of the region in the image [px].
    """
    kind = {id(m): c.kind for c in told for m in c.marks}
    small = [_as_dot(m) for m in marks if m.branches and kind.get(id(m), m.kind) in SMALL]
    found, warnings = [], []
    for line in lines:
        for at, outward in inked_ends(line, mask):
            near = [(_gap(line, at, outward, mark), i) for i, mark in enumerate(small)]
            gap, i = min(near, default=(np.inf, 0))
            if gap > max_gap_px:
                continue
            mark = small[i]
            u, v = np.add(mark.box[:2], origin) + (np.array(mark.box[2:]) - 1) / 2
            found += [mark] if not any(mark is m for m in found) else []
            size = mark.length_px + mark.width_px
            warnings.append(
                f"a mark of {size:.0f} px at ({u:.0f}, {v:.0f}) lies about {gap:.0f} px beyond "
                "the curve's end and is not part of it"
            )
    return found, warnings


def _as_dot(mark: Mark) -> Mark:
    """With a disc's width for a dot, of which thinning leaves no length to divide by."""
    disc = 2 * float(np.sqrt(mark.area_px / np.pi))
    return replace(mark, width_px=disc) if mark.length_px < disc / 2 else mark


def _gap(line: Candidate, at: NDArray, outward: NDArray, mark: Mark) -> float:
    """Between a line's inked end and the ink of a mark [px]; infinite for one of no concern."""
    pixels = np.vstack([b.path for b in mark.branches])
    away = pixels - at
    distance = np.hypot(*away.T)
    nearest = distance.argmin()
    aside = angle_deg(outward, away[nearest]) if distance[nearest] else 0.0
    if aside > AHEAD_DEG or not same_pen(line.mark, mark):
        return np.inf
    return max(float(distance[nearest] - (mark.width_px - 1) / 2), 0.0)


def cut_off(
    line: Candidate,
    mask: NDArray[np.bool_],
    roi: tuple[int, int, int, int] | None,
    shape: tuple[int, ...],
) -> list[str]:
    """A warning for each end of a line that lies on the region's border inside the image."""
    if roi is None:
        return []
    u, v, width, height = roi
    inner = np.array([u, v, shape[1] - u - width, shape[0] - v - height]) > 0
    warnings = []
    for at, _ in inked_ends(line, mask):
        room = np.r_[at, np.array([width, height]) - 1 - at] + 0.5
        if (inner & (room <= line.width_px)).any():  # a slanting line ends where its middle does
            place = np.add(at, (u, v))
            warnings.append(
                f"the curve ends at ({place[0]:.0f}, {place[1]:.0f}) on the border of the region "
                f"{u},{v},{width},{height}: what lies beyond is cut off"
            )
    return warnings


def nearly_closed(
    line: Candidate, mask: NDArray[np.bool_], max_gap_px: float, origin: tuple[int, int]
) -> list[str]:
    """A warning when an open line's ends run towards each other over a short opening."""
    ends = inked_ends(line, mask)
    if not ends:
        return []
    (a, from_a), (b, from_b) = ends
    missing = float(np.hypot(*(b - a)))
    if missing > max(NEAR_GAPS * max_gap_px, NEAR_SHARE * line.length_px) or missing <= 0:
        return []
    if max(angle_deg(from_a, b - a), angle_deg(from_b, a - b)) > AHEAD_DEG:
        return []
    (u, v), (p, q) = a + origin, b + origin
    return [
        f"the curve is nearly closed: {missing:.0f} px are missing between ({u:.0f}, {v:.0f}) and "
        f"({p:.0f}, {q:.0f})"
    ]


def covered_ends(
    rgb: NDArray, line: Candidate, points: NDArray, origin: tuple[int, int]
) -> list[str]:
    """A warning for each end of a measured open line, (M, 2) points, under another colour."""
    if line.closed or len(points) <= STRETCH:
        return []
    pen, warnings = line.mark.pen, []
    for at, inner in ((points[0], points[STRETCH]), (points[-1], points[-1 - STRETCH])):
        onward = (at - inner) / np.hypot(*(at - inner))
        ahead = at + np.arange(1.0, line.width_px + OVER_PX)[:, None] * onward
        pixels = sample_pixels(rgb, *ahead.T)
        along, across = pixels @ pen.along, pixels @ pen.across
        if (np.maximum(np.abs(across), -along) > FOREIGN * pen.strength).sum() >= 2:
            u, v = at + origin
            warnings.append(
                f"the curve ends at ({u:.0f}, {v:.0f}) where something of another colour begins: "
                "what that hides of it is not followed"
            )
    return warnings


def several(line: Candidate, single: bool) -> list[str]:
    """A warning where two lines may lie side by side all along."""
    if single:
        return []
    return [
        f"the line's profile, {line.width_px:.1f} px wide, sinks in its middle: if it is two lines "
        "side by side, it is measured midway between them"
    ]


def side_by_side(line: Candidate, widest: Widening | None, origin: tuple[int, int]) -> list[str]:
    """A warning where two runs may lie side by side; raises `CurveError` where they surely do.

    An arrow was named by somebody who saw its head.
    """
    if widest is None or not widest.doubted:
        return []
    u, v = np.add(widest.place, origin)
    what = f"the line is {widest.ratio:.2f} times as wide as elsewhere around ({u:.0f}, {v:.0f})"
    if widest.refused and line.kind != "arrow":
        raise CurveError(
            f"{what}: it touches itself or another there, and which way it runs would be a guess",
            where=f"pixel ({u:.0f}, {v:.0f})",
        )
    return [f"{what}: if two runs touch there, they are measured midway between them"]
