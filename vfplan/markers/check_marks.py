"""The small marks drawn on a slice, and how given marker positions lie to them.

No residual shows positions that were read wrongly as a whole (rows counted from below, a view at
80 %, another slice): the affine map follows them. The slice shows it, where the markers are drawn.

Positions are (N, 2) (u, v) px; the centre of the top-left pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.errors import CheckFailed
from vfplan.findings import Finding, Findings, doubt, note
from vfplan.geometry.lines import Array, Flags, Indices, rms_length, row_lengths
from vfplan.markers.find_marks import (
    CLEAR_MISFIT,
    MARK_REACH_PX,
    MAX_SIDE_PX,
    MIN_CONTRAST,
    find_mark,
)

Pixels = NDArray[np.uint8]

# Shorter side [px] of the smallest mark. What is smaller is a speck.
MIN_SIDE_PX = 3

# Smallest chroma of ink that is not blurred, of 255. It separates a mark from a label that touches
# it.
PURE_CHROMA = 100

# Smallest brightness of white ink, of 255, in every channel.
WHITE = 247

# Largest number of small spots of one colour on a slice with marks. A colour picture has more.
MAX_SPOTS = 400

# Largest difference between marks of one kind, as a share of their width and height. Of small ones
# 2 px are allowed.
ALIKE_SIZE = 0.35

# Smallest correlation of the pictures of two marks of one kind. Those of two digits have less.
ALIKE_SHAPE = 0.9

# Largest distance [px] of a careful click from its mark, beyond what the others scatter.
SINGLE_OFFSET_PX = 1.5

# Largest common shift [px] of positions that only count from another corner of the pixel.
COMMON_SHIFT_PX = 0.6

# Largest RMS distance [px] of clicked positions from their marks. Wrong readings lie further off.
CLICKED_RMS_PX = 2 * SINGLE_OFFSET_PX


@dataclass(frozen=True, eq=False)
class DrawnMarks:
    """Marks of one colour and about one size."""

    # (M, 2) their centres of area [px].
    places_px: Array
    # Whether they all have one shape that looks the same upside down, as crosses, dots and rings.
    are_stamped: bool
    # (K, 2) the centres of all spots of this colour that are no larger than marks [px], these too.
    spots_px: Array


def nearest_pairs(places_px: Array, marks_px: Array) -> tuple[Indices, Array]:
    """Which of the places (N, 2) have a mark of (M, 2) near them, and (K, 2) that mark.

    A place and its mark are each the other's nearest.
    """
    if not len(places_px) or not len(marks_px):
        return np.zeros(0, np.intp), np.zeros((0, 2))
    distance = np.linalg.norm(places_px[:, None] - marks_px[None], axis=2)
    nearest = distance.argmin(axis=1)
    rows = np.arange(len(places_px))
    is_mutual = distance.argmin(axis=0)[nearest] == rows
    matched = np.flatnonzero((distance[rows, nearest] <= MARK_REACH_PX) & is_mutual)
    return matched, marks_px[nearest[matched]]


def compare_with_marks(
    rgb: NDArray[Any], labels: Sequence[str], positions_px: ArrayLike, *,
    markers_as_given: bool = False,
) -> tuple[dict[str, Any], Findings]:  # fmt: skip
    """Compare given marker positions with the marks that a slice shows: a report, and findings.

    The report has how many positions have a mark `near`, and how many marks of one kind are `drawn`
    (0 where none are surely marks); where they have marks, also the RMS distance from these and its
    mean, given minus drawn [px].

    Parameters
    ----------
    rgb
        (H, W, 3) uint8 or uint16.
    labels
        (N,) names of the markers.
    positions_px
        (N, 2) where they are said to be.
    markers_as_given
        Take the positions even if they meet no marks.

    Raises
    ------
    CheckFailed
        Marks are drawn, and fewer than half of the positions have one near them.
    """
    places = np.asarray(positions_px, float)
    n = len(places)
    matched, marks, drawn = np.zeros(0, np.intp), np.zeros((0, 2)), 0
    spots = np.zeros((0, 2))
    for kind in drawn_marks(rgb):
        kind_matched, kind_marks = nearest_pairs(places, kind.places_px)
        if len(kind_matched) > len(matched):
            matched, marks, spots = kind_matched, kind_marks, kind.spots_px
        # At least half as many as there are markers; a letter that recurs is no marker.
        if kind.are_stamped and 2 * len(kind.places_px) >= n:
            drawn = max(drawn, len(kind.places_px))
        if len(matched) == n:
            break  # Every position has its mark, so no other kind needs to be looked for.

    if 2 * len(matched) < n:
        text = (
            f"{len(matched)} of the {n} given positions have a mark near them, but {drawn} marks "
            "of one kind are drawn"
        )
        if drawn and not markers_as_given:
            raise CheckFailed(
                f"{text}. Use this slice's own markers and check u_px (to the right) and v_px "
                "(down from the top), or give --markers-as-given",
                code="markers-meet-no-marks",
                numbers={"near": len(matched), "markers": n, "drawn": drawn},
            )
        finding = note(
            "no-marks-drawn", "register",
            "No marks are drawn at the given positions, so these were not checked. Nothing is to "
            "be done if your markers are not visible.",
        )  # fmt: skip
        if drawn:
            text += ". Use this slice's own markers."
            finding = doubt("markers-meet-no-marks", "register", text)
        return {"near": len(matched), "drawn": drawn}, (finding,)

    # Compression blurs marks of one kind to several sizes. A spot of their colour is a mark too.
    unmatched = np.setdiff1d(np.arange(n), matched)
    more, more_marks = nearest_pairs(places[unmatched], spots)
    matched = np.append(matched, unmatched[more])
    marks = np.vstack([marks, more_marks])
    # Where compression has changed the colour of one, a clear shape at the place tells it.
    for k in np.setdiff1d(unmatched, matched):
        mark = find_mark(rgb, labels[k], tuple(places[k].tolist()), SINGLE_OFFSET_PX)
        if mark is not None and mark.misfit < CLEAR_MISFIT:
            matched, marks = np.append(matched, k), np.vstack([marks, mark.position_px])

    offset = places[matched] - marks
    # A label that touches a mark moves its centre of area, but not that of the shape fitted to it.
    for k in np.flatnonzero(stands_apart(offset)) if len(matched) >= 3 else ():
        place = tuple(places[matched[k]].tolist())
        mark = find_mark(rgb, labels[matched[k]], place, MARK_REACH_PX)
        if mark is not None and mark.moved_px < np.hypot(*offset[k]):
            offset[k] = np.subtract(place, mark.position_px)
    shift = offset.mean(axis=0)
    report = {
        "near": len(matched), "drawn": max(drawn, len(matched)), "rms_px": rms_length(offset),
        "shift_px": tuple(shift.tolist()),
    }  # fmt: skip
    return report, tuple(offset_findings(labels, places, matched, offset))


def offset_findings(
    labels: Sequence[str], places: Array, matched: Indices, offset: Array
) -> Iterator[Finding]:
    """Positions that are further from their marks than a click, alone or all together.

    places: (N, 2) the given positions
    matched: (K,) those that have a mark
    offset: (K, 2) given minus drawn [px]
    """
    for i in np.setdiff1d(np.arange(len(places)), matched):
        text = (
            f"No mark is drawn within {MARK_REACH_PX:.0f} px of marker {labels[i]}; the "
            "others have one. Correct its position, or leave it out."
        )
        place = tuple(places[i].tolist())
        yield doubt("marker-not-drawn", "register", text, place_px=place)
    if len(matched) < 3:
        return

    is_single = stands_apart(offset)
    for i, vector in zip(matched[is_single], offset[is_single], strict=True):
        text = (
            f"Marker {labels[i]} is given {np.hypot(*vector):.1f} px from the mark drawn "
            "near it. Move it there, or give --find-markers."
        )
        place = tuple(places[i].tolist())
        yield doubt("marker-off-mark", "register", text, place_px=place)

    # What the other positions have in common.
    common = offset[~is_single]
    shift = common.mean(axis=0)
    standard_error = common.std(axis=0, ddof=1) / np.sqrt(len(common))
    rms_px = rms_length(common)
    is_shifted = (np.abs(shift) - 3 * standard_error > COMMON_SHIFT_PX).any()
    if is_shifted or rms_px > CLICKED_RMS_PX:
        text = (
            f"The given positions lie {rms_px:.1f} px (rms) from the marks drawn, on average "
            f"({shift[0]:+z.1f}, {shift[1]:+z.1f}) px. Count from 0 at the centre of the top-left "
            "pixel, or take the marks' own with --find-markers."
        )
        yield doubt("markers-off-marks", "register", text)


def stands_apart(offset: Array) -> Flags:
    """(K,) which positions lie to their marks otherwise than the others, by (K, 2) offsets [px]."""
    # The median and the median distance from it are not moved by a single wrong position.
    from_median = row_lengths(offset - np.median(offset, axis=0))
    return from_median > SINGLE_OFFSET_PX + 5 * 1.4826 * np.median(from_median)


def drawn_marks(rgb: NDArray[Any]) -> Iterator[DrawnMarks]:
    """The small marks of a slice (H, W, 3), at least three of a kind: coloured or white."""
    import cv2

    image = (rgb >> 8).astype(np.uint8) if rgb.dtype != np.uint8 else rgb
    red, green, blue = cv2.split(image)
    darkest = cv2.min(cv2.min(red, green), blue)
    chroma = cv2.max(cv2.max(red, green), blue) - darkest
    min_chroma = 255 * MIN_CONTRAST
    rows, columns = np.nonzero(chroma > min_chroma)
    # The angle of each coloured pixel on the circle of hues.
    r, g, b = image[rows, columns].astype(float).T
    hue = np.arctan2(np.sqrt(3) * (g - b), 2 * r - g - b)
    strength = chroma[rows, columns]
    for centre in common_hues(hue, strength):
        is_of_hue = np.abs(np.angle(np.exp(1j * (hue - centre)))) < np.pi / 8
        for level in (min_chroma, PURE_CHROMA):
            mask = np.zeros_like(chroma)
            chosen = is_of_hue & (strength > level)
            mask[rows[chosen], columns[chosen]] = 1
            yield from _marks_in_mask(mask)
    yield from _marks_in_mask((darkest >= WHITE).astype(np.uint8))


def common_hues(hue: Array, strength: Pixels) -> list[float]:
    """The hues [rad] at which many coloured pixels lie: peaks of a histogram around the circle."""
    sectors = 24
    sector = ((hue + np.pi) / (2 * np.pi) * sectors).astype(int) % sectors
    mass = np.bincount(sector, strength, sectors)
    is_peak = (mass > 0) & (mass >= np.roll(mass, 1)) & (mass >= np.roll(mass, -1))
    peaks = [sector == k for k in np.flatnonzero(is_peak)]
    return np.angle([(strength[peak] * np.exp(1j * hue[peak])).sum() for peak in peaks]).tolist()


def _marks_in_mask(mask: Pixels) -> Iterator[DrawnMarks]:
    """Connected spots of a mask, sorted into kinds by their size."""
    import cv2

    count, numbers, statistics, centres = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count > MAX_SPOTS:
        return
    statistics, centres = statistics[1:], centres[1:]
    size = statistics[:, 2:4].astype(float)
    is_mark = (size.min(axis=1) >= MIN_SIDE_PX) & (size.max(axis=1) <= MAX_SIDE_PX)

    # A letter of a word has another spot on the same line, nearer than the spot is high.
    start, top, width, height = statistics[:, :4].T
    foot, end = top + height, start + width
    gap = np.maximum(start[None] - end[:, None], start[:, None] - end[None])
    is_on_line = np.abs(foot[:, None] - foot[None]) <= 1
    is_mark &= ~(is_on_line & (gap >= 0) & (gap < height[:, None])).any(axis=1)

    spots = centres[is_mark]
    while is_mark.sum() >= 3:
        # The spot with the most spots of about its own size around it.
        best = max((alike_spots(size, is_mark, k) for k in np.flatnonzero(is_mark)), key=len)
        if len(best) < 3:
            break
        yield DrawnMarks(centres[best], are_stamped(numbers, statistics[best], best + 1), spots)
        is_mark[best] = False


def alike_spots(size: Array, is_mark: Flags, k: int) -> Indices:
    """The marks of about the size (width, height) of the k-th spot."""
    allowed = np.maximum(2, ALIKE_SIZE * size[k])
    return np.flatnonzero(is_mark & (np.abs(size - size[k]) <= allowed).all(axis=1))


def are_stamped(numbers: NDArray[np.int32], statistics: NDArray[np.int32], spots: Indices) -> bool:
    """Whether most of these spots have one shape, which looks the same upside down.

    numbers: (H, W) the number of each pixel's spot
    statistics: (K, 5) as OpenCV gives them of the K spots
    spots: (K,) their numbers
    """
    import cv2

    pictures = []
    for (start, top, width, height), number in zip(statistics[:, :4], spots, strict=True):
        window = numbers[top : top + height, start : start + width] == number
        picture = cv2.resize(window.astype(np.float32), (16, 16), interpolation=cv2.INTER_AREA)
        pictures.append(cv2.GaussianBlur(picture, (0, 0), 1.0).ravel())
    each = np.array(pictures)
    shape = np.median(np.vstack([each, each[:, ::-1]]), axis=0)
    size = row_lengths(each) * np.linalg.norm(shape)
    return bool((each @ shape >= ALIKE_SHAPE * size).mean() >= 0.8)
