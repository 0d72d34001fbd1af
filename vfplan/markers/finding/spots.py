"""All small marks of a slice at once: roughly where they are, and which are of one kind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.markers.finding.marks import MIN_CONTRAST, REACH_PX, Array

HUES = 24  # sectors of the circle of hues that are told apart
ALIKE = 0.35  # marks of one kind differ less than this share, or 2 px, in width and height
FEWEST = 3
WHITE = 247
MOST_SPOTS = 400  # more of one hue is a colour picture, not marks


@dataclass(frozen=True, eq=False)
class Kind:
    """Marks of one hue and size."""

    places_px: Array  # (M, 2) their centres of area (u, v)


def kinds_of_spots(rgb: NDArray) -> list[Kind]:
    """The small marks by hue and size, at least `FEWEST` of a kind: coloured ones, and white ones.

    CT has no colour, but white specks: what is made of white ones must be looked at more closely.

    rgb: (H, W, 3) uint8 or uint16
    """
    import cv2

    small = rgb if rgb.dtype == np.uint8 else (rgb >> 8).astype(np.uint8)
    planes = cv2.split(small)
    least = cv2.min(cv2.min(*planes[:2]), planes[2])
    strength = cv2.max(cv2.max(*planes[:2]), planes[2]) - least
    kinds = _of_mask((least >= WHITE).astype(np.uint8))
    rows, columns = np.nonzero(strength > 255 * MIN_CONTRAST)
    pixels = small[rows, columns].astype(np.float64)
    hue = np.arctan2(
        np.sqrt(3) * (pixels[:, 1] - pixels[:, 2]), 2 * pixels[:, 0] - pixels[:, 1] - pixels[:, 2]
    )
    for centre in _peaks(hue, strength[rows, columns]):
        own = np.abs(np.angle(np.exp(1j * (hue - centre)))) < 1.5 * 2 * np.pi / HUES
        mask = np.zeros(strength.shape, np.uint8)
        mask[rows[own], columns[own]] = 1
        kinds += _of_mask(mask)
    return kinds


def _of_mask(mask: NDArray[np.uint8]) -> list[Kind]:
    import cv2

    count, _, boxes, places = cv2.connectedComponentsWithStats(mask, connectivity=8)
    return _by_size(boxes[1:], places[1:]) if count <= MOST_SPOTS else []


def _peaks(hue: Array, weight: Array) -> list[float]:
    """The hues that many pixels share."""
    sector = ((hue + np.pi) / (2 * np.pi) * HUES).astype(int) % HUES
    mass = np.bincount(sector, weight, HUES)
    peaks = [
        k for k in range(HUES) if mass[k] > 0 and mass[k] >= max(mass[k - 1], mass[(k + 1) % HUES])
    ]
    centres = (sector[:, None] == np.array(peaks)).T
    return [float(np.angle((weight[c] * np.exp(1j * hue[c])).sum())) for c in centres]


def _by_size(boxes: NDArray, places: NDArray) -> list[Kind]:
    """Spots of about one width and height together, the larger groups first."""
    size, area = boxes[:, 2:4].astype(float), boxes[:, 4]
    open_ = (size.max(axis=1) <= 2 * REACH_PX) & (area >= 4) & (size.min(axis=1) >= 3)
    kinds = []
    while open_.sum() >= FEWEST:
        near = [
            open_ & (np.abs(size - size[k]) <= np.maximum(2, ALIKE * size[k])).all(axis=1)
            for k in np.flatnonzero(open_)
        ]
        group = max(near, key=np.count_nonzero)
        if group.sum() < FEWEST:
            break
        kinds.append(Kind(places[group]))
        open_ &= ~group
    return kinds
