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
from vfplan.findings import Finding, doubt, note

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

STAGE = "register"

# A mark belongs to a position if it is this near [px]: a careless click, not another mark.
NEAR_PX = 8.0

# Sides of a mark [px]: smaller is a speck, larger is a drawing.
SIDE_PX = (3, 48)

# Chroma above which a pixel is coloured ink, of 255. Both levels are tried: the low one holds what
# compression has blurred, the high one separates a mark from a label that touches it.
COLOURED = (38, 100)

# Brightness of white ink, of 255, in every channel.
WHITE = 247

# More small spots of one colour than this are a colour picture and no marks.
MAX_SPOTS = 400

# Marks of one kind differ by at most this share in width and height, or by 2 px.
ALIKE_SIZE = 0.35

# Marks of one kind look alike if their pictures correlate by this much; digits do by less.
ALIKE_SHAPE = 0.9

# A single position this far from its mark [px], beyond what the others scatter, is named.
OFF_MARK_PX = 1.5

# A common shift of the positions up to this [px] is a convention of where pixels begin.
SHIFT_PX = 0.6

# RMS distance [px] of clicked positions from their marks. Wrong readings lie further.
CLICKED_PX = 3.0


@dataclass(frozen=True, eq=False)
class DrawnMarks:
    """Marks of one colour and about one size."""

    # (M, 2) their centres of area [px].
    places_px: Array
    # Whether they all have one shape that looks the same upside down, as crosses, dots and rings.
    are_stamped: bool

    def nearest_to(self, places_px: Array) -> tuple[NDArray[np.intp], Array]:
        """Which of the places (N, 2) have a mark near them, and (K, 2) that mark.

        A place and its mark are each the other's nearest.
        """
        distance = np.linalg.norm(places_px[:, None] - self.places_px[None], axis=2)
        nearest = distance.argmin(axis=1)
        rows = np.arange(len(places_px))
        is_mutual = distance.argmin(axis=0)[nearest] == rows
        met = np.flatnonzero((distance[rows, nearest] <= NEAR_PX) & is_mutual)
        return met, self.places_px[nearest[met]]


@dataclass(frozen=True, eq=False)
class MarkComparison:
    """How the given positions lie to the marks drawn."""

    # How many positions have a mark near them.
    near: int
    # How many marks of one kind are drawn; 0 where the slice shows none that are surely marks.
    drawn: int
    # RMS distance of the positions from their marks, and its mean (given minus drawn) [px].
    rms_px: float | None
    shift_px: tuple[float, float] | None
    findings: tuple[Finding, ...]

    def as_dict(self) -> dict[str, Any]:
        """As `register --json` reports it."""
        report: dict[str, Any] = {"near": self.near, "drawn": self.drawn}
        if self.rms_px is not None:
            report |= {"rms_px": self.rms_px, "shift_px": self.shift_px}
        return report


def compare_with_marks(
    rgb: NDArray[Any],
    labels: Sequence[str],
    positions_px: ArrayLike,
    *,
    markers_as_given: bool = False,
) -> MarkComparison:
    """Compare given marker positions with the marks that a slice shows.

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
    places = np.asarray(positions_px, dtype=float)
    n = len(places)
    met, marks, drawn = np.zeros(0, dtype=np.intp), np.zeros((0, 2)), 0
    for kind in drawn_marks(rgb):
        kind_met, kind_marks = kind.nearest_to(places)
        if len(kind_met) > len(met):
            met, marks = kind_met, kind_marks
        # At least half as many as there are markers; a letter that recurs is no marker.
        if kind.are_stamped and 2 * len(kind.places_px) >= n:
            drawn = max(drawn, len(kind.places_px))
        if len(met) == n:
            break  # every position has its mark, so no other kind needs to be looked for
    if 2 * len(met) < n:
        text = (
            f"{len(met)} of the {n} given positions have a mark near them, but {drawn} marks of "
            "one kind are drawn"
        )
        if drawn and not markers_as_given:
            raise CheckFailed(
                f"{text}. Use this slice's own markers and check u_px (to the right) and v_px "
                "(down from the top), or give --markers-as-given",
                code="markers-meet-no-marks",
                numbers={"near": len(met), "markers": n, "drawn": drawn},
            )
        finding = note("no-marks-drawn", STAGE, "No marks are drawn at the given positions.")
        if drawn:
            finding = doubt("markers-meet-no-marks", STAGE, f"{text}.")
        return MarkComparison(len(met), drawn, None, None, (finding,))
    offset = places[met] - marks
    shift = offset.mean(axis=0)
    return MarkComparison(
        near=len(met),
        drawn=max(drawn, len(met)),
        rms_px=float(np.sqrt((offset**2).sum(axis=1).mean())),
        shift_px=(float(shift[0]), float(shift[1])),
        findings=tuple(_offset_findings(labels, places, met, offset)),
    )


def _offset_findings(
    labels: Sequence[str], places: Array, met: NDArray[np.intp], offset: Array
) -> list[Finding]:
    """Positions that are further from their marks than a click, alone or all together."""
    findings = []
    for i in np.setdiff1d(np.arange(len(places)), met):
        text = (
            f"No mark is drawn within {NEAR_PX:.0f} px of marker {labels[i]}; the others have one."
        )
        findings.append(doubt("marker-not-drawn", STAGE, text, place_px=_place(places[i])))
    if len(met) < 3:
        return findings
    # The median and the median distance from it are not moved by a single wrong position.
    from_median = np.linalg.norm(offset - np.median(offset, axis=0), axis=1)
    is_off = from_median > OFF_MARK_PX + 5 * 1.4826 * np.median(from_median)
    for i, vector in zip(met[is_off], offset[is_off], strict=True):
        text = (
            f"Marker {labels[i]} is given {np.hypot(*vector):.1f} px from the mark drawn near it."
        )
        findings.append(doubt("marker-off-mark", STAGE, text, place_px=_place(places[i])))
    rest = offset[~is_off]
    shift = rest.mean(axis=0)
    standard_error = rest.std(axis=0, ddof=1) / np.sqrt(len(rest))
    rms_px = float(np.sqrt((rest**2).sum(axis=1).mean()))
    if (np.abs(shift) - 3 * standard_error > SHIFT_PX).any() or rms_px > CLICKED_PX:
        text = (
            f"The given positions lie {rms_px:.1f} px (rms) from the marks drawn, on average "
            f"({shift[0]:+.1f}, {shift[1]:+.1f}) px. Count from 0 at the centre of the top-left "
            "pixel, or take the marks' own with --find-markers."
        )
        findings.append(doubt("markers-off-marks", STAGE, text))
    return findings


def _place(position: Array) -> tuple[float, float]:
    return float(position[0]), float(position[1])


def drawn_marks(rgb: NDArray[Any]) -> Iterator[DrawnMarks]:
    """The small marks of a slice (H, W, 3), at least three of a kind: coloured or white."""
    import cv2

    image: Pixels = rgb if rgb.dtype == np.uint8 else (rgb >> 8).astype(np.uint8)
    red, green, blue = cv2.split(image)
    least = cv2.min(cv2.min(red, green), blue)
    chroma = cv2.max(cv2.max(red, green), blue) - least
    rows, columns = np.nonzero(chroma > COLOURED[0])
    hue = _hue(image[rows, columns].astype(float))
    strength = chroma[rows, columns]
    for centre in _common_hues(hue, strength):
        own = np.abs(np.angle(np.exp(1j * (hue - centre)))) < np.pi / 8
        for level in COLOURED:
            mask = np.zeros_like(chroma)
            chosen = own & (strength > level)
            mask[rows[chosen], columns[chosen]] = 1
            yield from _kinds_in_mask(mask)
    yield from _kinds_in_mask((least >= WHITE).astype(np.uint8))


def _hue(pixels: Array) -> Array:
    """(K,) angle of the colour (K, 3) on the circle of hues [rad]."""
    red, green, blue = pixels.T
    return np.arctan2(np.sqrt(3) * (green - blue), 2 * red - green - blue)


def _common_hues(hue: Array, strength: Pixels) -> list[float]:
    """The hues at which many coloured pixels lie: peaks of a histogram around the circle."""
    sectors = 24
    sector = ((hue + np.pi) / (2 * np.pi) * sectors).astype(int) % sectors
    mass = np.bincount(sector, strength, sectors)
    is_peak = (mass > 0) & (mass >= np.roll(mass, 1)) & (mass >= np.roll(mass, -1))
    peaks = []
    for k in np.flatnonzero(is_peak):
        own = sector == k
        peaks.append(float(np.angle((strength[own] * np.exp(1j * hue[own])).sum())))
    return peaks


def _kinds_in_mask(mask: Pixels) -> list[DrawnMarks]:
    """Connected spots of a mask, sorted into kinds by their size."""
    import cv2

    count, numbers, boxes, centres = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count > MAX_SPOTS:
        return []
    boxes, centres = boxes[1:], centres[1:]
    size = boxes[:, 2:4].astype(float)
    remaining = (size.min(axis=1) >= SIDE_PX[0]) & (size.max(axis=1) <= SIDE_PX[1])
    remaining &= ~_is_letter_of_a_word(boxes)
    kinds = []
    while remaining.sum() >= 3:
        # The spot with the most spots of about its own size around it.
        best = np.zeros(0, dtype=np.intp)
        for k in np.flatnonzero(remaining):
            allowed = np.maximum(2, ALIKE_SIZE * size[k])
            alike = np.flatnonzero(remaining & (np.abs(size - size[k]) <= allowed).all(axis=1))
            if len(alike) > len(best):
                best = alike
        if len(best) < 3:
            break
        kinds.append(DrawnMarks(centres[best], _are_stamped(numbers, boxes[best], best + 1)))
        remaining[best] = False
    return kinds


def _is_letter_of_a_word(boxes: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(K,) whether another spot stands on the same line, nearer than the spot is high."""
    left, top, width, height = boxes[:, :4].T
    foot = top + height
    gap = np.maximum(left[None] - (left + width)[:, None], left[:, None] - (left + width)[None])
    is_beside = (np.abs(foot[:, None] - foot[None]) <= 1) & (gap >= 0) & (gap < height[:, None])
    return is_beside.any(axis=1)


def _are_stamped(
    numbers: NDArray[np.int32], boxes: NDArray[np.int32], own: NDArray[np.intp]
) -> bool:
    """Whether most of these spots have one shape, which looks the same upside down."""
    import cv2

    pictures = []
    for (left, top, width, height), number in zip(boxes[:, :4], own, strict=True):
        window = numbers[top : top + height, left : left + width] == number
        picture = cv2.resize(window.astype(np.float32), (16, 16), interpolation=cv2.INTER_AREA)
        pictures.append(cv2.GaussianBlur(picture, (0, 0), 1.0).ravel())
    each = np.array(pictures)
    shape = np.median(np.vstack([each, each[:, ::-1]]), axis=0)
    size = np.linalg.norm(each, axis=1) * np.linalg.norm(shape)
    return bool((each @ shape >= ALIKE_SHAPE * size).mean() >= 0.8)
