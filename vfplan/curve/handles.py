"""Handles that editors draw on a line: small bright squares with a dark border."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PARALLEL_DEG = 15.0  # tangents nearer to parallel meet nowhere in particular
# A handle's size at most; its border's and its middle's grey; pixels of either.
HANDLE_PX, HANDLE_GREY, HANDLE_PIXELS = 16.0, (60.0, 225.0), 6


def under_handle(
    first: tuple[NDArray, NDArray], second: tuple[NDArray, NDArray], rgb: NDArray
) -> bool:
    """Whether two ends' tangents meet in a small bright square with a dark border."""
    (a, out), (b, back) = first, second
    sides = np.column_stack([out, -back])
    if abs(np.linalg.det(sides)) < np.sin(np.radians(PARALLEL_DEG)):
        meet, ways = (a + b) / 2, np.zeros(2)
    else:
        ways = np.linalg.solve(sides, b - a)
        meet = a + ways[0] * out
    size = np.hypot(*(b - a))
    if size > HANDLE_PX or not (ways >= -2).all() or not (ways <= size + 2).all():
        return False
    u, v = np.rint((meet + (a + b) / 2) / 2).astype(int)
    reach = int(size // 2) + 2
    grey = rgb[max(v - reach, 0) : v + reach + 1, max(u - reach, 0) : u + reach + 1].mean(2)
    grey = grey * (255.0 / np.iinfo(rgb.dtype).max)
    bright = (grey > HANDLE_GREY[1]).sum()
    return bool(bright >= HANDLE_PIXELS and (grey < HANDLE_GREY[0]).sum() >= HANDLE_PIXELS)
