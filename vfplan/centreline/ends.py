"""Where a line was begun and where it was lifted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# The coverage falls to one half at 0.87 half widths beyond the centre line's end under a round cap.
# Programs that draw set the pen down up to a pixel earlier than the curve they were given.
ROUND_CAP, EARLY_PX = 0.87, 0.6


def line_ends(mass: NDArray, valid: NDArray, width: float) -> tuple[float, float]:
    """Both ends as float indices into a path that reaches beyond them.

    Parameters
    ----------
    mass
        (M,) coverage summed across the line, 1 in the middle of its run.
    valid
        (M,) bool, where the line was seen.
    width
        The line's width [px].
    """
    on = np.flatnonzero(valid)
    cap = ROUND_CAP * width / 2 + EARLY_PX
    last = len(mass) - 1
    stop = _half(mass, on[-1]) - cap
    start = last - _half(mass[::-1], last - on[0]) + cap
    return max(start, 0.0), min(stop, float(last))


def _half(mass: NDArray, at: int) -> float:
    """Where the mass falls to one half, going on from `at`."""
    while at > 0 and mass[at] < 0.5:
        at -= 1
    while at + 1 < len(mass) and mass[at + 1] >= 0.5:
        at += 1
    if at + 1 >= len(mass):
        return float(at)
    return at + (mass[at] - 0.5) / max(mass[at] - mass[at + 1], 1e-9)
