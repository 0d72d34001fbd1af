"""Ink of the same pen that touches the line and may be no part of it: a dot beside it.

It moves the measured line along, so it is not told by its distance from that. It makes the ink wide
over a short run, and the line leaves the way on which it comes and goes on.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate
from vfplan.curve.evidence import runs
from vfplan.curve.path import normals
from vfplan.curve.ridge import Centreline

# Of the usual width, and a pixel and a half more: ink of more than the line. From one to so many
# widths long, and so many of line on either side say where it runs.
WIDE, WIDE_PX, LONGEST, FLANK = 1.4, 1.5, 4.0, 3.0
OFF_PX, OFF = 0.8, 3.0  # the line leaves its way by so much, and so many times what the flanks do
BOTH = 0.35  # of the wider side's: a dot on the line, which moves it nowhere
PRESSED = 4.0  # times the widths' own spread: a pen that is pressed varies all along
STEP_PX, SPARE_PX = 0.5, 6.0


def intruders(
    line: Candidate, found: Centreline, mask: NDArray[np.bool_], origin: tuple[int, int]
) -> list[str]:
    """A warning for each dot beside the line."""
    if len(found.points) <= FLANK * max(line.width_px, 3.0) + SPARE_PX:
        return []  # too short for one
    beside = _reaches(found.points, found.closed, mask, line.width_px)
    warnings = []
    for place, length, off in _dots(line, found, beside, mask):
        u, v = place + origin
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
    margin, flank = round(line.width_px + 2), round(FLANK * line.width_px + SPARE_PX)
    for run in runs(width > max(WIDE * usual, usual + WIDE_PX), found.closed):
        longest = LONGEST * line.width_px + SPARE_PX
        if not line.width_px <= len(run) <= longest or width[run].max() <= most:
            continue
        at = np.arange(run[0] - margin - flank, run[0] + len(run) + margin + flank)
        inner = np.abs(at - run[0] - (len(run) - 1) / 2) < len(run) / 2 + margin
        if found.closed:
            at = at % len(points)
        keep = (at >= 0) & (at < len(points))
        at, inner = at[keep], inner[keep]
        if min((~inner)[: len(at) // 2].sum(), (~inner)[len(at) // 2 :].sum()) < flank / 2:
            continue  # at an end: where the line goes is not known from both sides
        powers = np.vander(np.linspace(-1, 1, len(at)), 6)
        way = powers @ np.linalg.lstsq(powers[~inner], points[at][~inner], rcond=None)[0]
        off = np.hypot(*(points[at] - way).T)
        sides = _reaches(way, False, mask, line.width_px)[:, inner].max(1)
        if off.max() > max(OFF_PX, OFF * off[~inner].max()) and sides.min() < BOTH * sides.max():
            yield points[run[len(run) // 2]], len(run), float(off.max())
