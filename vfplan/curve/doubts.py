"""What may be wrong with a measured curve: what a region cuts, an opening, runs side by side.

None of it proves the curve wrong, so it is told with its pixels; only two runs that surely lie side
by side are refused.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate, inked_ends
from vfplan.curve.doubling import Widening
from vfplan.curve.joining import angle_deg
from vfplan.curve.pen import Pen
from vfplan.errors import CurveError

AHEAD_DEG = 60.0  # between an end's direction and the way to what may carry it on
NEAR_GAPS, NEAR_SHARE = 3.0, 0.1  # of the longest gap bridged, of the length: nearly closed
BAR_PX, BAR_DEG, BAR_ASIDE = 5.0, 8.0, 0.04  # width, hue, share of its length: a chart's bar
MOST_LIFTS = 2  # a ring drawn with more is no C


def cut_off(
    line: Candidate,
    mask: NDArray[np.bool_],
    roi: tuple[int, int, int, int] | None,
    exclude: Sequence[tuple[int, int, int, int]],
    shape: tuple[int, ...],
) -> list[str]:
    """A warning for each end of a line on the border of the region or of an excluded part."""
    u, v, width, height = roi or (0, 0, shape[1], shape[0])
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
        for p, q, across, down in exclude:
            place = np.add(at, (u, v))
            beside = np.maximum(np.abs(place - (p, q) - (np.array([across, down]) - 1) / 2), 0)
            off = np.maximum(beside - np.array([across, down]) / 2, 0)
            if np.hypot(*off) <= line.width_px:
                warnings.append(
                    f"the curve ends at ({place[0]:.0f}, {place[1]:.0f}) on the border of the "
                    f"excluded {p},{q},{across},{down}: what lies in it is not followed"
                )
    return warnings


def nearly_closed(
    line: Candidate, mask: NDArray[np.bool_], max_gap_px: float, origin: tuple[int, int]
) -> list[str]:
    """A warning for a short opening between a line's ends, whether it was closed or left open."""
    if line.closed:
        return _closed_over(line, origin)
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


def _closed_over(line: Candidate, origin: tuple[int, int]) -> list[str]:
    """Of a ring with few lifts, any may be its opening."""
    edges = np.diff(np.r_[line.bridged[-1], line.bridged].astype(int))
    starts = np.flatnonzero(edges == 1)
    if not 0 < len(starts) <= MOST_LIFTS:
        return []
    turned = np.roll(line.bridged, -starts[0])
    runs = np.split(np.arange(len(turned)), np.flatnonzero(np.diff(turned.astype(int))) + 1)[::2]
    run = (max(runs, key=len) + starts[0]) % len(turned)
    u, v = line.path[run[len(run) // 2]] + origin
    return [
        f"a gap of about {len(run):.0f} px at ({u:.0f}, {v:.0f}) was bridged, which closes the "
        "curve; a smaller --max-gap leaves it open"
    ]


def a_bar(line: Candidate, pen: Pen, origin: tuple[int, int]) -> list[str]:
    """A warning for a broad line along a row or column whose hue is not quite the pen's."""
    if line.closed or line.width_px < BAR_PX or angle_deg(line.mark.pen.along, pen.along) < BAR_DEG:
        return []
    if np.ptp(line.path, axis=0).min() > BAR_ASIDE * line.length_px:
        return []
    u, v = line.path[len(line.path) // 2] + origin
    return [
        f"the line at ({u:.0f}, {v:.0f}), {line.width_px:.0f} px wide, runs straight along a row "
        "or column, in a hue that is not quite the pen's: it may be a chart's bar"
    ]


def several(line: Candidate, single: bool) -> list[str]:
    """A warning where two lines may lie side by side all along."""
    if single:
        return []
    return [
        f"the line's profile, {line.width_px:.1f} px wide, sinks in its middle: if it is two lines "
        "side by side, it is measured midway between them"
    ]


def side_by_side(
    line: Candidate, widest: Widening | None, origin: tuple[int, int], accepted: bool
) -> list[str]:
    """A warning where two runs may lie side by side; raises `CurveError` where they surely do.

    An arrow was named by somebody who saw its head.
    """
    if widest is None or not widest.doubted:
        return []
    u, v = np.add(widest.place, origin)
    what = f"the line is {widest.ratio:.2f} times as wide as elsewhere around ({u:.0f}, {v:.0f})"
    if widest.refused and line.kind != "arrow" and not accepted:
        raise CurveError(
            f"{what}: it touches itself or another there, and which way it runs would be a guess; "
            "if the pen was pressed harder there, --accept-width takes it",
            where=f"pixel ({u:.0f}, {v:.0f})",
        )
    return [f"{what}: if two runs touch there, they are measured midway between them"]
