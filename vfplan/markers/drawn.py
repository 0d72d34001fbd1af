"""Markers drawn as crosses or dots, found near given positions to a fraction of a pixel.

Near each position the marker's colour is un-mixed from what lies under it, and the coverage that a
blurred cross or a blurred disc would have is fitted to it. The centre of the fit is the marker's.
JPEG halves the resolution of colour but not of brightness, so a mark whose colour is blurred is
fitted by its brightness as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.errors import MarkerError, SettingError

Array = NDArray[np.float64]
Shape = Literal["cross", "dot"]

# How far a marker's centre may be from where it is said to be [px].
SEARCH_PX = 8.0

# Largest half size of a mark [px].
MAX_HALF_SIZE_PX = 24

# Chroma, or difference in brightness, below which nothing was drawn; of full scale.
MIN_CONTRAST = 0.15

# RMS of the drawn coverage minus the shape's, over the ink: a cross or a dot has less.
MAX_MISFIT = 0.45

# With less the mark is clear, and no other colour needs to be tried.
CLEAR_MISFIT = 0.3

# Blur [px] above which compression has blurred the colour.
SHARP_PX = 0.7

# RMS misfit of the brightness, over a background that is itself an estimate.
MAX_BRIGHTNESS_MISFIT = 0.7


@dataclass(frozen=True)
class FoundMarker:
    """A marker as drawn in the image."""

    label: str
    # (u, v) of its centre; the centre of the top-left pixel is (0, 0).
    position_px: tuple[float, float]
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
    centre: tuple[float, float]
    radius: float
    # How much each pixel counts.
    weight: Array | float = 1.0


@dataclass(frozen=True, eq=False)
class ShapeFit:
    """The shape that fits a mark best."""

    u: float
    v: float
    shape: Shape
    misfit: float
    blur: float
    parameters: Array


def find_markers(
    rgb: NDArray[Any],
    labels: Sequence[str],
    positions_px: ArrayLike,
    *,
    search_px: float = SEARCH_PX,
) -> tuple[FoundMarker, ...]:
    """Find the drawn marker nearest to each given position.

    Parameters
    ----------
    rgb
        (H, W, 3) uint8 or uint16.
    labels
        (N,) names, for messages and in the result.
    positions_px
        (N, 2) where the markers are said to be (u, v).
    search_px
        How far a marker's centre may be from there.

    Raises
    ------
    MarkerError
        A position outside the image, no cross or dot near it, or two markers found in one place.
    SettingError
        A search radius that is not above 0.
    """
    if not 0 < search_px < float("inf"):
        raise SettingError(
            f"search radius is {search_px} px; a finite number above 0 is wanted",
            code="search-radius-range",
        )
    found: list[FoundMarker] = []
    for label, (u, v) in zip(labels, np.asarray(positions_px, dtype=float), strict=True):
        marker = _find_marker(rgb, label, (float(u), float(v)), search_px)
        for other in found:
            if np.hypot(*np.subtract(marker.position_px, other.position_px)) < 1:
                raise MarkerError(
                    f"{other.label!r} and {label!r} were both found at "
                    f"({marker.position_px[0]:.1f}, {marker.position_px[1]:.1f}) px; each needs a "
                    "mark of its own",
                    code="one-mark-two-markers",
                    numbers={"labels": [other.label, label]},
                )
        found.append(marker)
    return tuple(found)


def _find_marker(
    rgb: NDArray[Any], label: str, place: tuple[float, float], search_px: float
) -> FoundMarker:
    height, width = rgb.shape[:2]
    u, v = place
    if not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):
        raise MarkerError(
            f"marker {label!r} at ({u:.1f}, {v:.1f}) px lies outside the image of {width}x{height} "
            "px",
            code="marker-outside-slice",
            numbers={"label": label, "u_px": u, "v_px": v},
        )
    half = int(np.ceil(search_px)) + MAX_HALF_SIZE_PX
    left, top = max(0, round(u) - half), max(0, round(v) - half)
    window = rgb[top : round(v) + half + 1, left : round(u) + half + 1]
    picture = window / float(np.iinfo(rgb.dtype).max)
    local = (u - left, v - top)

    best: FoundMarker | None = None
    for coverage in coverages_near(picture, local, search_px):
        for mark in marks_near(coverage, local, search_px):
            fit = fit_mark(mark, picture)
            moved = float(np.hypot(fit.u - local[0], fit.v - local[1]))
            if fit.misfit > MAX_MISFIT or moved > search_px:
                continue
            marker = FoundMarker(label, (fit.u + left, fit.v + top), moved, fit.shape, fit.misfit)
            if best is None or _is_better(marker, best):
                best = marker
        if best is not None and best.misfit < CLEAR_MISFIT:
            break
    if best is None:
        raise MarkerError(
            f"no cross or dot within {search_px:g} px of marker {label!r} at ({u:.1f}, {v:.1f}) px",
            code="no-mark-near",
            numbers={"label": label, "u_px": u, "v_px": v},
        )
    return best


def _is_better(marker: FoundMarker, other: FoundMarker) -> bool:
    """The better fit of one mark; of two marks the nearer."""
    if np.hypot(*np.subtract(marker.position_px, other.position_px)) < 2:
        return marker.misfit < other.misfit
    return marker.moved_px < other.moved_px


def coverages_near(picture: Array, place: tuple[float, float], search_px: float) -> list[Array]:
    """Coverage maps (H, W), 0 to 1, one for each colour drawn near a place.

    A grey background has no chroma, so the coverage of a coloured marker is the chroma along its
    own, whatever the grey under it. A grey marker shows by its brightness against the median.
    """
    v, u = np.indices(picture.shape[:2])
    is_near = np.hypot(u - place[0], v - place[1]) <= search_px
    chroma = picture - picture.mean(axis=2, keepdims=True)
    strength = np.linalg.norm(chroma, axis=2)
    maps = []
    remaining = is_near.copy()
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
        peak = (sign * deviation[is_near]).max()
        if peak > MIN_CONTRAST:
            maps.append(sign * deviation / peak)
    return [np.clip(coverage, 0, 1.2) for coverage in maps]


def marks_near(coverage: Array, place: tuple[float, float], search_px: float) -> list[Mark]:
    """The connected marks that reach within `search_px` of a place, none cut by the window."""
    from scipy import ndimage

    numbers, _ = ndimage.label(coverage > 0.35, structure=np.ones((3, 3)))
    marks = []
    for number, box in enumerate(ndimage.find_objects(numbers), start=1):
        own = numbers[box] == number
        v, u = np.nonzero(own)
        distance = np.hypot(u + box[1].start - place[0], v + box[0].start - place[1]).min()
        is_cut = any(
            side.start == 0 or side.stop == size
            for side, size in zip(box, coverage.shape, strict=True)
        )
        is_large = max(own.shape) > 2 * MAX_HALF_SIZE_PX
        if distance <= search_px and not is_cut and not is_large and len(u) >= 4:
            marks.append(_mark(coverage, numbers, number, box))
    return marks


def _mark(
    coverage: Array, numbers: NDArray[np.int32], number: int, box: tuple[slice, slice]
) -> Mark:
    from scipy import ndimage

    pad = 4  # pixels around the mark, where its blurred edge ends
    window = tuple(
        slice(max(0, side.start - pad), min(size, side.stop + pad))
        for side, size in zip(box, coverage.shape, strict=True)
    )
    own, alpha = numbers[window] == number, coverage[window]
    is_other = ~own & (numbers[window] > 0)
    v, u = np.indices(alpha.shape).astype(float)
    u, v = u + window[1].start, v + window[0].start
    weight = np.where(own, alpha, 0.0)
    centre_u = float((u * weight).sum() / weight.sum())
    centre_v = float((v * weight).sum() / weight.sum())
    return Mark(
        coverage=alpha,
        valid=~ndimage.binary_dilation(is_other, iterations=2),
        u=u,
        v=v,
        centre=(centre_u, centre_v),
        radius=max(side.stop - side.start for side in box) / 2,
    )


def fit_mark(mark: Mark, picture: Array) -> ShapeFit:
    """The cross or dot of a mark; by its brightness where compression has blurred the colour."""
    by_colour = fit_shape(mark)
    if by_colour.blur < SHARP_PX:
        return by_colour
    by_brightness = fit_shape(_by_brightness(mark, picture, by_colour))
    distance = np.hypot(by_brightness.u - by_colour.u, by_brightness.v - by_colour.v)
    is_sharper = by_brightness.blur < by_colour.blur
    if is_sharper and distance < 1 and by_brightness.misfit < MAX_BRIGHTNESS_MISFIT:
        return replace(by_colour, u=by_brightness.u, v=by_brightness.v)
    return by_colour


def _by_brightness(mark: Mark, picture: Array, by_colour: ShapeFit) -> Mark:
    """The same mark by its brightness, over a background estimated from what lies beside it.

    Where the mark is about as bright as its background nothing is known, and nothing counts.
    """
    rows, columns = mark.v[:, 0].astype(int), mark.u[0].astype(int)
    # Brightness as JPEG stores it, by ITU-R BT.601.
    grey = picture[np.ix_(rows, columns)] @ [0.299, 0.587, 0.114]
    if by_colour.shape == "cross":
        background = _under_cross(mark, grey, by_colour.parameters)
    else:
        background = _under_dot(mark, grey)
    darkest_ink = np.unravel_index(np.argmax(mark.coverage * mark.valid), grey.shape)
    contrast = float(grey[darkest_ink]) - background
    is_known = np.abs(contrast) > MIN_CONTRAST / 2
    coverage = np.zeros_like(grey)
    coverage[is_known] = (grey - background)[is_known] / contrast[is_known]
    largest = float(np.abs(contrast).max())
    weight = np.abs(contrast) / (largest if largest > 0 else 1.0)
    return replace(mark, coverage=coverage, valid=mark.valid & is_known, weight=weight)


def _under_dot(mark: Mark, grey: Array) -> Array:
    """The background under a dot: the smoothest filling, by Laplace's equation."""
    from scipy import ndimage

    covered = ndimage.binary_dilation((mark.coverage > 0.15) & mark.valid, iterations=2)
    start = float(np.median(grey[~covered])) if (~covered).any() else 0.0
    background = np.where(covered, start, grey)
    neighbours = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]]) / 4
    for _ in range(300):
        smooth = ndimage.convolve(background, neighbours, mode="nearest")
        background = np.where(covered, smooth, grey)
    return background


def _under_cross(mark: Mark, grey: Array, parameters: Array) -> Array:
    """The background under a cross: across each bar, from what lies on its two sides."""
    from scipy import ndimage

    u0, v0, length, half_width, angle = parameters[:5]
    cosine, sine = np.cos(angle), np.sin(angle)
    # Along and across the first bar.
    x = cosine * (mark.u - u0) + sine * (mark.v - v0)
    y = cosine * (mark.v - v0) - sine * (mark.u - u0)
    reach = min(half_width, 1.5) + 1.5

    def grey_at(x: Array, y: Array) -> Array:
        rows = v0 + sine * x + cosine * y - mark.v[0, 0]
        columns = u0 + cosine * x - sine * y - mark.u[0, 0]
        return ndimage.map_coordinates(grey, [rows, columns], order=1, mode="nearest")

    def between(low: Array, high: Array, place: Array) -> Array:
        part = np.clip((place + reach) / (2 * reach), 0, 1)
        return (1 - part) * low + part * high

    edge = np.full_like(x, reach)
    across_first = between(grey_at(x, -edge), grey_at(x, edge), y)
    across_second = between(grey_at(-edge, y), grey_at(edge, y), x)
    above = between(grey_at(-edge, -edge), grey_at(edge, -edge), x)
    below = between(grey_at(-edge, edge), grey_at(edge, edge), x)
    is_first = (np.abs(y) < reach) & (np.abs(x) < length + 1.5)
    is_second = (np.abs(x) < reach) & (np.abs(y) < length + 1.5)
    background = np.where(is_second, across_second, grey)
    background = np.where(is_first, across_first, background)
    return np.where(is_first & is_second, between(above, below, y), background)


def fit_shape(mark: Mark) -> ShapeFit:
    """The cross (upright or turned by 45 degrees) or the disc that fits a mark best."""
    u, v = mark.centre
    r = mark.radius
    area = float(np.where(mark.valid, mark.coverage, 0).sum())
    thin = max(0.5, area / (8 * r))
    disc_radius = float(np.sqrt(max(area, 1.0) / np.pi))
    starts: list[tuple[Shape, list[float]]] = [
        ("cross", [u, v, r, thin, 0.0, 0.0, 0.0, 0.3, 1.0]),
        ("dot", [u, v, disc_radius, 0.3, 1.0]),
        ("cross", [u, v, r * np.sqrt(2), thin, np.pi / 4, 0.0, 0.0, 0.3, 1.0]),
    ]
    if area > 0.5 * np.pi * r**2:  # most of its circle is covered: it is probably a dot
        starts = [starts[1], starts[0], starts[2]]
    best: ShapeFit | None = None
    for shape, start in starts:
        parameters, misfit = _least_squares(mark, _cross if shape == "cross" else _disc, start)
        if best is None or misfit < best.misfit:
            u_fit, v_fit, blur = (float(parameters[k]) for k in (0, 1, -2))
            best = ShapeFit(u_fit, v_fit, shape, misfit, blur, parameters)
        if best.misfit < CLEAR_MISFIT / 2:
            break
    assert best is not None
    return best


def _least_squares(
    mark: Mark, model: Callable[..., Array], start: list[float]
) -> tuple[Array, float]:
    """The model's parameters, and the RMS misfit relative to the ink.

    Relative to the ink, because an empty margin would make a bad fit look good.
    """
    from scipy.optimize import least_squares

    def misfit(parameters: Array) -> Array:
        return ((model(mark.u, mark.v, *parameters) - mark.coverage) * mark.weight)[mark.valid]

    low, high = np.full(len(start), -np.inf), np.full(len(start), np.inf)
    low[2] = 0.3  # size [px]
    low[-2:], high[-2:] = (0.02, 0.3), (3.0, 1.5)  # blur [px], strength
    if model is _cross:
        low[3] = 0.2  # half width [px]
        low[5:7], high[5:7] = -1.0, 1.0  # slides [px]
    result = least_squares(misfit, np.clip(start, low, high), bounds=(low, high), max_nfev=30)
    ink = float((((mark.coverage * mark.weight)[mark.valid]) ** 2).sum())
    if ink == 0:
        return result.x, np.inf
    return result.x, float(np.sqrt((result.fun**2).sum() / ink))


def _cross(
    u: Array,
    v: Array,
    u0: float,
    v0: float,
    length: float,
    half_width: float,
    angle: float,
    slide_x: float,
    slide_y: float,
    blur: float,
    strength: float,
) -> Array:
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
    left = _ramp(x + half + 0.5, blur) - _ramp(x + half - 0.5, blur)
    right = _ramp(x - half + 0.5, blur) - _ramp(x - half - 0.5, blur)
    return left - right


def _ramp(x: Array, blur: float) -> Array:
    """Integral of the normal distribution function of sigma `blur`."""
    from scipy.special import ndtr

    z = x / blur
    return x * ndtr(z) + blur * np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
