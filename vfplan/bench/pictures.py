"""Slices with a known planned curve: a pen's stroke painted by its exact share of every pixel.

The pen is a disc swept along the curve. A pixel's coverage is the share of its square within half
a pen's width of the centre line, counted on an 8 x 8 grid inside each pixel near the curve.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SIZE = (640, 480)  # width and height of the drawn slice at scale 1 [px]
PEN = (226.0, 26.0, 32.0)
_SUB = 8


def picture(pen_px: float, quality: int | None = None, scale: float = 1.0) -> NDArray[np.uint8]:
    """(H, W, 3) uint8, red first: the bench's curve, drawn on a slice.

    pen_px: the pen's width at scale 1 [px]
    quality: JPEG quality with 4:2:0 chroma; `None`: lossless
    scale: pixels of the image for each pixel of the original: how fine the slice was captured
    """
    rgb = _painted(pen_px, scale)
    return rgb if quality is None else _jpeg(rgb, quality)


@lru_cache(maxsize=32)
def _painted(pen_px: float, scale: float) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 before any JPEG; kept, since every quality begins with it."""
    width, height = (round(n * scale) for n in SIZE)
    share = coverage((height, width), to_pixels(curve(), scale), pen_px * scale)
    grey = _slice((height, width), scale)[..., None]
    painted = grey + share[..., None] * (np.array(PEN) - grey)
    rgb = np.clip(np.rint(painted), 0, 255).astype(np.uint8)
    rgb.setflags(write=False)
    return rgb


@lru_cache(maxsize=1)
def curve() -> Array:
    """(M, 2) the true centre line at scale 1 [px], 0.05 px apart: straight, wavy, bent tightly."""
    t = np.linspace(0, 1, 40_001)
    u = 70 + 430 * t + 45 * np.sin(2 * np.pi * t) * t
    v = 250 + 95 * np.sin(5.2 * t + 0.4) + 26 * np.sin(17 * t + 1.0) * t
    dense = np.column_stack([u, v])
    s = np.r_[0, np.cumsum(np.hypot(*np.diff(dense, axis=0).T))]
    even = np.arange(0, s[-1], 0.05)
    return np.column_stack([np.interp(even, s, dense[:, k]) for k in (0, 1)])


def to_pixels(points: Array, scale: float) -> Array:
    """Positions at scale 1 as those of the scaled image; a pixel's centre is a whole number."""
    return (points + 0.5) * scale - 0.5


def from_pixels(points: Array, scale: float) -> Array:
    """The inverse of `to_pixels`."""
    return (points + 0.5) / scale - 0.5


def coverage(shape: tuple[int, int], line: Array, width: float) -> Array:
    """(H, W) share of each pixel that a pen of `width` px along `line` (M, 2) covers."""
    from scipy.ndimage import distance_transform_edt
    from scipy.spatial import cKDTree

    away = np.ones(shape, bool)
    u, v = np.rint(line).astype(int).T
    away[v, u] = False
    rows, cols = np.nonzero(distance_transform_edt(away) <= width / 2 + 2)
    offset = (np.arange(_SUB) + 0.5) / _SUB - 0.5
    du, dv = (grid.ravel() for grid in np.meshgrid(offset, offset))
    inner = np.column_stack([(cols[:, None] + du).ravel(), (rows[:, None] + dv).ravel()])
    distance, _ = cKDTree(line).query(inner, distance_upper_bound=width / 2 + 1)
    share = np.zeros(shape)
    share[rows, cols] = (distance <= width / 2).reshape(len(rows), -1).mean(axis=1)
    return share


@lru_cache(maxsize=8)
def _slice(shape: tuple[int, int], scale: float) -> Array:
    """(H, W) grey 0..255: soft tissue, two bright-rimmed bones, fine noise; the same every time."""
    from scipy.ndimage import gaussian_filter

    v, u = np.mgrid[0 : shape[0], 0 : shape[1]] / scale
    grey = 105 + 45 * np.sin(u / 83 + 1) * np.cos(v / 61)
    for centre, size in (((190, 150), 88), ((430, 330), 70)):
        depth = size - np.hypot(u - centre[0], 1.2 * (v - centre[1]))
        grey = np.where(depth > 0, 140 + 95 * np.exp(-((depth / 7) ** 2)), grey)
    rng = np.random.default_rng(3)
    return np.clip(gaussian_filter(grey, 0.8) + rng.normal(0, 2.5, shape), 5, 250)


def _jpeg(rgb: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    import cv2

    flags = [cv2.IMWRITE_JPEG_QUALITY, quality]
    flags += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420]
    _, data = cv2.imencode(".jpg", rgb[..., ::-1], flags)
    return np.ascontiguousarray(cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1])
