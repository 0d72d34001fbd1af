"""The same marks by their brightness, for pictures whose colour was blurred by compression."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vfplan.markers.finding.marks import MIN_CONTRAST, Array, Mark
from vfplan.markers.finding.shapes import Fitted, Shape, fit_shape

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
    weight = np.abs(contrast) / np.abs(contrast).max()
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
