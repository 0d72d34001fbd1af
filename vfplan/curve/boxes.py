"""Whether a drawn box lies over a line's end, or a strip, or another view of a split screen.

A box has sides along rows and columns, each a border on one side of which the picture changes
little; anatomy has none that end in corners. What the box holds does not matter: words, stripes
and shades are as good as white. Of all rectangles that pass the end the best is taken, so that one
side may be lost, as where white lies on white.

A border that goes on along one row or column for long, and is as sharp as pixels are, needs no
corner: no scanner leaves one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.pen import Pen
from vfplan.curve.profile import LUMINANCE

REACH_PX, LEAST_PX = 96, 16  # looked at around an end; a box's sides, at least
NOISE = 12.0  # levels of grey: what a ground, and JPEG beside an edge, may change by
INK, INK_PX = 0.12, 5  # of the pen's strength; around its ink nothing is read
BORDER = 3  # px of its border, and the picture's, that are not read
OFF = -2, 4  # rows from the ink's end among which a side may pass
EVEN = 0.5  # what a border scores of which nothing can be read; along which no border is
COLUMNS, PASSING = 6, 6.0  # tried for a side; evidence of a side at the end, before others are
SLANT = 0.3  # of the line's direction across a side, at least
HERE = 0.2  # a box is no surer than the side at the end by more
# Of a border as sharp as pixels: levels of grey that the ground changes by anyway; what one pixel
# of it scores at most; the share of the change beside it that counts, and of a wall at a corner.
QUIET, SHARPEST, NEAR, CORNER = 3.0, 1.5, 0.5, 0.5
BESIDE = -3, 5  # rows from the ink's end among which it may pass


def boxed(rgb: NDArray, pen: Pen, cut: NDArray, onward: NDArray) -> tuple[float, float]:
    """How much of a box's outline is seen that begins at a line's `cut`: 1 for all of it.

    And how long and sharp a straight border passes there, in pixels that are surely one.

    onward: (2,) the line's direction there
    """
    import cv2

    grey, ink = _around(rgb, cut, LUMINANCE, pen.along / pen.strength)
    at = np.rint(cut).astype(int)
    low = np.maximum(BORDER - at + REACH_PX, BORDER)
    high = np.minimum(rgb.shape[1::-1] - at + REACH_PX, 2 * REACH_PX + 1) - BORDER
    inside = np.s_[low[1] : max(high[1], 0), low[0] : max(high[0], 0)]
    read, outline, border = np.zeros(grey.shape, bool), 0.0, 0.0
    read[inside] = cv2.dilate((ink > INK).view(np.uint8), np.ones((INK_PX, INK_PX)))[inside] == 0
    for ahead, *views in ((onward[1], grey, read), (onward[0], grey.T, read.T)):
        grid, seen = (view if ahead > 0 else view[::-1] for view in views)
        border = max(border, _bordered(grid, seen))
        if abs(ahead) >= SLANT:
            outline = max(outline, *(_outlined(grid, seen, within) for within in (False, True)))
    return outline, border


def _around(rgb: NDArray, at: NDArray, *rows: NDArray) -> list[NDArray]:
    """The square around a place, of the values `rgb` @ row; outside the image the edge goes on."""
    u, v = (
        np.clip(np.rint(c).astype(int) + np.arange(-REACH_PX, REACH_PX + 1), 0, size - 1)
        for c, size in zip(at, rgb.shape[1::-1], strict=True)
    )
    near = rgb[v[:, None], u].astype(np.float32) * np.float32(255 / np.iinfo(rgb.dtype).max)
    return [near @ row.astype(np.float32) for row in rows]


def _bordered(grey: NDArray, read: NDArray) -> float:
    """How long a sharp border passes the middle along a row, with walls that leave it upwards."""
    middle, best = len(grey) // 2, 0.0
    rows = np.arange(middle + BESIDE[0], middle + BESIDE[1])
    sides, walls = _sharp(grey, read)[:, rows], _sharp(grey.T, read.T).swapaxes(1, 2)
    sums = np.cumsum(walls, axis=1)
    most = np.maximum.accumulate(sums[:, ::-1], axis=1)[:, ::-1]
    walls = CORNER * np.maximum(most[:, rows + 1] - sums[:, rows], 0)
    for side, left, right in zip(sides, walls, walls[::-1], strict=True):
        back = np.cumsum(side[:, middle - 1 : 0 : -1], axis=1) + left[:, middle - 2 :: -1]
        onward = np.cumsum(side[:, middle:], axis=1) + right[:, middle:]
        best = max(best, (back.max(1).clip(0) + onward.max(1).clip(0)).max())
    return float(best)


def _sharp(grey: NDArray, read: NDArray) -> NDArray[np.float64]:
    """(2, M, N) how sharply rows change to the next: against those before, and those after."""
    change = np.abs(np.diff(grey, axis=0))
    step, near = change[2:-2] + QUIET, NEAR * np.maximum(change[1:-3], change[3:-1])
    sharp = np.zeros((2, *grey.shape), np.float32)
    for own, beside, next_one in zip(
        sharp, (change[1:-3], change[3:-1]), (change[:-4], change[4:]), strict=True
    ):
        ground = np.maximum.reduce([beside, next_one, near]) + QUIET
        own[2:-3] = np.log(step / ground).clip(-1, SHARPEST) - EVEN
    sharp[:, :-1] *= read[:-1] & read[1:]
    return sharp


def _outlined(grey: NDArray, read: NDArray, within: bool) -> float:
    """The same of a box that lies towards higher rows; `within`: it is even inside, not outside."""
    size, middle, best = len(grey), len(grey) // 2, 0.0
    top, bottom = (_sums(edge.T, read.T) for edge in _edges(grey, within))
    passing = (top[0] - EVEN * top[1])[:, middle + OFF[0] : middle + OFF[1]]
    passing = passing[middle:].max(0) - passing[: middle + 1].min(0) >= PASSING
    if not passing.any():
        return 0.0
    left, right = (_sums(edge.T, read) for edge in _edges(grey.T, within))
    for row in middle + OFF[0] + np.flatnonzero(passing):
        depth = np.arange(row + LEAST_PX, size)
        first, down = _likeliest(left, np.arange(middle + 1), row, depth)
        last, up = _likeliest(right, np.arange(middle, size), row, depth)
        here = _mean(top[:, last, row][:, None] - top[:, first, row][:, :, None])[..., None]
        far = bottom[:, :, depth]
        far = _mean(far[:, last][:, None] - far[:, first][:, :, None])
        whole = (here + far + _mean(down)[:, None] + _mean(up)) / 4
        wide = (last - first[:, None] >= LEAST_PX)[..., None]
        best = max(best, float((np.minimum(whole, here + HERE) * wide).max()))
    return best


def _edges(grey: NDArray, within: bool) -> tuple[NDArray, NDArray]:
    """Where rows change over 2 px as they do not just before, and just after: log, 1 at most."""
    edges = []
    for rows in (grey, grey[::-1]):
        before = np.abs(rows[2:-2] - np.stack([rows[1:-3], rows[:-4]])).max(0)
        edge = np.zeros_like(rows)
        edge[3:-1] = np.log((np.abs(rows[4:] - rows[2:-2]) + NOISE) / (before + NOISE)).clip(-1, 1)
        edges.append(edge)
    first, last = edges[0], edges[1][::-1]
    return (last, first) if within else (first, last)


def _sums(edge: NDArray, read: NDArray) -> NDArray:
    """(2, M, N) sums from the first of M on: of the edge where it was read, and of how often."""
    return np.cumsum(np.stack([np.where(read, edge, 0), read]), axis=1)


def _mean(sums: NDArray) -> NDArray:
    return np.where(sums[1] >= BORDER, sums[0] / np.maximum(sums[1], 1), EVEN)


def _likeliest(
    sums: NDArray, columns: NDArray, row: int, depth: NDArray
) -> tuple[NDArray, NDArray]:
    """Columns down which an edge goes on from a row, and (2, K, D) its sums as far as `depth`."""
    runs = (sums[:, depth][:, :, columns] - sums[:, row + 1, columns][:, None]).swapaxes(1, 2)
    best = np.argsort(-(runs[0] - EVEN * runs[1]).max(1))[:COLUMNS]
    return columns[best], runs[:, best]
