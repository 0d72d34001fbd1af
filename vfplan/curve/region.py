"""Where the caller wants the curve to be sought, and between which two places it runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError

Box = tuple[int, int, int, int]
"""(u, v, width, height) [px]."""


@dataclass(frozen=True)
class Region:
    """The part of a picture that is looked at.

    Parameters
    ----------
    inside
        The box to look in; `None` for the whole picture.
    outside
        Boxes that are not looked at.
    """

    inside: Box | None = None
    outside: tuple[Box, ...] = ()

    @classmethod
    def of(cls, roi: Box | None, exclude: Sequence[Box], shape: tuple[int, ...]) -> Region:
        """The region of the options `roi` and `exclude`; raises `SettingError`."""
        for box in exclude:
            _check_box(box, shape)
        inside = None
        if roi is not None:
            _check_box(roi, shape)
            inside = tuple(int(x) for x in roi)
        return cls(inside, tuple(tuple(int(x) for x in box) for box in exclude))

    def clear_outside(self, planes: NDArray, window: tuple[slice, slice]) -> None:
        """Set (h, w, ...) values over a window of the picture to 0 where it is not looked at."""
        rows, columns = window
        for u, v, width, height in self.outside:
            top, left = max(v - rows.start, 0), max(u - columns.start, 0)
            bottom, right = max(v + height - rows.start, 0), max(u + width - columns.start, 0)
            planes[top:bottom, left:right] = 0
        if self.inside is not None:
            u, v, width, height = self.inside
            planes[: max(v - rows.start, 0)] = 0
            planes[max(v + height - rows.start, 0) :] = 0
            planes[:, : max(u - columns.start, 0)] = 0
            planes[:, max(u + width - columns.start, 0) :] = 0

    def border_distance(self, points: NDArray, size: NDArray) -> NDArray[np.float64]:
        """(M,) how far points (M, 2) lie from a border of the region, but for the picture's own."""
        distance = np.full(len(points), np.inf)
        borders = list(self.outside)
        if self.inside is not None:
            borders.append(self.inside)
        for u, v, width, height in borders:
            low = np.array([u, v]) - 0.5
            high = np.add(low, (width, height))
            # The picture's own border is no border of the region.
            low = np.where(low > 0, low, -np.inf)
            high = np.where(high < size - 1, high, np.inf)
            beyond = np.maximum(low - points, points - high).max(1)
            distance = np.minimum(distance, np.abs(beyond))
        return distance


def _check_box(box: Box, shape: tuple[int, ...]) -> None:
    if np.shape(box) != (4,) or np.asarray(box).dtype.kind not in "iu":
        raise SettingError(
            f"The region {box} is no box. Give u, v, width and height in whole pixels.",
            code="region-not-a-box",
        )
    u, v, width, height = (int(x) for x in box)
    rows, columns = shape[:2]
    fits = u >= 0 and v >= 0 and width > 0 and height > 0
    if not fits or u + width > columns or v + height > rows:
        raise SettingError(
            f"The region {u},{v},{width},{height} leaves the picture. Keep it within its "
            f"{columns}x{rows} px.",
            code="region-outside",
            numbers={"region": [u, v, width, height], "width_px": columns, "height_px": rows},
        )
