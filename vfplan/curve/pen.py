"""The pen: its colour, and how much of it lies on each pixel.

Over grey (g, g, g) a pen of colour c and coverage α shows p = (1 − α) g n + α c, n = (1, 1, 1).
The part of p across the grey axis is α c⊥ **whatever g is**, so with e = c⊥/|c⊥|

    α |c⊥| = p · e

is exact and linear in the pixel: bones and air under the pen drop out. For pure red e is
(2, −1, −1)/√6 and the formula is α = (R − (G + B)/2) / 255. The direction across e in the same
plane shows what is *not* the pen: yellow labels, cyan markers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError

HUE_GATE_DEG = 32.0  # red to crimson and tomato; yellow and magenta are 60° away
STRIP_ROWS = 256
MIN_CHROMA = 30.0  # of a named pen's colour, on the 0..255 scale


@dataclass(frozen=True, eq=False)
class Pen:
    """A pen's colour in the chroma plane (the plane across grey), on the scale 0..255."""

    along: NDArray[np.float64]  # (3,) unit vector: the pen's own direction, e
    across: NDArray[np.float64]  # (3,) unit vector of the same plane at right angles to it
    strength: float  # |c⊥| times the opacity: what p · e reaches in the middle of the line

    @classmethod
    def of_chroma(cls, chroma: NDArray) -> Pen:
        """The pen whose full line has this (3,) chroma."""
        chroma = chroma - chroma.mean()
        strength = float(np.linalg.norm(chroma))
        along = chroma / strength
        return cls(along, np.cross(np.ones(3), along) / np.sqrt(3.0), strength)

    @classmethod
    def of_colour(cls, colour: str) -> Pen:
        """The pen of a named colour or `#rrggbb`; raises `SettingError` for grey or nonsense."""
        rgb = parse_colour(colour)
        chroma = np.linalg.norm(rgb - rgb.mean())
        if chroma < MIN_CHROMA:
            raise SettingError(
                f"colour {colour!r} is grey (chroma {chroma:.0f} of 255; at least "
                f"{MIN_CHROMA:.0f} is wanted): it cannot be told from the slice"
            )
        return cls.of_chroma(rgb)


def parse_colour(colour: str) -> NDArray[np.float64]:
    """(3,) RGB on 0..255 of `#rrggbb` or a CSS colour name; raises `SettingError`."""
    if colour == "red":  # the default spares an import
        return np.array([255.0, 0.0, 0.0])
    from matplotlib.colors import to_rgb

    try:
        return 255.0 * np.array(to_rgb(colour))
    except ValueError:
        raise SettingError(f"colour {colour!r} is neither a colour's name nor #rrggbb") from None


def pen_score(rgb: NDArray, pen: Pen, sigma_px: float) -> NDArray[np.uint8]:
    """(H, W) uint8: p · along, smoothed; 0 where the hue is not the pen's.

    Smoothing over `sigma_px` keeps the noise of JPEG from fraying the mask; the line itself is
    measured on the picture as it is. Works in strips of rows: one byte a pixel, and no more.
    """
    import cv2

    slope = np.tan(np.radians(HUE_GATE_DEG))
    rows = np.array([pen.along, slope * pen.along - pen.across, slope * pen.along + pen.across])
    rows *= 255.0 / np.iinfo(rgb.dtype).max
    height, halo = rgb.shape[0], int(np.ceil(3 * sigma_px))
    score = np.empty(rgb.shape[:2], np.uint8)
    for top in range(0, height, STRIP_ROWS):
        bottom = min(top + STRIP_ROWS, height)
        first = max(top - halo, 0)
        strip = cv2.GaussianBlur(rgb[first : min(bottom + halo, height)], (0, 0), sigma_px)
        # Saturates: what is below 0 becomes 0.
        parts = cv2.transform(strip[top - first : bottom - first], rows)
        inside = (parts[..., 1] > 0) & (parts[..., 2] > 0)
        score[top:bottom] = np.minimum(parts[..., 0], 255) * inside
    return score


def chroma_at(rgb: NDArray, rows: NDArray, cols: NDArray, pen: Pen) -> tuple[NDArray, NDArray]:
    """p · along and p · across of the pixels (rows, cols), on the scale 0..255."""
    pixels = rgb[rows, cols] * (255.0 / np.iinfo(rgb.dtype).max)
    return pixels @ pen.along, pixels @ pen.across


def sample_pixels(rgb: NDArray, u: NDArray, v: NDArray) -> NDArray[np.float64]:
    """(..., 3) colour on 0..255 at sub-pixel places, bilinear; outside the image the edge goes on.

    Only the four pixels around each place are read, so the cost follows the curve, not the image.
    """
    h, w = rgb.shape[:2]
    u = np.clip(u, 0, w - 1)
    v = np.clip(v, 0, h - 1)
    col = np.minimum(u.astype(np.intp), max(w - 2, 0))
    row = np.minimum(v.astype(np.intp), max(h - 2, 0))
    fu, fv = (u - col)[..., None], (v - row)[..., None]
    right, below = np.minimum(col + 1, w - 1), np.minimum(row + 1, h - 1)
    mixed = (1 - fv) * ((1 - fu) * rgb[row, col] + fu * rgb[row, right])
    mixed += fv * ((1 - fu) * rgb[below, col] + fu * rgb[below, right])
    return mixed * (255.0 / np.iinfo(rgb.dtype).max)
