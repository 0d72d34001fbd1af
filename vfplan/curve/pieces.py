"""The ink that a measured curve leaves: connected pieces, each with what its mark was taken for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate
from vfplan.curve.marks import Mark
from vfplan.curve.ridge import Centreline

EDGE_PX = 1.5  # beyond half a width from the curve ink is its own blur
LEAST_PIXELS = 3


@dataclass(frozen=True, eq=False)
class Piece:
    """Connected ink that the curve does not explain."""

    pixels: NDArray[np.int64]  # (N, 2) int64 (u, v)
    kind: str  # "own" where it hangs together with the curve, else what its mark was taken for
    # (2,) its centre, and the unit direction in which it extends
    middle: NDArray[np.float64]
    along: NDArray[np.float64]
    # Along that direction, and its area over that length
    length_px: float
    width_px: float

    @classmethod
    def of_pixels(cls, pixels: NDArray, kind: str) -> Piece:
        """Measure connected pixels."""
        middle = pixels.mean(0)
        off = pixels - middle
        along = np.linalg.svd(off.T @ off)[0][:, 0]
        length = float(np.ptp(off @ along)) + 1.0
        return cls(pixels, kind, middle, along, length, len(pixels) / length)


def pieces_beside(
    mask: NDArray[np.bool_],
    chosen: list[tuple[Candidate, Centreline]],
    told: list[Candidate],
    marks: list[Mark],
) -> tuple[list[Piece], dict[str, int]]:
    """What of the (H, W) mask the chosen lines leave, and how many pixels each kind has."""
    import cv2

    ink = mask.view(np.uint8)
    left, top, width, height = cv2.boundingRect(ink)
    ink, corner = ink[top : top + height, left : left + width], np.array([left, top])
    rest = np.ascontiguousarray(ink)
    for line, found in chosen:
        points = found.points if found.widening else line.path  # unmeasured ones have no order
        _wipe(rest, points - corner, found.closed, line.width_px / 2 + EDGE_PX)
    _, whole = cv2.connectedComponents(ink, connectivity=8)
    kind = _kinds(whole, corner, [line for line, _ in chosen], told, marks)
    rows, cols = np.nonzero(rest)
    _, label = cv2.connectedComponents(rest, connectivity=8)
    label = label[rows, cols]
    order = np.argsort(label, kind="stable")
    cuts = np.split(order, np.flatnonzero(np.diff(label[order])) + 1) if len(order) else []
    pixels = {"curve": int(np.count_nonzero(ink) - np.count_nonzero(rest))}
    pieces = []
    for cut in cuts:
        name = kind.get(int(whole[rows[cut[0]], cols[cut[0]]]), "speck")
        pixels[name] = pixels.get(name, 0) + len(cut)
        if len(cut) >= LEAST_PIXELS:
            at = np.column_stack([cols[cut], rows[cut]]) + corner
            pieces.append(Piece.of_pixels(at, name))
    return pieces, pixels


def _wipe(ink: NDArray[np.uint8], points: NDArray, closed: bool, reach: float) -> None:
    import cv2

    fine, shift = 16, 4
    places = np.rint(points * fine).astype(np.int32)[:, None]
    cv2.polylines(ink, [places], closed, 0, max(1, round(2 * reach)), cv2.LINE_8, shift)


def _kinds(
    whole: NDArray,
    corner: NDArray,
    chosen: list[Candidate],
    told: list[Candidate],
    marks: list[Mark],
) -> dict[int, str]:
    """The kind of each connected label of the mask."""
    named = [(m.kind, m.branches[0].path) for m in marks if m.branches]
    named += [(line.kind, line.pixels) for line in told]
    named += [("own", line.pixels) for line in chosen]
    kinds: dict[int, str] = {}
    for name, pixels in named:
        u, v = (pixels - corner).T
        on = (u >= 0) & (v >= 0) & (u < whole.shape[1]) & (v < whole.shape[0])
        kinds |= dict.fromkeys(whole[v[on], u[on]].tolist(), name)
    kinds.pop(0, None)
    return kinds
