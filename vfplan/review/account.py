"""The account of a slice: ink in the pen's colour that is not the curve's, and where it is bridged.

`vfplan extract` lists the same when it has measured a curve. A curve that a person mended has
another account, so the review makes it anew, by the same rule and with the same numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfplan.curve import tuned
from vfplan.curve.centreline import runs
from vfplan.fixture import Fixture, Stroke
from vfplan.planning import ExtractSettings

Array = NDArray[np.float64]

Box = tuple[int, int, int, int]

MAX_ENTRIES = 200
"""Entries that are listed at most; more is a photograph, not a drawing."""


@dataclass(frozen=True, eq=False)
class Entry:
    """A piece of ink that is not the curve, or a stretch of the curve that shows no ink.

    Parameters
    ----------
    number
        From 1, the largest first.
    middle
        (u, v) [px]: the middle of the ink's box, or of the stretch.
    pixels
        How many pixels of ink, or points of the stretch.
    share
        The same, over all pixels of ink.
    box
        (u, v, width, height) [px] of the ink.
    mask
        (height, width) bool, the ink in its box; `None` for a stretch.
    """

    number: int
    middle: tuple[float, float]
    pixels: int
    share: float
    box: Box
    mask: NDArray[np.bool_] | None

    @property
    def is_ink(self) -> bool:
        """Whether it is ink, and no stretch of the curve."""
        return self.mask is not None

    @property
    def outline(self) -> list[list[list[float]]]:
        """The ink's outlines, half a pixel outside of it: a list of (K, 2) places."""
        if self.mask is None:
            return []
        padded = cv2.copyMakeBorder(self.mask.view(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT)
        contours, _ = cv2.findContours(padded, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        corner = np.array(self.box[:2]) - 1.0
        return [(contour[:, 0] + corner).round(1).tolist() for contour in contours]


def list_account(mask: NDArray[np.bool_], lines: Sequence[Stroke]) -> tuple[Entry, ...]:
    """All ink of a (H, W) mask beyond the lines' edges, and each bridged stretch, by size.

    The lines have the width of their pen.
    """
    from scipy.spatial import cKDTree

    nonzero = cv2.findNonZero(mask.view(np.uint8))
    if nonzero is None:
        return ()
    pixels = nonzero.reshape(-1, 2).astype(np.int64)
    edge_distance = np.full(len(pixels), np.inf)
    for line in lines:
        to_line, _ = cKDTree(line.points).query(pixels)
        edge_distance = np.minimum(edge_distance, to_line - line.width / 2)
    # Connected pieces, but for specks.
    left = pixels[edge_distance > tuned.EDGE_BLUR_PX]
    pieces = []
    if len(left):
        corner = left.min(axis=0)
        width, height = (left.max(axis=0) - corner + 1).tolist()
        picture = np.zeros((height, width), np.uint8)
        picture[left[:, 1] - corner[1], left[:, 0] - corner[0]] = 1
        _, labels = cv2.connectedComponents(picture, connectivity=8)
        label = labels[left[:, 1] - corner[1], left[:, 0] - corner[0]]
        sizes = np.bincount(label)[1:]
        pieces = np.split(np.argsort(label, kind="stable"), np.cumsum(sizes)[:-1])
    entries = []
    for members in pieces:
        if len(members) < tuned.SPECK_PX:
            continue
        piece = left[members]
        low, high = piece.min(axis=0), piece.max(axis=0)
        box = (*low.tolist(), *(high - low + 1).tolist())
        piece_mask = np.zeros((box[3], box[2]), bool)
        piece_mask[piece[:, 1] - low[1], piece[:, 0] - low[0]] = True
        middle = tuple(((low + high) / 2).tolist())
        entries.append((len(piece), middle, box, piece_mask))
    for line in lines:
        for run in runs(line.bridged, line.closed):
            u, v = line.points[run[len(run) // 2]].tolist()
            entries.append((len(run), (u, v), (round(u), round(v), 1, 1), None))
    entries.sort(key=lambda entry: (-entry[0], *entry[1]))
    account = []
    for number, (count, middle, box, piece_mask) in enumerate(entries[:MAX_ENTRIES], 1):
        account.append(Entry(number, middle, count, count / len(pixels), box, piece_mask))
    return tuple(account)


def extraction_of(fixture: Fixture, settings: ExtractSettings) -> ExtractSettings:
    """The settings with which a bundle's curve was extracted, as far as it records them."""
    known = fixture.provenance.settings
    recorded: dict[str, Any] = {}
    for name in ("colour", "method", "max_gap_px", "accept_width", "stroke", "density_per_mm"):
        if name in known:
            recorded[name] = known[name]
    for name in ("start", "end"):
        if name in known:
            recorded[name] = tuple(float(number) for number in str(known[name]).split(","))
    roi = None
    for box in boxes_of(known.get("roi")):
        roi = box
    return replace(settings, **recorded, roi=roi, exclude=boxes_of(known.get("exclude")) or None)


def boxes_of(text: Any) -> tuple[Box, ...]:
    """The boxes of a bundle's setting, such as "1,2,30,40;5,6,7,8"."""
    boxes = []
    for part in str(text or "").split(";"):
        numbers = part.split(",")
        if len(numbers) == 4 and all(number.strip().isdigit() for number in numbers):
            u, v, width, height = (int(number) for number in numbers)
            boxes.append((u, v, width, height))
    return tuple(boxes)
