"""Drawn crosses and dots -> their centres, to a fraction of a pixel.

Near each given position: un-mix the marker's colour from what lies under it, take the mark, and fit
the coverage that a blurred cross or a blurred disc would have. The fit's centre is the marker's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.errors import MarkerError, SettingError
from vfplan.markers.finding.marks import NEAR_PX, coverages, inside, marks_near, window
from vfplan.markers.finding.shapes import GOOD_MISFIT, Shape, fit_mark

MAX_MISFIT = 0.45  # RMS: above it, no cross and no dot


@dataclass(frozen=True)
class FoundMarker:
    """A marker as drawn in the image."""

    label: str  # its label
    # (u, v) of its centre; the centre of the top-left pixel is (0, 0)
    position_px: tuple[float, float]
    moved_px: float  # distance from where it was said to be
    shape: Shape  # "cross" or "dot"
    misfit: float  # RMS of the drawn coverage (0..1) minus the shape's, over the mark


def find_markers(
    rgb: NDArray, labels: Sequence[str], positions_px: ArrayLike, *, search_px: float = NEAR_PX
) -> tuple[FoundMarker, ...]:
    """The drawn marker nearest to each given position.

    rgb: (H, W, 3) uint8 or uint16
    labels: (N,) names, for messages and in the result
    positions_px: (N, 2) where the markers are said to be (u, v)
    search_px: how far a marker's centre may be from there
    Raises MarkerError: a position outside the image, no cross or dot near it, or two markers found
        in one place
    Raises SettingError: a search radius that is not above 0
    """
    if not 0 < search_px < float("inf"):
        raise SettingError(f"search radius is {search_px} px; a finite number above 0 is wanted")
    positions = np.asarray(positions_px, dtype=float)
    full = float(np.iinfo(rgb.dtype).max)
    found = tuple(
        _find_one(rgb, full, label, (float(u), float(v)), search_px)
        for label, (u, v) in zip(labels, positions, strict=True)
    )
    for i, a in enumerate(found):
        for b in found[i + 1 :]:
            if np.hypot(*np.subtract(a.position_px, b.position_px)) < 1:
                raise MarkerError(
                    f"{a.label!r} and {b.label!r} were both found at ({a.position_px[0]:.1f}, "
                    f"{a.position_px[1]:.1f}) px; each needs a mark of its own"
                )
    return found


def _find_one(
    rgb: NDArray, full: float, label: str, at: tuple[float, float], search_px: float
) -> FoundMarker:
    if not inside(rgb, at):
        height, width = rgb.shape[:2]
        raise MarkerError(
            f"marker {label!r} at ({at[0]:.1f}, {at[1]:.1f}) px lies outside the image, "
            f"{width}x{height} px"
        )
    patch, local, (u0, v0) = window(rgb, full, at, search_px)
    best: FoundMarker | None = None
    for coverage in coverages(patch, local, search_px):
        for mark in marks_near(coverage, local, search_px):
            u, v, shape, misfit = fit_mark(mark, patch)
            moved = float(np.hypot(u - local[0], v - local[1]))
            one = FoundMarker(label, (u + u0, v + v0), moved, shape, misfit)
            if misfit <= MAX_MISFIT and moved <= search_px and (not best or _better(one, best)):
                best = one
        if best is not None and best.misfit < GOOD_MISFIT:
            break
    if best is None:
        raise MarkerError(
            f"no cross or dot within {search_px:g} px of marker {label!r} at ({at[0]:.1f}, "
            f"{at[1]:.1f}) px"
        )
    return best


def _better(one: FoundMarker, other: FoundMarker) -> bool:
    """The better fit of one mark; of two marks the nearer."""
    apart = np.hypot(*np.subtract(one.position_px, other.position_px))
    return one.misfit < other.misfit if apart < 2 else one.moved_px < other.moved_px
