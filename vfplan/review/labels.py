"""Where the captions on the slice go: beside what they name, and never over each other.

The rule: a caption tries places round its point, the closest first, and takes the first one that
lies inside the picture, covers no other caption and covers nothing that has to stay visible. A
caption that finds no such place is left out, and the sheet says how many were.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

# How far a caption's edge lies from its point [px of the page], the closest first.
DISTANCES = (16, 26, 40, 60, 85, 115, 150, 190, 240, 300, 370)

# Directions that are tried at each distance, the first to the upper right.
DIRECTIONS = 16

# A leader ends this far from its point [px of the page].
UNCOVERED = 12

# Room between two captions [px of the page].
CLEARANCE = 4


@dataclass(frozen=True)
class Place:
    """Where a caption stands (its corner), and the line that leads to it from its point."""

    left: int
    top: int
    leader: NDArray[np.float64]  # (2, 2), from its point to the caption's edge


class Labeller:
    """Finds room for captions in a picture of (height, width) pixels of the page.

    `keep_visible` is an (H, W) mask of what no caption may cover.
    """

    def __init__(self, keep_visible: NDArray[np.bool_]) -> None:
        self.height, self.width = keep_visible.shape
        self.taken: list[tuple[float, float, float, float]] = []
        self.left_out = 0
        self._sum = cv2.integral(keep_visible.astype(np.uint8))

    def place(self, point: NDArray[np.float64], width: int, height: int) -> Place | None:
        """Room for a caption of this size beside a point (x, y); `None` where there is none."""
        for distance in DISTANCES:
            for k in range(DIRECTIONS):
                angle = -np.pi / 4 + k * 2 * np.pi / DIRECTIONS
                along = np.array([np.cos(angle), np.sin(angle)])
                corner = np.asarray(point) + along * distance
                # The caption extends away from its point, and is centred beside or above it.
                corner += (along - 1) / 2 * (width, height)
                left, top = (round(float(x)) for x in corner)
                if self._is_free(left, top, width, height):
                    self.taken.append((left, top, left + width, top + height))
                    return Place(left, top, _leader(point, left, top, width, height))
        self.left_out += 1
        return None

    def _is_free(self, left: int, top: int, width: int, height: int) -> bool:
        right, bottom = left + width, top + height
        if left < 2 or top < 2 or right > self.width - 2 or bottom > self.height - 2:
            return False
        for one in self.taken:
            if (
                left < one[2] + CLEARANCE
                and one[0] < right + CLEARANCE
                and top < one[3] + CLEARANCE
                and one[1] < bottom + CLEARANCE
            ):
                return False
        total = self._sum
        covered = total[bottom, right] - total[top, right] - total[bottom, left] + total[top, left]
        return covered == 0


def _leader(
    point: NDArray[np.float64], left: int, top: int, width: int, height: int
) -> NDArray[np.float64]:
    """From beside the point, which stays uncovered, to the caption's edge."""
    start = np.asarray(point, dtype=float)
    target = np.clip(start, (left, top), (left + width, top + height))
    length = float(np.hypot(*(target - start)))
    if length <= UNCOVERED:
        return np.array([target, target])
    return np.array([start + (target - start) * UNCOVERED / length, target])
