"""Marks near a place: coverage of a marker's colour, un-mixed from what lies under it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REACH_PX = 24  # largest half-size of a marker
MIN_CONTRAST = 0.15  # of full scale: below it nothing was drawn
_PAD = 4


@dataclass(frozen=True, eq=False)
class Mark:
    """One connected mark: its coverage in a window, which of its pixels count, and how much."""

    alpha: Array
    valid: NDArray[np.bool_]
    u: Array
    v: Array
    start: tuple[float, float]
    radius: float
    weight: Array | float = 1.0


def coverages(patch: Array, at: tuple[float, float], search_px: float) -> list[Array]:
    """Coverage maps (0..1), one for each colour drawn near `at`; over grey they are exact.

    A grey background has no chroma, so a coloured marker's coverage is the chroma along its own,
    whatever the grey under it. A grey marker is told by its brightness against the median.
    """
    v, u = np.indices(patch.shape[:2])
    near = np.hypot(u - at[0], v - at[1]) <= search_px
    chroma = patch - patch.mean(axis=2, keepdims=True)
    strength = np.linalg.norm(chroma, axis=2)
    maps, open_ = [], near.copy()
    for _ in range(3):
        where = np.unravel_index(np.argmax(np.where(open_, strength, 0)), strength.shape)
        if strength[where] < MIN_CONTRAST:
            break
        colour = chroma[where]
        along = chroma @ colour / (colour @ colour)
        maps.append(along)
        aligned = along * np.linalg.norm(colour) > 0.7 * strength
        open_ &= ~(aligned & (strength > 0.3 * strength[where]))
    grey = patch.mean(axis=2)
    deviation = grey - np.median(grey)
    for sign in (1, -1):
        peak = (sign * deviation[near]).max()
        if peak > MIN_CONTRAST:
            maps.append(sign * deviation / peak)
    return [np.clip(coverage, 0, 1.2) for coverage in maps]


def marks_near(coverage: Array, at: tuple[float, float], search_px: float) -> list[Mark]:
    """The connected marks that reach within `search_px` of `at`, none cut by the window."""
    from scipy import ndimage

    number, _ = ndimage.label(coverage > 0.35, structure=np.ones((3, 3)))
    marks = []
    for k, box in enumerate(ndimage.find_objects(number), start=1):
        own = number[box] == k
        v, u = np.nonzero(own)
        v, u = v + box[0].start, u + box[1].start
        near = np.hypot(u - at[0], v - at[1]).min() <= search_px
        cut = _touches_border(box, coverage.shape)
        if not near or cut or len(u) < 4 or max(own.shape) > 2 * REACH_PX:
            continue
        marks.append(_mark(coverage, number, k, box))
    return marks


def _touches_border(box: tuple[slice, slice], shape: tuple[int, int]) -> bool:
    return any(s.start == 0 or s.stop == n for s, n in zip(box, shape, strict=True))


def _mark(coverage: Array, number: NDArray, k: int, box: tuple[slice, slice]) -> Mark:
    from scipy import ndimage

    window = tuple(
        slice(max(0, s.start - _PAD), min(n, s.stop + _PAD))
        for s, n in zip(box, coverage.shape, strict=True)
    )
    others = (number[window] != k) & (number[window] > 0)
    valid = ~ndimage.binary_dilation(others, iterations=2)
    alpha = coverage[window]
    v, u = np.indices(alpha.shape).astype(float)
    u, v = u + window[1].start, v + window[0].start
    weight = np.where(number[window] == k, alpha, 0.0)
    centre = (float((u * weight).sum() / weight.sum()), float((v * weight).sum() / weight.sum()))
    radius = max(s.stop - s.start for s in box) / 2
    return Mark(alpha, valid, u, v, centre, radius)
