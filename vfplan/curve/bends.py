"""What blur does to a line where it bends, and what is taken off for it.

Blur draws both edges of a bend inward, by half its variance times the curvature; the blur is read
from the line's own profile, so that of a scaled or a soft picture counts as it is. JPEG gets no
correction of its own: what it blurs is in the profile with the rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.path import normals


def drawn_inward(bend: NDArray | float, blur: float) -> NDArray | float:
    """How far blur has drawn a line to the inside of its bend [px].

    bend: its curvature, positive where it turns to its normals [1/px]
    blur: variance of the blur, as `blur_of` finds it [px²]
    """
    return bend * blur / 2


def bend_of(points: NDArray, closed: bool) -> NDArray:
    """(M,) curvature of a path in equal steps, positive where it turns to its normals [1/px]."""
    normal = normals(points, closed)
    change = np.roll(normal, -1, 0) - np.roll(normal, 1, 0)
    if not closed:
        change = 2 * np.gradient(normal, axis=0)
    step = np.hypot(*(points[1] - points[0]))
    return (normal[:, 0] * change[:, 1] - normal[:, 1] * change[:, 0]) / (2 * step)


def blur_of(x: NDArray, profile: NDArray, width: float) -> float:
    """Variance of the blur, a pixel's square included, in a line's (K,) mean profile [px²]."""
    weight = np.clip(profile, 0.0, None)
    variance = float((weight * x**2).sum() / max(weight.sum(), 1e-9))
    return max(variance - width**2 / 12, 0.0)
