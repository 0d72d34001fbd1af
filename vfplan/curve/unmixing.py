"""Other colours beside the line, un-mixed from the pen's.

A pixel on the border between the pen and another colour f shows a mixture of both and of the
ground. The chroma plane has two directions, so both shares follow from it exactly:

    p · across = b f · across,    p · along = a |c⊥| + b f · along.

All that is wanted of the other colour is its slope, f · along / f · across, read where it is pure.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.pen import Pen, chroma_at

REACH_PX = 12  # beyond the line, as far as another colour is looked for
FOREIGN = 0.35  # of the pen's strength across its hue: more is another colour
LEAST_PIXELS = 6
PURE = 0.8  # of the strongest of a mark: such pixels hold nothing else


class OtherColours:
    """The marks of other colours round a line.

    rgb: (H, W, 3) image
    path: (M, 2) the line, roughly [px]
    pen, width: the line's pen and its width [px]
    """

    def __init__(self, rgb: NDArray, path: NDArray, pen: Pen, width: float) -> None:
        import cv2
        from scipy.spatial import cKDTree

        self._reach = width / 2 + 3
        self._trees = []
        cols, rows = _around(path, rgb.shape, int(width / 2 + REACH_PX)).T
        along, across = chroma_at(rgb, rows, cols, pen)
        for sign in (1, -1):
            on = sign * across > FOREIGN * pen.strength
            if on.sum() < LEAST_PIXELS:
                continue
            low = np.array([rows[on].min(), cols[on].min()])
            crop = np.zeros((np.ptp(rows[on]) + 1, np.ptp(cols[on]) + 1), np.uint8)
            at = (rows[on] - low[0], cols[on] - low[1])
            crop[at] = 1
            label = cv2.connectedComponents(crop, connectivity=8)[1][at]
            slopes = _slopes(along[on], across[on], label)
            known = ~np.isnan(slopes[label])
            if known.any():
                places = np.column_stack([cols[on], rows[on]])[known]
                self._trees.append((sign, cKDTree(places), slopes[label][known]))

    def unmixed(self, at: NDArray, along: NDArray, across: NDArray) -> NDArray[np.float64]:
        """(M, K) `along`, freed of the colours near the (M, 2) path that it was read across."""
        pure = along
        for sign, tree, slopes in self._trees:
            distance, nearest = tree.query(at, distance_upper_bound=self._reach + REACH_PX)
            near = np.isfinite(distance)
            slope = np.where(near, slopes[np.where(near, nearest, 0)], 0.0)
            pure = pure - slope[:, None] * sign * np.maximum(sign * across, 0.0)
        return pure


def _around(path: NDArray, shape: tuple[int, ...], reach: int) -> NDArray[np.int64]:
    """(N, 2) pixels (u, v) within `reach` of a path."""
    import cv2

    low = np.maximum(np.floor(path.min(0)).astype(int) - reach, 0)
    high = np.minimum(np.ceil(path.max(0)).astype(int) + reach + 1, shape[1::-1])
    near = np.zeros((high - low)[::-1], np.uint8)
    pixels = np.rint(path - low).astype(np.int32)
    cv2.polylines(near, [pixels[:, None]], False, 1, 2 * reach + 1)
    return np.column_stack(np.nonzero(near)[::-1]) + low


def _slopes(along: NDArray, across: NDArray, label: NDArray) -> NDArray[np.float64]:
    """Of each mark, by its label; NaN for one too small to be pure anywhere."""
    slopes = np.full(label.max() + 1, np.nan)
    for k in range(1, len(slopes)):
        own = label == k
        if own.sum() >= LEAST_PIXELS:
            size = np.abs(across[own])
            pure = size >= PURE * np.quantile(size, 0.95)
            slopes[k] = np.median(along[own][pure] / across[own][pure])
    return slopes
