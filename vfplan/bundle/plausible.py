"""Sizes that a slip of units gives: millimetres taken for metres, or the other way round.

The format's own range catches the grossest only, and an affine registration fits any scale.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LEAST_M, MOST_M = 1e-3, 3.0  # across: a mark on a bone, a patient
FARTHEST_M = 10.0  # from the origin: a robot in the same room


def size_doubt(points: NDArray[np.float64]) -> str | None:
    """What is doubtful about the size of a fixture's points (N, 3) [m]; `None` if nothing is."""
    low, high = points.min(axis=0), points.max(axis=0)
    across = float(np.max(high - low))
    far = float(np.max(np.maximum(np.abs(low), np.abs(high))))
    if far <= FARTHEST_M and (len(points) == 1 or LEAST_M <= across <= MOST_M):
        return None
    return (
        f"the points are {across:.3g} m across and up to {far:.3g} m from the origin along an axis;"
        f" {LEAST_M:g} to {MOST_M:g} m across, within {FARTHEST_M:g} m, is usual: is a unit wrong?"
    )
