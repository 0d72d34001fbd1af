"""Where the captions on a picture go: close to what they name, and never over each other.

A caption tries places around its point, the closest first. It takes the first one that lies inside
the picture, covers no other caption and covers nothing that has to stay visible. A caption without
such a place is omitted, and the sheet says how many were.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.review.paper import BODY

STEP = BODY.line_height // 2
"""Distance [px of the page] from one try to the next: half a line of text."""

TRIES = 24
"""Distances that are tried: a leader longer than twelve lines of text is hard to follow."""

LEADER_GAP = 0.4 * BODY.line_height
"""Length [px of the page] around its point that a leader does not cover."""

CLEARANCE = BODY.line_height // 8
"""Distance [px of the page] between two captions, and from a caption to the picture's edge."""

DIRECTIONS = 16
"""Number of directions that are tried at each distance, the first to the upper right."""


@dataclass(frozen=True)
class Place:
    """The corner (x, y) of a caption, and the leader (2, 2) from its point to its edge."""

    x: int
    y: int
    leader: NDArray[np.float64]


class Labeller:
    """Finds places for captions on a picture.

    Parameters
    ----------
    keep_visible
        (H, W) bool, the pixels that no caption may cover.
    """

    def __init__(self, keep_visible: NDArray[np.bool_]) -> None:
        self.height, self.width = keep_visible.shape
        self.omitted = 0
        self._placed: list[tuple[float, float, float, float]] = []
        self._sum = cv2.integral(keep_visible.astype(np.uint8))

    def place(self, point: NDArray[np.float64], width: int, height: int) -> Place | None:
        """A place for a caption of this size close to a point (x, y); `None` if there is none."""
        for attempt in range(1, TRIES + 1):
            distance = float(attempt * STEP)
            for k in range(DIRECTIONS):
                angle = -np.pi / 4 + k * 2 * np.pi / DIRECTIONS
                direction = np.array([np.cos(angle), np.sin(angle)])
                corner = np.asarray(point) + direction * distance
                # The caption extends away from its point.
                corner += (direction - 1) / 2 * (width, height)
                x, y = round(float(corner[0])), round(float(corner[1]))
                if not self._is_free(x, y, width, height):
                    continue
                self._placed.append((x, y, x + width, y + height))
                start = np.asarray(point, dtype=float)
                target = np.clip(start, (x, y), (x + width, y + height))
                length = float(np.hypot(*(target - start)))
                if length <= LEADER_GAP:
                    start = target
                else:
                    start = start + (target - start) * LEADER_GAP / length
                return Place(x, y, np.array([start, target]))
        self.omitted += 1
        return None

    def _is_free(self, x: int, y: int, width: int, height: int) -> bool:
        right, bottom = x + width, y + height
        if min(x, y) < CLEARANCE:
            return False
        if right > self.width - CLEARANCE or bottom > self.height - CLEARANCE:
            return False
        for other_x, other_y, other_right, other_bottom in self._placed:
            overlaps_across = x < other_right + CLEARANCE and other_x < right + CLEARANCE
            overlaps_down = y < other_bottom + CLEARANCE and other_y < bottom + CLEARANCE
            if overlaps_across and overlaps_down:
                return False
        total = self._sum
        covered = total[bottom, right] - total[y, right] - total[bottom, x] + total[y, x]
        return covered == 0
