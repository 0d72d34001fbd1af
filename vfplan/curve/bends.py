"""What a bend does to a measured line: blur draws it inward, and it is less sure.

JPEG has no correction of its own: what it blurs is in the blur that the line's profile shows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.path import normals

TIGHT, TIGHTEST = 0.11, 0.25  # curvature that doubles the error, and the largest that counts [1/px]


def bend_of(points: NDArray, closed: bool) -> NDArray:
    """(M,) curvature of a path in equal steps, positive where it turns to its normals [1/px]."""
    normal = normals(points, closed)
    change = (
        np.roll(normal, -1, 0) - np.roll(normal, 1, 0)
        if closed
        else 2 * np.gradient(normal, axis=0)
    )
    step = np.hypot(*(points[1] - points[0]))
    return (normal[:, 0] * change[:, 1] - normal[:, 1] * change[:, 0]) / (2 * step)


def drawn_outward(offset: NDArray, bend: NDArray, blur: float) -> NDArray:
    """(M,) offsets freed of what blur of variance `blur` [px²] does in bends [1/px]."""
    return offset - bend * blur / 2  # it draws both edges of a bend inward


def less_sure(bend: NDArray) -> NDArray[np.float64]:
    """(M,) how many times less sure a line is where it bends so much [1/px]."""
    return 1 + (np.minimum(np.abs(bend), TIGHTEST) / TIGHT) ** 2
