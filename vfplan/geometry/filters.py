"""Filters along the first axis of an array, to the bit as those of scipy.ndimage.

They stand here because importing scipy.ndimage takes longer than extracting a curve.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Array = NDArray[np.float64]


def gaussian(values: Array, sigma: float, mode: str = "symmetric") -> Array:
    """Values (N, ...) smoothed by a Gaussian that ends at four times `sigma`.

    `mode` says how `np.pad` carries the values on beyond both ends.
    """
    reach = int(4 * sigma + 0.5)
    weight = np.exp(-0.5 / sigma**2 * np.arange(-reach, reach + 1) ** 2)
    weight /= weight.sum()
    padded = np.pad(values, [(reach, reach)] + [(0, 0)] * (values.ndim - 1), mode)
    count = len(values)
    smooth = weight[reach] * values
    for k in range(reach):
        smooth = smooth + weight[k] * (padded[k : k + count] + padded[2 * reach - k :][:count])
    return smooth


def windows(values: NDArray, size: int, mode: str = "symmetric", **beyond: Any) -> NDArray:
    """(N, size) what lies around each of values (N,); `np.pad` carries them on beyond both ends."""
    before = size // 2
    padded = np.pad(values, (before, size - 1 - before), mode, **beyond)
    return sliding_window_view(padded, size)


def median(values: Array, size: int, mode: str = "symmetric", **beyond: Any) -> Array:
    """(N,) the median of `windows`; of an even size, the upper one of the two in the middle."""
    around = windows(values, size, mode, **beyond)
    return np.partition(around, size // 2, axis=1)[:, size // 2]
