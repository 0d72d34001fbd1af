"""The outline of a filled region, where half of a pixel's square is covered."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate
from vfplan.curve.marks import Mark
from vfplan.curve.path import arc_length, evenly
from vfplan.curve.pen import Pen
from vfplan.curve.ridge import Centreline
from vfplan.errors import CurveError

MARGIN_PX = 3
SMOOTH_PX = 1.5  # along the outline: the pixels' own staircase
SIGMA_PX = 0.1  # at least: an edge has one side only, and programs differ in how they fill


def region_of(marks: list[Mark]) -> Mark:
    """The one filled region; raises `CurveError` for none or several."""
    filled = [m for m in marks if m.kind == "panel"]
    if len(filled) != 1:
        places = ", ".join(f"({m.box[0]}, {m.box[1]})" for m in filled[:6])
        raise CurveError(
            f"--outline wants one filled region, found {len(filled)}"
            + (f" at {places}; look in a part of the image (--roi, --exclude)" if filled else "")
        )
    return filled[0]


def outline_of(
    rgb: NDArray, mark: Mark, mask: NDArray[np.bool_]
) -> tuple[Candidate, Centreline, list[str]]:
    """The outer outline of a filled mark of the (H, W) mask, and a warning where it has holes."""
    import cv2
    from scipy.ndimage import gaussian_filter1d
    from skimage.measure import find_contours

    u, v, width, height = mark.box
    top, left = max(v - MARGIN_PX, 0), max(u - MARGIN_PX, 0)
    box = (slice(top, v + height + MARGIN_PX), slice(left, u + width + MARGIN_PX))
    _, label = cv2.connectedComponents(mask[box].view(np.uint8), connectivity=8)
    inside = mark.branches[0].path[len(mark.branches[0].path) // 2] - [left, top]
    own = (label == label[inside[1], inside[0]]).view(np.uint8)
    near = cv2.dilate(own, np.ones((3, 3), np.uint8)) > 0
    alpha = np.where(near, _coverage(rgb[box], mark.pen), 0.0)
    rings = sorted(find_contours(np.pad(alpha, 1), 0.5), key=lambda c: -_area(c))
    ring = rings[0][:-1, ::-1] - 1
    ring = ring if _signed(ring) > 0 else ring[::-1]
    even, _ = evenly(ring, True)
    points = gaussian_filter1d(even, SMOOTH_PX, axis=0, mode="wrap")
    points = np.roll(points, -int(points.sum(1).argmin()), 0) + np.array([left, top])
    none = np.zeros(len(points), bool)
    rough = even - gaussian_filter1d(even, SMOOTH_PX, axis=0, mode="wrap")
    sigma = np.full(len(points), np.hypot(SIGMA_PX, np.sqrt((rough**2).mean())))
    line = Centreline(points, sigma, none, True, float(arc_length(points, True)[-1]))
    holes = sum(_area(c) > 1 for c in rings[1:])
    warnings = [f"the filled region has {holes} holes; its outer outline is taken"] if holes else []
    return Candidate(points, True, none, (mark,)), line, warnings


def _coverage(rgb: NDArray, pen: Pen) -> NDArray[np.float64]:
    return rgb @ pen.along * (255.0 / np.iinfo(rgb.dtype).max) / pen.strength


def _signed(ring: NDArray) -> float:
    after = np.roll(ring, -1, 0)
    return float(np.sum(ring[:, 0] * after[:, 1] - after[:, 0] * ring[:, 1])) / 2


def _area(ring: NDArray) -> float:
    return abs(_signed(ring))
