"""Drawn crosses and dots -> their centres, to a fraction of a pixel.

Near each given position: un-mix the marker's colour from what lies under it, take the mark, and fit
the coverage that a blurred cross or a blurred disc would have. The fit's centre is the marker's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.errors import MarkerError, SettingError

Array = NDArray[np.float64]
Shape = Literal["cross", "dot"]

SEARCH_PX = 8.0  # how far a marker may be from where it was said to be
REACH_PX = 24  # largest half-size of a marker
MIN_CONTRAST = 0.15  # of full scale: below it nothing was drawn
MAX_MISFIT = 0.45  # RMS: above it, no cross and no dot
GOOD_MISFIT = 0.3  # below it no other colour needs to be tried
SHARP_PX = 0.7  # a colour blurred by more was compressed
_PAD = 4
_NEIGHBOURS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]]) / 4


@dataclass(frozen=True)
class FoundMarker:
    """A marker as drawn in the image.

    Parameters
    ----------
    label
        Its label.
    position_px
        (u, v) of its centre; the centre of the top-left pixel is (0, 0).
    moved_px
        Distance from where it was said to be.
    shape
        "cross" or "dot".
    misfit
        RMS of the drawn coverage (0..1) minus the shape's, over the mark.
    """

    label: str
    position_px: tuple[float, float]
    moved_px: float
    shape: Shape
    misfit: float


@dataclass(frozen=True, eq=False)
class _Mark:
    """One connected mark: its coverage in a window, and which of the window's pixels count."""

    alpha: Array
    valid: NDArray[np.bool_]
    u: Array
    v: Array
    start: tuple[float, float]
    radius: float


def find_markers(
    rgb: NDArray, labels: Sequence[str], positions_px: ArrayLike, *, search_px: float = SEARCH_PX
) -> tuple[FoundMarker, ...]:
    """The drawn marker nearest to each given position.

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
    height, width = rgb.shape[:2]
    if not (-0.5 <= at[0] <= width - 0.5 and -0.5 <= at[1] <= height - 0.5):
        raise MarkerError(
            f"marker {label!r} at ({at[0]:.1f}, {at[1]:.1f}) px lies outside the image, "
            f"{width}x{height} px"
        )
    half = int(np.ceil(search_px)) + REACH_PX
    u0, v0 = max(0, round(at[0]) - half), max(0, round(at[1]) - half)
    patch = rgb[v0 : round(at[1]) + half + 1, u0 : round(at[0]) + half + 1] / full
    local = (at[0] - u0, at[1] - v0)
    best: FoundMarker | None = None
    for coverage in _coverages(patch, local, search_px):
        for mark in _marks(coverage, local, search_px):
            u, v, shape, misfit = _best_fit(mark, patch)
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


def _coverages(patch: Array, at: tuple[float, float], search_px: float) -> list[Array]:
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


def _marks(coverage: Array, at: tuple[float, float], search_px: float) -> list[_Mark]:
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


def _mark(coverage: Array, number: NDArray, k: int, box: tuple[slice, slice]) -> _Mark:
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
    return _Mark(alpha, valid, u, v, centre, radius)


def _best_fit(mark: _Mark, patch: Array) -> tuple[float, float, Shape, float]:
    """(u, v, shape, misfit); by brightness where compression has blurred the colour."""
    by_colour, blur = _fit(mark)
    if blur < SHARP_PX:
        return by_colour
    by_brightness, sharper = _fit(_brightness_mark(mark, patch))
    return by_brightness if sharper < blur and by_brightness[3] < GOOD_MISFIT else by_colour


def _brightness_mark(mark: _Mark, patch: Array) -> _Mark:
    """The same mark by its brightness, over the background that its surroundings suggest.

    JPEG halves the resolution of colour, not of brightness (ITU-R BT.601 weights).
    """
    from scipy import ndimage

    rows, columns = mark.v[:, 0].astype(int), mark.u[0].astype(int)
    grey = patch[np.ix_(rows, columns)] @ [0.299, 0.587, 0.114]
    covered = ndimage.binary_dilation((mark.alpha > 0.15) & mark.valid, iterations=2)
    background = np.where(covered, np.median(grey[~covered]) if (~covered).any() else 0.0, grey)
    for _ in range(300):  # Laplace's equation: the smoothest filling
        smooth = ndimage.convolve(background, _NEIGHBOURS, mode="nearest")
        background = np.where(covered, smooth, grey)
    ink = float(grey[np.unravel_index(np.argmax(mark.alpha * mark.valid), grey.shape)])
    contrast = ink - background
    told = np.abs(contrast) > MIN_CONTRAST / 2
    alpha = np.where(told, (grey - background) / np.where(told, contrast, 1.0), 0.0)
    return replace(mark, alpha=alpha, valid=mark.valid & told)


def _fit(mark: _Mark) -> tuple[tuple[float, float, Shape, float], float]:
    """(u, v, shape, misfit) of the shape that fits best, and the blur it was drawn with."""
    u, v = mark.start
    area = float(np.where(mark.valid, mark.alpha, 0).sum())
    r = mark.radius
    thin = max(0.5, area / (8 * r))
    starts: list[tuple[Callable[..., Array], Shape, list[float]]] = [
        (_cross, "cross", [u, v, r, thin, 0.0, 0.0, 0.0, 0.3, 1.0]),
        (_disc, "dot", [u, v, np.sqrt(max(area, 1.0) / np.pi), 0.3, 1.0]),
        (_cross, "cross", [u, v, r * np.sqrt(2), thin, np.pi / 4, 0.0, 0.0, 0.3, 1.0]),
    ]
    if area > 0.5 * np.pi * r**2:  # most of its circle is covered: try the dot first
        starts[:2] = starts[1::-1]
    fits = []
    for model, shape, start in starts:
        solution, misfit = _solve(mark, model, start)
        found = (float(solution[0]), float(solution[1]), shape, misfit)
        fits.append((misfit, found, float(solution[-2])))
        if misfit < 0.8 * GOOD_MISFIT:
            break
    _, found, blur = min(fits, key=lambda fit: fit[0])
    return found, blur


def _solve(mark: _Mark, model: Callable[..., Array], start: list[float]) -> tuple[Array, float]:
    from scipy.optimize import least_squares

    def residual(p: Array) -> Array:
        return (model(mark.u, mark.v, *p) - mark.alpha)[mark.valid]

    low, high = np.full(len(start), -np.inf), np.full(len(start), np.inf)
    low[2], low[-2:], high[-2:] = 0.3, (0.02, 0.3), (3.0, 1.5)  # size, blur, strength
    if model is _cross:
        low[3], low[5:7], high[5:7] = 0.2, -1.0, 1.0  # half-width, slides
    solution = least_squares(residual, np.clip(start, low, high), bounds=(low, high), max_nfev=60)
    drawn = mark.alpha[mark.valid]
    # Relative to the ink, so that an empty margin cannot make a bad fit look good.
    misfit = float(np.sqrt((solution.fun**2).sum() / (drawn**2).sum()))
    return solution.x, misfit


def _bar(x: Array, half: float, blur: float) -> Array:
    """Mean over each pixel of a bar of half-width `half`, blurred by a normal of sigma `blur`."""
    ramp = _ramp(x + half + 0.5, blur) - _ramp(x + half - 0.5, blur)
    return ramp - _ramp(x - half + 0.5, blur) + _ramp(x - half - 0.5, blur)


def _ramp(x: Array, blur: float) -> Array:
    """Integral of the normal distribution function of sigma `blur`."""
    from scipy.special import ndtr

    z = x / blur
    return x * ndtr(z) + blur * np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)


def _cross(
    u: Array,
    v: Array,
    u0: float,
    v0: float,
    length: float,
    thin: float,
    angle: float,
    slide_x: float,
    slide_y: float,
    blur: float,
    strength: float,
) -> Array:
    """Coverage of two bars of half-length `length` and half-width `thin` that cross at (u0, v0).

    Each bar may slide along itself: drawing programs round a bar's ends to whole pixels, so that
    only its sides tell where it lies.
    """
    c, s = np.cos(angle), np.sin(angle)
    x, y = c * (u - u0) + s * (v - v0), -s * (u - u0) + c * (v - v0)
    across = _bar(x - slide_x, length, blur) * _bar(y, thin, blur)
    along = _bar(x, thin, blur) * _bar(y - slide_y, length, blur)
    return strength * (1 - (1 - across) * (1 - along))


def _disc(
    u: Array, v: Array, u0: float, v0: float, radius: float, blur: float, strength: float
) -> Array:
    """Coverage of a blurred disc."""
    rho = np.hypot(u - u0, v - v0)
    return strength * (_ramp(radius - rho + 0.5, blur) - _ramp(radius - rho - 0.5, blur))
