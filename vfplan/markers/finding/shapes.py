"""Blurred crosses and discs, fitted to a mark's coverage.

Where compression has blurred the colour, the brightness across a bar or around a dot decides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from vfplan.markers.finding.marks import MIN_CONTRAST, Array, Mark

Shape = Literal["cross", "dot"]

GOOD_MISFIT = 0.3  # below it no other colour needs to be tried
SHARP_PX = 0.7  # a colour blurred by more was compressed
MAX_ROUGH_MISFIT = 0.7  # by brightness alone, over a background that is itself estimated
_NEIGHBOURS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]]) / 4


def fit_mark(mark: Mark, patch: Array) -> tuple[float, float, Shape, float]:
    """(u, v, shape, misfit); by brightness where compression has blurred the colour."""
    by_colour = fit_shape(mark)
    if by_colour.blur < SHARP_PX:
        return by_colour.found
    by_brightness = fit_shape(brightness_mark(mark, patch, by_colour))
    u, v, shape, misfit = by_colour.found
    better_u, better_v, _, rough = by_brightness.found
    agrees = np.hypot(better_u - u, better_v - v) < 1 and rough < MAX_ROUGH_MISFIT
    if by_brightness.blur < by_colour.blur and agrees:
        return better_u, better_v, shape, misfit
    return by_colour.found


def brightness_mark(mark: Mark, patch: Array, by_colour: Fitted) -> Mark:
    """The same mark by its brightness, over the background that lies on both sides of it.

    JPEG halves the resolution of colour, not of brightness (ITU-R BT.601 weights). Where marker and
    background are equally bright nothing is told, and nothing counts.
    """
    rows, columns = mark.v[:, 0].astype(int), mark.u[0].astype(int)
    grey = patch[np.ix_(rows, columns)] @ [0.299, 0.587, 0.114]
    if by_colour.found[2] == "cross":
        background = _beside_the_bars(mark, grey, by_colour.parameters)
    else:
        background = _filled(mark, grey)
    ink = float(grey[np.unravel_index(np.argmax(mark.alpha * mark.valid), grey.shape)])
    contrast = ink - background
    told = np.abs(contrast) > MIN_CONTRAST / 2
    alpha = np.where(told, (grey - background) / np.where(told, contrast, 1.0), 0.0)
    weight = np.abs(contrast) / (np.abs(contrast).max() or 1.0)
    return replace(mark, alpha=alpha, valid=mark.valid & told, weight=weight)


def _filled(mark: Mark, grey: Array) -> Array:
    """The background under a dot: the smoothest filling (Laplace's equation)."""
    from scipy import ndimage

    covered = ndimage.binary_dilation((mark.alpha > 0.15) & mark.valid, iterations=2)
    background = np.where(covered, np.median(grey[~covered]) if (~covered).any() else 0.0, grey)
    for _ in range(300):
        smooth = ndimage.convolve(background, _NEIGHBOURS, mode="nearest")
        background = np.where(covered, smooth, grey)
    return background


def _beside_the_bars(mark: Mark, grey: Array, cross: Array) -> Array:
    """The background under a cross: across each bar, from what lies on its two sides."""
    from scipy import ndimage

    u0, v0, length, thin, angle = cross[:5]
    c, s = np.cos(angle), np.sin(angle)
    x = c * (mark.u - u0) + s * (mark.v - v0)
    y = c * (mark.v - v0) - s * (mark.u - u0)
    reach = min(thin, 1.5) + 1.5

    def at(x: Array, y: Array) -> Array:
        rows, columns = v0 + s * x + c * y - mark.v[0, 0], u0 + c * x - s * y - mark.u[0, 0]
        return ndimage.map_coordinates(grey, [rows, columns], order=1, mode="nearest")

    def between(low: Array, high: Array, place: Array) -> Array:
        part = np.clip((place + reach) / (2 * reach), 0, 1)
        return (1 - part) * low + part * high

    edge = np.full_like(x, reach)
    across = between(at(x, -edge), at(x, edge), y)
    along = between(at(-edge, y), at(edge, y), x)
    level = (np.abs(y) < reach) & (np.abs(x) < length + 1.5)
    upright = (np.abs(x) < reach) & (np.abs(y) < length + 1.5)
    corners = between(
        between(at(-edge, -edge), at(edge, -edge), x),
        between(at(-edge, edge), at(edge, edge), x),
        y,
    )
    return np.select([level & upright, level, upright], [corners, across, along], grey)


class Fitted(NamedTuple):
    """(u, v, shape, misfit) of the shape that fits best, its blur and all its parameters."""

    found: tuple[float, float, Shape, float]
    blur: float
    parameters: Array


def fit_shape(mark: Mark) -> Fitted:
    """The shape that fits the mark best."""
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
        fits.append(Fitted(found, float(solution[-2]), solution))
        if misfit < 0.8 * GOOD_MISFIT:
            break
    return min(fits, key=lambda fit: fit.found[3])


def _solve(mark: Mark, model: Callable[..., Array], start: list[float]) -> tuple[Array, float]:
    from scipy.optimize import least_squares

    def residual(p: Array) -> Array:
        return ((model(mark.u, mark.v, *p) - mark.alpha) * mark.weight)[mark.valid]

    low, high = np.full(len(start), -np.inf), np.full(len(start), np.inf)
    low[2], low[-2:], high[-2:] = 0.3, (0.02, 0.3), (3.0, 1.5)  # size, blur, strength
    if model is _cross:
        low[3], low[5:7], high[5:7] = 0.2, -1.0, 1.0  # half-width, slides
    solution = least_squares(residual, np.clip(start, low, high), bounds=(low, high), max_nfev=30)
    drawn = (mark.alpha * mark.weight)[mark.valid]
    # Relative to the ink, so that an empty margin cannot make a bad fit look good.
    ink = float((drawn**2).sum())
    return solution.x, float(np.sqrt((solution.fun**2).sum() / ink)) if ink > 0 else np.inf


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
