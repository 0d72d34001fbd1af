"""Markers drawn as crosses or dots, found near given positions to a fraction of a pixel.

Near each position the marker's colour is un-mixed from what lies under it, and the coverage that a
blurred cross or a blurred disc would have is fitted to it. The centre of the fit is the marker's.
JPEG halves the resolution of colour but not of brightness, so a mark whose colour is blurred is
fitted by its brightness as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.display import coordinates
from vfplan.errors import MarkerError
from vfplan.geometry.lines import Array, row_lengths

Shape = Literal["cross", "dot"]
# (u, v) [px].
Place = tuple[float, float]

# Largest distance [px] between a position and its mark. So far off is a careless click; further off
# is another mark.
MARK_REACH_PX = 8.0

# Longer side [px] of the largest mark. What is larger is a drawing.
MAX_SIDE_PX = 48

# Smallest chroma, or difference in brightness, of ink, as a share of full scale. Compression blurs
# thin ink to about as little.
MIN_CONTRAST = 0.15

# Width [px] of the border around a mark within which its blurred edge ends.
EDGE_PX = 4

# Largest RMS of the drawn coverage minus the shape's, over the ink. A cross or a dot has less.
MAX_MISFIT = 0.45

# A mark with less is clear, and no other colour or shape needs to be tried.
CLEAR_MISFIT = 0.3

# Largest RMS misfit of the brightness. It is larger, for the background is itself an estimate.
MAX_BRIGHTNESS_MISFIT = 0.7

# Largest blur [px] of a mark whose colour compression has not blurred.
SHARP_PX = 0.7

# Blur [px] of the brightness of a mark whose colour compression has blurred.
BRIGHTNESS_BLUR_PX = 0.5

# Coverage from which a pixel does not show the background. With both, crosses and dots in JPEGs of
# quality 80 are found to 0.08 px rms.
MIN_COVERAGE = 0.05


@dataclass(frozen=True)
class DrawnMarker:
    """A marker as drawn in the image."""

    label: str
    # (u, v) of its centre; the centre of the top-left pixel is (0, 0).
    position_px: Place
    # Distance from where it was said to be [px].
    moved_px: float
    shape: Shape
    # RMS of the drawn coverage (0 to 1) minus the shape's, over the ink.
    misfit: float


@dataclass(frozen=True, eq=False)
class Mark:
    """One connected mark in a window of the picture."""

    # (H, W) coverage, 0 to 1, and which of its pixels belong to no other mark.
    coverage: Array
    valid: NDArray[np.bool_]
    # (H, W) the pixels' coordinates.
    u: Array
    v: Array
    # Its centre of area and half of its longer side [px].
    centre: Place
    radius: float
    # How much each pixel counts.
    weight: Array | float = 1.0


@dataclass(frozen=True, eq=False)
class ShapeFit:
    """The shape that fits a mark best."""

    shape: Shape
    misfit: float
    # As `_cross` or `_disc` takes them: u and v first, the blur and the strength last.
    parameters: Array


def find_markers(
    rgb: NDArray[Any], labels: Sequence[str], positions_px: ArrayLike
) -> tuple[DrawnMarker, ...]:
    """Find the drawn marker nearest to each given position.

    Parameters
    ----------
    rgb
        (H, W, 3) uint8 or uint16.
    labels
        (N,) names, for messages and in the result.
    positions_px
        (N, 2) where the markers are said to be (u, v).

    Raises
    ------
    MarkerError
        No cross or dot near a position, or two markers found in one place.
    """
    markers = []
    for label, (u, v) in zip(labels, np.asarray(positions_px, float), strict=True):
        marker = find_mark(rgb, label, (float(u), float(v)), MARK_REACH_PX)
        if marker is None:
            raise MarkerError(
                f"no cross or dot within {MARK_REACH_PX:g} px of marker {label!r} at ({u:z.1f}, "
                f"{v:z.1f}) px. Correct its position, or leave --find-markers out",
                code="no-mark-near", numbers={"label": label, "u_px": float(u), "v_px": float(v)},
            )  # fmt: skip
        for other in markers:
            if np.hypot(*np.subtract(marker.position_px, other.position_px)) < 1:
                raise MarkerError(
                    f"{other.label!r} and {label!r} were both found at "
                    f"({coordinates(marker.position_px, 1)}) px. Give each the "
                    "position of a mark of its own",
                    code="one-mark-two-markers", numbers={"labels": [other.label, label]},
                )  # fmt: skip
        markers.append(marker)
    return tuple(markers)


def find_mark(rgb: NDArray[Any], label: str, place: Place, search_px: float) -> DrawnMarker | None:
    """The cross or dot nearest to a place (u, v) on the slice, or `None`."""
    u, v = place
    if not (-0.5 <= u <= rgb.shape[1] - 0.5 and -0.5 <= v <= rgb.shape[0] - 0.5):
        return None
    half = int(np.ceil(search_px)) + MAX_SIDE_PX // 2
    column, row = max(0, round(u) - half), max(0, round(v) - half)
    window = rgb[row : round(v) + half + 1, column : round(u) + half + 1]
    picture = window / float(np.iinfo(rgb.dtype).max)
    local = (u - column, v - row)

    best = None
    for coverage in coverages_around(picture, local, search_px):
        for mark in marks_around(coverage, local, search_px):
            fit = fit_mark(mark, picture)
            moved = float(np.linalg.norm(fit.parameters[:2] - local))
            if fit.misfit > MAX_MISFIT or moved > search_px:
                continue
            position = tuple(np.add(fit.parameters[:2], (column, row)).tolist())
            drawn = DrawnMarker(label, position, moved, fit.shape, fit.misfit)
            # The better fit of one mark; of two marks the nearer.
            if best is None:
                best = drawn
            elif np.hypot(*np.subtract(position, best.position_px)) < 2:
                best = min(best, drawn, key=lambda marker: marker.misfit)
            else:
                best = min(best, drawn, key=lambda marker: marker.moved_px)
        if best is not None and best.misfit < CLEAR_MISFIT:
            break
    return best


def coverages_around(picture: Array, place: Place, search_px: float) -> list[Array]:
    """Coverage maps (H, W), 0 to 1, one for each colour drawn near a place.

    A grey background has no chroma, so the coverage of a coloured marker is the chroma along its
    own, whatever the grey under it. A grey marker shows by its brightness against the median.
    """
    v, u = np.indices(picture.shape[:2])
    is_close = np.hypot(u - place[0], v - place[1]) <= search_px
    chroma = picture - picture.mean(axis=2, keepdims=True)
    strength = np.linalg.norm(chroma, axis=2)
    maps = []
    remaining = is_close.copy()
    for _ in range(3):
        strongest = np.unravel_index(np.argmax(np.where(remaining, strength, 0)), strength.shape)
        if strength[strongest] < MIN_CONTRAST:
            break
        colour = chroma[strongest]
        along = chroma @ colour / (colour @ colour)
        maps.append(along)
        is_of_colour = along * np.linalg.norm(colour) > 0.7 * strength
        remaining &= ~(is_of_colour & (strength > 0.3 * strength[strongest]))
    grey = picture.mean(axis=2)
    deviation = grey - np.median(grey)
    for sign in (1, -1):
        peak = (sign * deviation[is_close]).max()
        if peak > MIN_CONTRAST:
            maps.append(sign * deviation / peak)
    return [np.clip(coverage, 0, 1.2) for coverage in maps]


def marks_around(coverage: Array, place: Place, search_px: float) -> Iterator[Mark]:
    """The connected marks that reach within `search_px` of a place, none cut by the window."""
    from scipy.ndimage import binary_dilation
    from skimage.measure import label, regionprops

    numbers = label(coverage > 0.35)
    for spot in regionprops(numbers, coverage):
        top, left, bottom, right = spot.bbox
        distance = row_lengths(spot.coords[:, ::-1] - place).min()
        is_cut = min(top, left) == 0 or bottom == coverage.shape[0] or right == coverage.shape[1]
        side = max(bottom - top, right - left)
        if distance > search_px or is_cut or side > MAX_SIDE_PX or spot.area < 4:
            continue

        # A window with the mark's blurred edge.
        top, left = max(0, top - EDGE_PX), max(0, left - EDGE_PX)
        window = np.s_[top : bottom + EDGE_PX, left : right + EDGE_PX]
        v, u = np.indices(numbers[window].shape).astype(float)
        is_other = (numbers[window] != spot.label) & (numbers[window] > 0)
        valid = ~binary_dilation(is_other, iterations=2)
        centre_v, centre_u = spot.centroid_weighted
        centre = (float(centre_u), float(centre_v))
        yield Mark(coverage[window], valid, u + left, v + top, centre, side / 2)


def fit_mark(mark: Mark, picture: Array) -> ShapeFit:
    """The cross or dot of a mark; by its brightness where compression has blurred the colour."""
    by_colour = fit_shape(mark)
    if by_colour.parameters[-2] < SHARP_PX:
        return by_colour
    by_brightness = fit_shape(brightness_mark(mark, picture, by_colour))
    change = by_brightness.parameters[[0, 1, -2]] - by_colour.parameters[[0, 1, -2]]
    is_sharper = change[2] < 0 and np.hypot(*change[:2]) < 1
    if is_sharper and by_brightness.misfit < MAX_BRIGHTNESS_MISFIT:
        return replace(by_colour, parameters=by_brightness.parameters)
    return by_colour


def brightness_mark(mark: Mark, picture: Array, by_colour: ShapeFit) -> Mark:
    """The same mark by its brightness, over a background estimated from what lies beside it.

    Where the mark is about as bright as its background nothing is known, and nothing counts.
    """
    from skimage.restoration import inpaint_biharmonic

    rows, columns = mark.v[:, 0].astype(int), mark.u[0].astype(int)
    # Brightness as JPEG stores it, by ITU-R BT.601.
    grey = picture[np.ix_(rows, columns)] @ [0.299, 0.587, 0.114]
    # The background under the shape is the smoothest filling.
    parameters = by_colour.parameters.copy()
    parameters[-2:] = BRIGHTNESS_BLUR_PX, 1.0
    if by_colour.shape == "cross":
        # A dot whose colour is blurred may look like a cross of wide bars.
        parameters[3] = min(parameters[3], 1.5)
    covered = MODELS[by_colour.shape](mark.u, mark.v, *parameters) > MIN_COVERAGE
    background = grey if covered.all() else inpaint_biharmonic(grey, covered)
    darkest_ink = np.unravel_index(np.argmax(mark.coverage * mark.valid), grey.shape)
    contrast = float(grey[darkest_ink]) - background
    is_known = np.abs(contrast) > MIN_CONTRAST / 2
    coverage = np.zeros_like(grey)
    coverage[is_known] = (grey - background)[is_known] / contrast[is_known]
    weight = np.abs(contrast) / max(float(np.abs(contrast).max()), np.finfo(float).tiny)
    return replace(mark, coverage=coverage, valid=mark.valid & is_known, weight=weight)


def fit_shape(mark: Mark) -> ShapeFit:
    """The cross (upright or turned by 45 degrees) or the disc that fits a mark best."""
    u, v = mark.centre
    r = mark.radius
    area = float(np.where(mark.valid, mark.coverage, 0).sum())
    thin = max(0.5, area / (8 * r))
    disc_radius = float(np.sqrt(max(area, 1.0) / np.pi))
    starts = [
        ("cross", [u, v, r, thin, 0.0, 0.0, 0.0, 0.3, 1.0]),
        ("dot", [u, v, disc_radius, 0.3, 1.0]),
        ("cross", [u, v, r * np.sqrt(2), thin, np.pi / 4, 0.0, 0.0, 0.3, 1.0]),
    ]
    # A mark that covers more than half of its circle is probably a dot.
    if area > 0.5 * np.pi * r**2:
        starts[:2] = starts[1::-1]
    best = ShapeFit(starts[0][0], np.inf, np.array(starts[0][1]))
    for shape, start in starts:
        parameters, misfit = best_fit(mark, MODELS[shape], start)
        if misfit < best.misfit:
            best = ShapeFit(shape, misfit, parameters)
        if best.misfit < CLEAR_MISFIT / 2:
            break
    return best


def best_fit(mark: Mark, model: Callable[..., Array], start: list[float]) -> tuple[Array, float]:
    """The model's parameters, and the RMS misfit relative to the ink.

    Relative to the ink, because an empty margin would make a bad fit look good.
    """
    from scipy.optimize import least_squares

    def misfit(parameters: Array) -> Array:
        return ((model(mark.u, mark.v, *parameters) - mark.coverage) * mark.weight)[mark.valid]

    low, high = np.full(len(start), -np.inf), np.full(len(start), np.inf)
    # The size [px], the blur [px] and the strength.
    low[2] = 0.3
    low[-2], high[-2] = 0.02, 3.0
    low[-1], high[-1] = 0.3, 1.5
    if model is _cross:
        # The half width and the slides [px].
        low[3] = 0.2
        low[5:7], high[5:7] = -1.0, 1.0
    result = least_squares(misfit, np.clip(start, low, high), bounds=(low, high), max_nfev=30)
    ink = float((((mark.coverage * mark.weight)[mark.valid]) ** 2).sum())
    if ink == 0:
        return result.x, np.inf
    return result.x, float(np.sqrt((result.fun**2).sum() / ink))


def _cross(
    u: Array, v: Array, u0: float, v0: float, length: float, half_width: float, angle: float,
    slide_x: float, slide_y: float, blur: float, strength: float,
) -> Array:  # fmt: skip
    """Coverage of two bars of half length `length` that cross at (u0, v0).

    Each bar may slide along itself: drawing programs round the ends of a bar to whole pixels, so
    only its sides tell where it lies.
    """
    cosine, sine = np.cos(angle), np.sin(angle)
    x = cosine * (u - u0) + sine * (v - v0)
    y = -sine * (u - u0) + cosine * (v - v0)
    first = _bar(x - slide_x, length, blur) * _bar(y, half_width, blur)
    second = _bar(x, half_width, blur) * _bar(y - slide_y, length, blur)
    return strength * (1 - (1 - first) * (1 - second))


def _disc(
    u: Array, v: Array, u0: float, v0: float, radius: float, blur: float, strength: float
) -> Array:
    """Coverage of a blurred disc."""
    distance = np.hypot(u - u0, v - v0)
    return strength * (_ramp(radius - distance + 0.5, blur) - _ramp(radius - distance - 0.5, blur))


def _bar(x: Array, half: float, blur: float) -> Array:
    """Mean over each pixel of a bar of half width `half`, blurred by a normal of sigma `blur`."""
    from_start = _ramp(x + half + 0.5, blur) - _ramp(x + half - 0.5, blur)
    from_end = _ramp(x - half + 0.5, blur) - _ramp(x - half - 0.5, blur)
    return from_start - from_end


def _ramp(x: Array, blur: float) -> Array:
    """Integral of the normal distribution function of sigma `blur`."""
    from scipy.special import ndtr

    z = x / blur
    return x * ndtr(z) + blur * np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)


MODELS = {"cross": _cross, "dot": _disc}
