"""Probes of extreme slices: tiny, huge, empty, all red, with the thinnest and the thickest pen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.curve import extract_curve

GREY, RED = 120, np.array([255.0, 0.0, 0.0])


def blank(size: int, red: bool = False) -> float:
    """A slice of one colour."""
    image = np.full((size, size, 3), GREY, np.uint8)
    if red:
        image[:] = RED
    return _points(image)


def one_pixel() -> float:
    """One red pixel."""
    image = np.full((300, 300, 3), GREY, np.uint8)
    image[150, 140] = RED
    return _points(image)


def one_bit() -> float:
    """A picture of bits, which has no colour."""
    rows, columns = np.indices((300, 300))
    return _points(np.hypot(rows - 150, columns - 150) < 80)


def ring(pen: float, size: int = 700) -> float:
    """RMS distance of the extracted curve from the ring that was drawn [px]."""
    centre, radius = np.array([size / 2 + 0.3, size / 2 - 0.2]), 0.35 * size
    image = np.empty((size, size, 3), np.uint8)
    u = np.arange(size, dtype=np.float64)
    for v in range(size):  # a row at a time, so that a large slice needs no large scratch
        distance = np.abs(np.hypot(u - centre[0], v - centre[1]) - radius)
        share = np.clip(pen / 2 + 0.5 - distance, 0.0, min(pen, 1.0))[:, None]
        image[v] = np.rint(GREY * (1 - share) + RED * share)
    stroke = extract_curve(image).strokes[0]
    away = np.hypot(*(stroke.points_px - centre).T) - radius
    return float(np.sqrt((away * away).mean()))


def _points(image: NDArray) -> float:
    return float(sum(len(stroke.points_px) for stroke in extract_curve(image).strokes))
