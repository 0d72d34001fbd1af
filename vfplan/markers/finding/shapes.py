"""Blurred crosses and discs, fitted to a mark's coverage."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from vfplan.markers.finding.marks import Array, Mark

Shape = Literal["cross", "dot"]

GOOD_MISFIT = 0.3  # below it no other colour needs to be tried


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
    solution = least_squares(residual, np.clip(start, low, high), bounds=(low, high), max_nfev=60)
    drawn = (mark.alpha * mark.weight)[mark.valid]
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
