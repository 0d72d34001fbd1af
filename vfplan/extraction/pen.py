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
MIN_CHROMA = 30.0  # of a named pen's colour, on the 0..255 scale


@dataclass(frozen=True, eq=False)
class Pen:
    """A pen's colour in the chroma plane (the plane across grey), on the scale 0..255.

    Parameters
    ----------
    along
        (3,) unit vector: the pen's own direction, e.
    across
        (3,) unit vector of the same plane at right angles to it.
    strength
        |c⊥| times the opacity: what p · e reaches in the middle of the line.
    """

    along: NDArray[np.float64]
    across: NDArray[np.float64]
    strength: float

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


def pen_mask(rgb: NDArray, pen: Pen, floor: float) -> NDArray[np.uint8]:
    """(H, W) uint8, 1 where a pixel's chroma is above `floor` and within the hue gate of the pen.

    Works in strips of rows, so that its memory is one byte a pixel.
    """
    import cv2

    slope = np.tan(np.radians(HUE_GATE_DEG))
    scale = 255.0 / np.iinfo(rgb.dtype).max
    rows = scale * np.array(
        [pen.along, slope * pen.along - pen.across, slope * pen.along + pen.across]
    )
    mask = np.empty(rgb.shape[:2], np.uint8)
    for top in range(0, rgb.shape[0], 256):
        strip = cv2.transform(rgb[top : top + 256], rows)  # saturates: negative becomes 0
        np.logical_and(
            strip[..., 0] > floor,
            (strip[..., 1] > 0) & (strip[..., 2] > 0),
            out=mask[top : top + 256].view(bool),
        )
    return mask


def chroma_at(rgb: NDArray, rows: NDArray, cols: NDArray, pen: Pen) -> tuple[NDArray, NDArray]:
    """p · along and p · across of the pixels (rows, cols), on the scale 0..255."""
    pixels = rgb[rows, cols] * (255.0 / np.iinfo(rgb.dtype).max)
    return pixels @ pen.along, pixels @ pen.across


def sample_chroma(
    rgb: NDArray, u: NDArray, v: NDArray, pen: Pen
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """p · along and p · across at sub-pixel places, bilinear; outside the image the edge goes on.

    Only the four pixels around each place are read, so the cost follows the curve, not the image.
    """
    h, w = rgb.shape[:2]
    u = np.clip(u, 0, w - 1)
    v = np.clip(v, 0, h - 1)
    col = np.minimum(u.astype(np.intp), max(w - 2, 0))
    row = np.minimum(v.astype(np.intp), max(h - 2, 0))
    fu, fv = (u - col)[..., None], (v - row)[..., None]
    right, below = np.minimum(col + 1, w - 1), np.minimum(row + 1, h - 1)
    both = np.column_stack([pen.along, pen.across]) * (255.0 / np.iinfo(rgb.dtype).max)
    mixed = (1 - fv) * ((1 - fu) * rgb[row, col] + fu * rgb[row, right])
    mixed += fv * ((1 - fu) * rgb[below, col] + fu * rgb[below, right])
    result = mixed @ both
    return result[..., 0], result[..., 1]
