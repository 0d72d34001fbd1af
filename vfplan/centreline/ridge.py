"""A pixel path -> the line's centre to a few hundredths of a pixel, with its uncertainty.

At each point of the path the pen's coverage is read along the local normal, x ↦ α(x). The mean of
all these profiles, made symmetric, is the pen's own profile P(x). A line that lies δ off the path
shows a P(x − δ) + b, so that δ = −(coefficient of P′)/(coefficient of P) in a least-squares fit of
P, P′ and 1: tint and background fall into b. A smoothing spline through the measured points follows
the hand and not the noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.extraction.pen import Pen, sample_chroma

MARGIN_PX = 2.0  # profiles reach this far beyond the line's edge
STEP_PX = 0.5
FOREIGN = 0.35  # of the pen's strength: more than this of another colour hides the line
KNOTS_PX = (6.0, 8.0, 12.0)


@dataclass(frozen=True, eq=False)
class Centreline:
    """A measured line.

    Parameters
    ----------
    points
        (M, 2) float64 (u, v) [px], evenly spaced along the curve.
    sigma
        (M,) standard deviation across the line [px].
    bridged
        (M,) bool, where nothing could be measured and the spline carries the line across.
    closed
        Whether the last point joins the first.
    length
        Arc length, closing step included [px].
    """

    points: NDArray[np.float64]
    sigma: NDArray[np.float64]
    bridged: NDArray[np.bool_]
    closed: bool
    length: float


def trace(
    rgb: NDArray, path: NDArray, closed: bool, bridged: NDArray, pen: Pen, width: float
) -> Centreline:
    """Measure the line along a pixel path.

    Parameters
    ----------
    rgb
        (H, W, 3) image.
    path, closed, bridged
        (M, 2) pixel path, whether it is a ring, and (M,) which points lie on a gap.
    pen, width
        The pen and the line's width [px].
    """
    from scipy.ndimage import gaussian_filter1d

    smooth = gaussian_filter1d(path, 2.0, axis=0, mode="wrap" if closed else "nearest")
    gap = _gap_function(smooth, bridged)
    if not closed:
        smooth = _extended(smooth, width / 2 + 4)
    base, pitch = _evenly(smooth, closed)
    for pass_ in range(2):
        measured = _measure(rgb, base, closed, pen, width, first=pass_ == 0)
        valid = measured.valid & ~gap(base)
        if not closed:
            start, stop = _line_ends(measured.mass, valid, width)
            base, measured, valid = _cut(base, measured, valid, start, stop)
        raw = base + measured.offset[:, None] * _normals(base, closed)
        knots = KNOTS_PX[0] if pass_ == 0 else _knot_spacing(raw, valid, closed, pitch)
        curve = _spline(raw, valid, closed, knots, pitch)
        fitted = curve(np.arange(len(raw)) * pitch)
        if pass_ == 0:
            base = fitted if closed else _extended(fitted, width / 2 + 4)
            base, pitch = _evenly(base, closed)
    return _result(raw, fitted, valid, closed, knots)


@dataclass(frozen=True, eq=False)
class _Measured:
    offset: NDArray  # (M,) of the line from the path along the normal [px]
    mass: NDArray  # (M,) coverage summed across the line, 1 in its middle run
    valid: NDArray  # (M,) the line was seen and nothing foreign hid it


def _measure(
    rgb: NDArray, base: NDArray, closed: bool, pen: Pen, width: float, first: bool
) -> _Measured:
    half = np.ceil((width / 2 + MARGIN_PX + (1 if first else 0)) / STEP_PX)
    x = np.arange(-half, half + 1) * STEP_PX
    normal = _normals(base, closed)
    u = base[:, :1] + normal[:, :1] * x
    v = base[:, 1:] + normal[:, 1:] * x
    along, across = sample_chroma(rgb, u, v, pen)
    alpha = along / pen.strength
    foreign = (np.abs(across) > FOREIGN * pen.strength) | (alpha < -FOREIGN)
    mass = np.clip(alpha, 0, None).sum(1)
    mass = mass / np.median(mass)
    core = np.abs(x) <= width / 2 + 0.5
    valid = (mass > 0.4) & ~foreign[:, core].any(1)
    offset = _centroid(x, alpha, foreign) if first else _matched(x, alpha, foreign, valid)
    valid &= np.abs(offset) < width / 2 + 1
    return _Measured(np.where(valid, offset, 0.0), mass, valid)


def _centroid(x: NDArray, alpha: NDArray, foreign: NDArray) -> NDArray:
    weight = np.where(foreign, 0.0, np.clip(alpha, 0, None))
    return (weight * x).sum(1) / np.maximum(weight.sum(1), 1e-9)


def _matched(x: NDArray, alpha: NDArray, foreign: NDArray, valid: NDArray) -> NDArray:
    clean = valid & ~foreign.any(1)
    profile = alpha[clean].mean(0) if clean.any() else np.exp(-(x**2) / 2)
    profile = (profile + profile[::-1]) / 2
    basis = np.column_stack([profile, np.gradient(profile, x), np.ones_like(x)])
    fit = alpha @ np.linalg.pinv(basis).T
    for row in np.flatnonzero(valid & foreign.any(1)):
        seen = ~foreign[row]
        if seen.sum() > 4:
            fit[row] = np.linalg.lstsq(basis[seen], alpha[row, seen], rcond=None)[0]
    scale = np.where(np.abs(fit[:, 0]) > 0.2, fit[:, 0], np.inf)
    return -fit[:, 1] / scale


def _normals(points: NDArray, closed: bool) -> NDArray:
    if closed:
        tangent = np.roll(points, -1, 0) - np.roll(points, 1, 0)
    else:
        tangent = np.gradient(points, axis=0)
    tangent /= np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-12)[:, None]
    return np.column_stack([-tangent[:, 1], tangent[:, 0]])


def _arc(points: NDArray, closed: bool) -> NDArray:
    ring = np.vstack([points, points[:1]]) if closed else points
    return np.r_[0.0, np.cumsum(np.hypot(*np.diff(ring, axis=0).T))]


def _evenly(points: NDArray, closed: bool) -> tuple[NDArray, float]:
    """About one point a pixel, at equal steps of arc; and the step."""
    arc = _arc(points, closed)
    ring = np.vstack([points, points[:1]]) if closed else points
    count = max(4, round(arc[-1]))
    at = (
        np.linspace(0, arc[-1], count, endpoint=False)
        if closed
        else np.linspace(0, arc[-1], count + 1)
    )
    return np.column_stack([np.interp(at, arc, ring[:, k]) for k in (0, 1)]), arc[-1] / count


def _extended(points: NDArray, by: float) -> NDArray:
    """The line carried straight on at both ends, so that its true ends can be looked for."""
    steps = np.arange(1, int(np.ceil(by)) + 1)[:, None]
    reach = min(10, len(points) - 1)
    head = points[0] - points[reach]
    tail = points[-1] - points[-1 - reach]
    head, tail = head / np.hypot(*head), tail / np.hypot(*tail)
    return np.vstack([points[0] + steps[::-1] * head, points, points[-1] + steps * tail])


def _gap_function(path: NDArray, bridged: NDArray):
    """A function that tells which points lie nearest to a bridged stretch of the path."""
    if not bridged.any():
        return lambda points: np.zeros(len(points), bool)
    from scipy.spatial import cKDTree

    tree = cKDTree(path)
    return lambda points: bridged[tree.query(points)[1]]


def _line_ends(mass: NDArray, valid: NDArray, width: float) -> tuple[float, float]:
    """Where the pen was set down and lifted, as float indices into the path.

    The mass across a round cap of radius r falls to one half at 0.87 r beyond the centre line's
    end, across a straight-cut end at 0.
    """
    on = np.flatnonzero(valid)
    if len(on) < 4:
        return 0.0, len(mass) - 1.0
    cap = width / 2 * (1.0 if width < 2.5 else 0.87)
    ends = []
    for values, first in ((mass[::-1], len(mass) - 1 - on[-1]), (mass, on[0])):
        at = first
        while at > 0 and values[at] > 0.5:
            at -= 1
        low, high = values[at], values[min(at + 1, len(values) - 1)]
        part = (0.5 - low) / (high - low) if high > low else 0.0
        ends.append(at + np.clip(part, 0, 1) + cap)
    return ends[1], len(mass) - 1 - ends[0]


def _cut(
    base: NDArray, measured: _Measured, valid: NDArray, start: float, stop: float
) -> tuple[NDArray, _Measured, NDArray]:
    """The path between two float indices; the points between keep their measurements."""
    first, last = int(np.ceil(start)), int(np.floor(stop))
    keep = slice(max(first, 0), last + 1)
    part = _Measured(measured.offset[keep], measured.mass[keep], measured.valid[keep])
    return base[keep], part, valid[keep]


def _spline(raw: NDArray, valid: NDArray, closed: bool, spacing: float, pitch: float):
    """Least-squares cubic spline through the valid points, a knot every `spacing` px."""
    from scipy.interpolate import make_lsq_spline

    count = len(raw)
    pad = min(count, int(4 * spacing)) if closed else 0
    index = np.arange(-pad, count + pad)
    x, y, w = index * pitch, raw[index % count], valid[index % count].astype(float)
    inner = np.linspace(x[0], x[-1], max(1, round((x[-1] - x[0]) / spacing)) + 1)
    # A knot interval without a measurement would leave the spline undetermined.
    w = np.where(w > 0, w, 1e-3)
    t = np.r_[[inner[0]] * 3, inner, [inner[-1]] * 3]
    return make_lsq_spline(x, y, t, 3, w=w)


def _knot_spacing(raw: NDArray, valid: NDArray, closed: bool, pitch: float) -> float:
    return KNOTS_PX[1]


def _result(
    raw: NDArray, fitted: NDArray, valid: NDArray, closed: bool, knots: float
) -> Centreline:
    residual = np.where(valid[:, None], raw - fitted, np.nan)
    noise = np.sqrt(np.nanmean(np.sum(residual**2, axis=1))) if valid.any() else 1.0
    sigma = np.where(valid, max(noise, 0.01), 0.5)
    arc = _arc(fitted, closed)
    return Centreline(fitted, sigma, ~valid, closed, float(arc[-1]))
