"""A pixel path -> the line's centre to a few hundredths of a pixel, with its uncertainty.

At each point of the path the pen's coverage is read along the local normal, x ↦ α(x). The mean of
all these profiles, made symmetric, is the pen's own profile P(x). A line that lies δ off the path
shows a P(x − δ) + b, so that δ = −(coefficient of P′)/(coefficient of P) in a least-squares fit of
P, P′ and 1: tint and background fall into b. A smoothing spline through the measured points follows
the hand and not the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.doubts import Widening, lines_in, widest_run
from vfplan.curve.ends import (
    ink_ends,
    line_ends,
    stepped_ends,
    told_ends,
    unsure_end,
)
from vfplan.curve.fitting import Fitted, bridged_sigma, curvature_of, fit_line
from vfplan.curve.path import arc_length, evenly, extended, normals, prolonged, without_tips
from vfplan.curve.pen import Pen
from vfplan.curve.point import points_of
from vfplan.curve.profile import Profiles, read_profiles
from vfplan.errors import CurveError

FARTHER_PX = 4.0  # beyond the point to which a pen is drawn out, the path is read
LONGER = 4  # times more at most, while an end is not in sight
TIP, THIN_PX = 0.4, 2.5  # of the width beyond a thin line's: an end whose profile lacks a side
WHOLE = 0.8  # of the usual coverage: beside a gap, less is no whole profile
STEADY_WIDTHS = 4.0  # of a soft pen, whose ends fall off slowly
STEADY, FAINTER = 15, 0.75  # points; of the usual coverage: a line so faint ends so, too
FAINTEST = 0.18  # of it: a line that fades, in linear light, is seen down to here
LEAST = 8  # profiles from which a line can be measured


@dataclass(frozen=True, eq=False)
class Centreline:
    """A measured line."""

    points: NDArray[np.float64]  # (M, 2) float64 (u, v) [px], evenly spaced along the curve
    sigma: NDArray[np.float64]  # (M,) standard deviation across the line [px]
    # (M,) bool, where nothing could be measured and the spline carries the line across
    bridged: NDArray[np.bool_]
    closed: bool  # whether the last point joins the first
    length: float  # arc length, closing step included [px]
    widening: Widening | None = None  # its widest run; `None` where its width was not measured
    # Whether its profile is that of one line; if not, two may lie side by side all along
    single: bool = True
    odd: tuple[tuple[str, ...], ...] = ((), ())  # what is odd about its (first, last) end
    # Whether they are surely the pen's own: round, a dot, or drawn out to a point
    own_ends: tuple[bool, bool] = (False, False)


def trace(
    rgb: NDArray,
    path: NDArray,
    closed: bool,
    bridged: NDArray,
    pen: Pen,
    width: float,
) -> Centreline:
    """Measure the line along a pixel path.

    rgb: (H, W, 3) image
    path, closed, bridged: (M, 2) pixel path, whether it is a ring, and (M,) which points lie on a
        gap
    pen, width: the pen and the line's width [px]
    Raises CurveError: the line is two lines side by side
    """
    from scipy.ndimage import gaussian_filter1d

    smooth = gaussian_filter1d(path, 2.0, axis=0, mode="wrap" if closed else "nearest")
    gap = _gap_finder(smooth, bridged)
    # lost: arc at an end that the path lacks [px]
    base, lost = (smooth, 0.0) if closed else without_tips(smooth, width)
    passes = [False, True]  # whether it is the last one
    taken = 0  # extensions of the path
    point = np.zeros(2)  # how far ink thinner than half the line goes beyond either end [px]
    odd: tuple[tuple[str, ...], ...] = ((), ())
    own = (False, False)
    while passes:
        last = passes.pop(0)
        # Far enough to see the line end, and no further: what lies beyond may be red as well.
        beyond = lost + width / 2 + 2 + point
        base, pitch = evenly(base if closed else extended(base, beyond, width), closed)
        seen_along, middle = (base, normals(base, closed)), base[len(base) // 2]
        profiles = read_profiles(rgb, *seen_along, pen, width)
        valid = profiles.valid & ~gap(base)
        if valid.sum() < LEAST:  # nothing to measure: the smoothed path, with a wide sigma
            return _unmeasured(smooth, bridged, closed, width)
        s = np.arange(len(base)) * pitch
        start, stop, used = 0.0, s[-1] + pitch, valid & ~_beside_gaps(profiles.mass, valid, width)
        if not closed:
            even = _evened(profiles, valid, width)
            ink = ink_ends(even, valid)
            lost = TIP * max(width - THIN_PX, 0.0)
            points = points_of(rgb, base, used, profiles, pen, ink)
            out = np.array([p.beyond * p.drawn_out for p in points])
            inner = ink[0] - out[0], ink[1] + out[1]
            used = _between(used, s, pitch * inner[0] + lost, pitch * inner[1] - lost)
            faint = even is not profiles  # a faint tip thins to less
            room = np.array([ink[0], len(base) - 1 - ink[1]])
            longer = out > np.maximum(room, 0.0)
            if taken < LONGER and (_goes_on(ink, valid | faint) or longer.any()):
                passes = [False, True]  # the path is read once more, longer
                taken += 1
                point = point + np.where(longer, out - room + FARTHER_PX, 0.0)
        fitted = fit_line(s, base, profiles, used, closed, last)
        if not closed and not passes:
            ends = line_ends(rgb, fitted.spline(s), used, even, pen, points)
            odd = told_ends(ends.cut, stepped_ends(profiles, used, width, ends.places))
            # A point that was followed, and is none when seen from nearer, is told as well.
            unsure = np.where((point > 0) & (out == 0), point, ends.unsure)
            odd = tuple(o + unsure_end(px) for o, px in zip(odd, unsure, strict=True))
            own, (start, stop) = ends.own, pitch * np.array(ends.places)
        inner = (0.0, stop) if closed else s[used][[0, -1]]
        base = fitted.spline(np.arange(*inner, pitch))
    verdict = lines_in(profiles, valid, width)
    if verdict == "several":
        _refuse_double(middle, width)
    widest = widest_run(profiles, seen_along[0], valid, width, closed)
    fitted = replace(fitted, sigma=np.hypot(fitted.sigma, widest.doubt))
    line = _result(fitted, s, valid, used, closed, start, stop, rgb.shape, width)
    single = verdict == "single"
    return replace(line, widening=widest, single=single, odd=odd, own_ends=own)


def _evened(profiles: Profiles, valid: NDArray, width: float) -> Profiles:
    """With the coverage of a line that is fainter for a while raised to its usual strength.

    Where it ends there, it ends at half of its strength there.
    """
    from scipy.ndimage import median_filter

    at = np.flatnonzero(valid)
    size = max(STEADY, 2 * round(STEADY_WIDTHS * width / 2) + 1)
    strength = median_filter(profiles.mass[at], size=size)
    if strength[size // 2 : len(at) - size // 2].min(initial=1.0) >= FAINTER:
        return profiles  # an end falls off, and is not faint
    strength = np.interp(np.arange(len(valid)), at, strength)
    scale = np.where(strength < FAINTER, 1 / np.maximum(strength, FAINTEST), 1.0)
    return replace(profiles, alpha=profiles.alpha * scale[:, None], mass=profiles.mass * scale)


def _goes_on(ink: tuple[float, float], valid: NDArray) -> bool:
    """Whether an end of the path still lies on the line: thinning eats thin slanting ones."""
    return bool((valid[0] and ink[0] <= 0) or (valid[-1] and ink[1] >= len(valid) - 1))


def _beside_gaps(mass: NDArray, valid: NDArray, width: float) -> NDArray[np.bool_]:
    """Where a line is lifted or hidden within a width: its profile may lack a side there."""
    from scipy.ndimage import binary_dilation

    near = binary_dilation(~valid, iterations=max(1, round(width)))
    return near & (mass < WHOLE)


def _between(valid: NDArray, s: NDArray, start: float, stop: float) -> NDArray[np.bool_]:
    """What was seen between `start` and `stop` of arc; all of it when that is next to nothing."""
    inner = valid & (s >= start) & (s <= stop)
    return inner if inner.sum() >= LEAST else valid


def _refuse_double(place: NDArray, width: float) -> NoReturn:
    raise CurveError(
        f"two lines run side by side, or the pen's outline alone is drawn, {width:.0f} px across: "
        "which of them is meant would be a guess",
        where=f"pixel ({place[0]:.0f}, {place[1]:.0f})",
    )


def _gap_finder(path: NDArray, bridged: NDArray):
    """A function that tells which points lie nearest to a bridged stretch of the path."""
    if not bridged.any():
        return lambda points: np.zeros(len(points), bool)
    from scipy.spatial import cKDTree

    tree = cKDTree(path)
    return lambda points: bridged[tree.query(points)[1]]


def _unmeasured(path: NDArray, bridged: NDArray, closed: bool, width: float) -> Centreline:
    sigma = np.full(len(path), max(0.5, width / 4))
    return Centreline(path, sigma, bridged, closed, float(arc_length(path, closed)[-1]))


def _result(
    fitted: Fitted,
    s: NDArray,
    valid: NDArray,
    used: NDArray,
    closed: bool,
    start: float,
    stop: float,
    shape: tuple[int, ...],
    width: float,
) -> Centreline:
    dense = np.linspace(start, stop, 4 * max(2, round(stop - start)) + 1)
    place = fitted.spline
    if not closed:
        first, last = s[used][[0, -1]]
        place = prolonged(place, first, last, max(first - start, stop - last), width)
    curve = place(dense)
    if not closed:
        dense, curve = _inside(dense, curve, shape)
    arc = np.r_[0.0, np.cumsum(np.hypot(*np.diff(curve, axis=0).T))]
    count = max(4, round(arc[-1]))
    at = np.interp(np.linspace(0, arc[-1], count + 1)[: count if closed else None], arc, dense)
    points = place(at)
    nearest = np.clip(np.rint(at / (s[1] - s[0])).astype(int), 0, len(s) - 1)
    bridged = ~valid[nearest]
    sigma = np.hypot(
        fitted.sigma[nearest], bridged_sigma(bridged, curvature_of(fitted.spline, at), closed)
    )
    return Centreline(points, sigma, bridged, closed, float(arc[-1]))


def _inside(dense: NDArray, curve: NDArray, shape: tuple[int, ...]) -> tuple[NDArray, NDArray]:
    """Without what lies beyond the image's border, where a line may run off."""
    limit = np.array([shape[1], shape[0]]) - 0.5
    on = np.flatnonzero(((curve >= -0.5) & (curve <= limit)).all(1))
    keep = slice(on[0], on[-1] + 1)
    return dense[keep], curve[keep]
