"""The outline beside a drawn line: what a picture shows of a curve without covering its ink."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FINE = 4
"""Parts of a pixel, so that the outline is a smooth line on a picture twice as large."""


def outline_along(points: Array, distance: float, *, closed: bool = False) -> list[Array]:
    """Closed lines (K, 2) that lie this far from a line of (M, 2) points, all [px].

    A closed line has two, one on either side; an open one has one around it.
    """
    margin = distance + 2
    corner = np.floor(points.min(axis=0) - margin)
    width, height = (np.ceil(points.max(axis=0) + margin) - corner).astype(int) * FINE + 1
    region = np.zeros((height, width), np.uint8)
    # OpenCV takes coordinates as whole numbers of 1/16 pixel.
    vertices = np.rint((points - corner) * FINE * 16).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(
        region, [vertices], closed, 255, max(1, round(2 * distance * FINE)), cv2.LINE_8, 4
    )
    contours, _ = cv2.findContours(region, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    outlines = []
    for contour in contours:
        ring = contour[:, 0] / FINE + corner
        outlines.append(np.vstack([ring, ring[:1]]))
    return outlines
