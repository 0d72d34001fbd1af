"""Marks: those near a place, un-mixed from what lies under them, and all small ones of a slice.

Near a place a marker's colour is un-mixed, and its coverage kept; all over a slice it is only known
roughly where marks are, and which are of one kind.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEAR_PX = 8.0  # how far a marker may be from where it was said to be
ROUNDED_PX = 0.25  # its centre, as programs round it
REACH_PX = 24  # largest half-size of a marker
MIN_CONTRAST = 0.15  # of full scale: below it nothing was drawn
_PAD = 4
HUES = 24  # sectors of the circle of hues that are told apart
STAMPED = 0.96  # correlation of one mark with most of its kind; digits have less
ALIKE = 0.35  # marks of one kind differ less than this share, or 2 px, in width and height
FEWEST = 3
WHITE, WHITISH, BRIGHTER = 247, 200, 64  # thin lines cover half of their pixels
COLOURED = (MIN_CONTRAST, 0.4)  # blurred by compression; what a label touches
MOST_SPOTS = 400  # more of one hue is a colour picture, not marks


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


def inside(rgb: NDArray, at: tuple[float, float]) -> bool:
    """Whether a place lies in the picture."""
    height, width = rgb.shape[:2]
    return -0.5 <= at[0] <= width - 0.5 and -0.5 <= at[1] <= height - 0.5


def window(
    rgb: NDArray, full: float, at: tuple[float, float], search_px: float
) -> tuple[NDArray, tuple[float, float], tuple[int, int]]:
    """The picture around `at` (0..1), `at` within it, and its first column and row."""
    half = int(np.ceil(search_px)) + REACH_PX
    u0, v0 = max(0, round(at[0]) - half), max(0, round(at[1]) - half)
    patch = rgb[v0 : round(at[1]) + half + 1, u0 : round(at[0]) + half + 1] / full
    return patch, (at[0] - u0, at[1] - v0), (u0, v0)


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


@dataclass(frozen=True, eq=False)
class Kind:
    """Marks of one hue and size."""

    places_px: Array  # (M, 2) their centres of area (u, v)
    own: NDArray  # (M,) which of the spots they are
    boxes: NDArray  # of all spots, their left, top, width, height and area
    numbers: NDArray  # (H, W) the spot that a pixel is of, from 1
    faint: bool = False  # told by little, so that some may be missing

    def met_by(self, places: Array) -> tuple[NDArray, Array]:
        """Which places (N, 2) have a mark near them, each the other's nearest, and where it is."""
        apart = np.linalg.norm(places[:, None] - self.places_px[None], axis=2)
        nearest, every = apart.argmin(axis=1), np.arange(len(places))
        near = apart[every, nearest] <= NEAR_PX
        own = np.flatnonzero(near & (apart.argmin(axis=0)[nearest] == every))
        return own, self.places_px[nearest[own]]

    def spotted(self, places: Array) -> NDArray[np.bool_]:
        """Which places (N, 2) lie on a spot of the hue that is as long as most of the kind."""
        longest = self.boxes[:, 2:4].max(axis=1)
        usual = np.median(longest[self.own])
        alike = self.boxes[np.abs(longest - usual) <= max(2, ALIKE * usual)]
        middle = alike[:, :2] + (alike[:, 2:4] - 1) / 2
        return (np.linalg.norm(places[:, None] - middle, axis=2) <= NEAR_PX / 2).any(axis=1)

    def square_from(self, places: Array) -> float:
        """Mean square distance of places (N, 2) from their marks; of one without the limit's."""
        own, drawn = self.met_by(places)
        bare = (len(places) - len(own)) * NEAR_PX**2
        square = float(((places[own] - drawn) ** 2).sum() + bare) / len(places)
        return max(square, ROUNDED_PX**2)

    def chance(self, places: Array, needed: int, *, free: int = 0) -> float:
        """The chance that so many places lie so near to marks, `free` of them laid onto any."""
        from scipy.special import bdtrc

        (own, drawn), count = self.met_by(places), len(self.places_px)
        if len(own) < max(needed, free + 1):
            return 1.0
        away = np.sort(np.linalg.norm(places[own] - drawn, axis=1))
        near = count * np.pi * np.maximum(away, 1.0) ** 2 / self.numbers.size
        others = np.arange(len(own)) - free  # of the k nearest, without those laid and one
        chances = bdtrc(others, len(places) - free, np.minimum(near, 1.0))
        return float(count**free * chances[needed - 1 :].min())

    def stamped(self, least: int) -> bool:
        """Whether so many, and most, have one shape, the same upside down: crosses, dots, rings.

        Letters with others beside them, on one line, are none.
        """
        import cv2

        side = int(self.boxes[self.own, 2:4].max()) + 5
        masks = []
        for k, place in zip(self.own, self.places_px, strict=True):
            left, top, width, height = self.boxes[k, :4]
            mask = self.numbers[top : top + height, left : left + width] == k + 1
            at = tuple((place - [left, top] + side).tolist())
            mask = cv2.getRectSubPix(np.pad(mask, side).astype(np.float32), (side, side), at)
            masks.append(cv2.GaussianBlur(mask, (0, 0), 1.0).ravel())
        each = np.array(masks) / np.linalg.norm(masks, axis=1)[:, None]
        shape = np.median(np.r_[each, each[:, ::-1]], axis=0)
        like = each @ shape / np.linalg.norm(shape)
        alike = int((like >= STAMPED).sum())
        lettered = sum(map(self._in_a_line, self.own))
        return alike >= max(least, 0.8 * len(each)) and 2 * lettered < len(each)

    def _in_a_line(self, k: int) -> bool:
        """Whether another spot stands on the same foot beside this one, nearer than its height."""
        left, top, width, height = self.boxes[:, :4].T
        same_foot = np.abs(top + height - top[k] - height[k]) <= 1
        gap = np.maximum(left - left[k] - width[k], left[k] - left - width)
        return bool((same_foot & (gap >= 0) & (gap < height[k])).any())


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
    above = cv2.subtract(least, cv2.blur(least, (REACH_PX, REACH_PX)))
    for faint in (least >= WHITISH, above >= BRIGHTER):
        kinds += [replace(kind, faint=True) for kind in _of_mask(faint.astype(np.uint8))]
    rows, columns = np.nonzero(strength > 255 * MIN_CONTRAST)
    pixels = small[rows, columns].astype(np.float64)
    hue = np.arctan2(
        np.sqrt(3) * (pixels[:, 1] - pixels[:, 2]), 2 * pixels[:, 0] - pixels[:, 1] - pixels[:, 2]
    )
    for centre in _peaks(hue, strength[rows, columns]):
        own = np.abs(np.angle(np.exp(1j * (hue - centre)))) < 1.5 * 2 * np.pi / HUES
        mask = np.zeros_like(strength)
        mask[rows[own], columns[own]] = strength[rows[own], columns[own]]
        for level in COLOURED:
            kinds += _of_mask((mask > 255 * level).astype(np.uint8))
    return kinds


def _of_mask(mask: NDArray[np.uint8]) -> list[Kind]:
    import cv2

    count, numbers, boxes, places = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count > MOST_SPOTS:
        return []
    groups = _by_size(boxes[1:])
    return [Kind(places[1:][group], group, boxes[1:], numbers) for group in groups]


def _peaks(hue: Array, weight: Array) -> list[float]:
    """The hues that many pixels share."""
    sector = ((hue + np.pi) / (2 * np.pi) * HUES).astype(int) % HUES
    mass = np.bincount(sector, weight, HUES)
    peaks = [
        k for k in range(HUES) if mass[k] > 0 and mass[k] >= max(mass[k - 1], mass[(k + 1) % HUES])
    ]
    centres = (sector[:, None] == np.array(peaks)).T
    return [float(np.angle((weight[c] * np.exp(1j * hue[c])).sum())) for c in centres]


def _by_size(boxes: NDArray) -> list[NDArray]:
    """Spots of about one width and height together, the larger groups first."""
    size, area = boxes[:, 2:4].astype(float), boxes[:, 4]
    open_ = (size.max(axis=1) <= 2 * REACH_PX) & (area >= 4) & (size.min(axis=1) >= 3)
    groups = []
    while open_.sum() >= FEWEST:
        near = [
            open_ & (np.abs(size - size[k]) <= np.maximum(2, ALIKE * size[k])).all(axis=1)
            for k in np.flatnonzero(open_)
        ]
        group = max(near, key=np.count_nonzero)
        if group.sum() < FEWEST:
            break
        groups.append(np.flatnonzero(group))
        open_ &= ~group
    return groups
