"""Measured offsets -> a spline that follows the hand and not the noise, and its standard deviation.

Knots stand as far apart as the noise wants, and closer where the line bends: a cubic spline with
knots h apart departs from a bend of radius R by little as long as h is below about R/2. No knot
falls into a gap: there one cubic, smooth to the second derivative at both sides, carries the line
from edge to edge.

What is left between the measurements and the spline tells the noise, and the noise the spline's own
error. What does not show there is added: the grid's share on runs nearly along it, where it is as
smooth as the line; bends; the ends, which hang on one side only; corners and gaps. The numbers were
found by drawing curves with known truth; what they come to is in docs/extraction.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.path import normals, runs
from vfplan.curve.profile import Profiles, shading_shift

KNOTS_PX, NOISY_KNOTS_PX = 7.0, 12.0  # apart; JPEG's noise hangs together over blocks of 16 px
CLOSEST_PX, BEND_SHARE = 3.5, 0.5  # in a bend, of whose radius they stand this share apart
GAP_PX = 2.0  # between neighbouring points: more is a gap
WRAP_PX = 100.0  # a knot's influence fades by a factor of about 4 each knot further
SOFT_PX2 = 0.45  # of blur: a crisp pen, read between pixels, has 0.25, JPEG's colour 0.6

FLOOR_PX = 0.001  # what programs that draw round off
# The spline's error over the RMS of what is left: the pixel grid's pattern averages out, of thin
# pens less, and is no more than `GRID_PX`; JPEG's noise hangs together, the longer the louder it is
# [1/px].
CLEAN, THIN_PX, GRID_PX, NOISY, LOUDER = 0.12, 4.0, 0.033, 0.375, 3.0
# Beyond so many times the noise, over so much line, it is a corner that the spline cuts.
LOUD, CORNER_PX, CORNER = 1.5, 29, 2.0
# The grid's share along its rows, crisp and soft; the sine of the angle over which it fades; the
# same along diagonals.
ALONG_PX, SLANT, DIAGONAL, DIAGONAL_SLANT = (0.025, 0.07), 0.11, 0.6, 0.02
TOUCHED_POINTS = 11  # within which the spline carries on what un-mixing gets wrong at one
CLIPPED = 5.0  # a line of which the border cuts off a part is less sure by this times the part
END, END_PX = 4.5, 4.0  # how much less sure an end is, and over how much line that fades
SWAY = 1.5  # times its usual bend, what a line may do in a gap


@dataclass(frozen=True, eq=False)
class Fitted:
    """A line's spline over arc length [px], and (M,) its deviation at the measured points [px]."""

    spline: Callable[[NDArray], NDArray]
    sigma: NDArray[np.float64]


def fit_line(
    s: NDArray, base: NDArray, profiles: Profiles, valid: NDArray, closed: bool, last: bool
) -> Fitted:
    """The spline through what was read along a path, and where it is the `last` its deviation.

    s, base: (M,) arc length and (M, 2) the path, in equal steps [px]
    profiles, valid: what was read there, and (M,) bool, which of it counts
    closed: whether the path is a ring
    """
    from scipy.ndimage import maximum_filter1d

    normal = normals(base, closed)
    period = s[-1] + s[1] if closed else None
    raw = base + profiles.offset[:, None] * normal
    knots = place_knots(s, np.zeros(len(s)), valid, period or s[-1], KNOTS_PX)
    spline = fit_spline(s, np.column_stack([raw, profiles.shading]), valid, period, knots)
    if not last:
        return Fitted(lambda x: spline(x)[:, :2], np.zeros(len(s)))
    smooth = spline(s)
    fast = np.where(valid, profiles.shading - smooth[:, 2], 0.0)
    residual = _along_normal(raw - smooth[:, :2], normal, valid)
    shift, doubt = shading_shift(profiles.shading, fast, residual, valid)
    bend = curvature_of(spline, s)
    raw = raw + (shift - drawn_inward(bend, profiles.blur))[:, None] * normal
    soft = profiles.noisy or profiles.blur > SOFT_PX2
    widest = NOISY_KNOTS_PX if soft else KNOTS_PX
    knots = place_knots(s, bend, valid, period or s[-1], widest)
    spline = fit_spline(s, raw, valid, period, knots)
    residual, bend = _along_normal(raw - spline(s), normal, valid), curvature_of(spline, s)
    mode = "wrap" if closed else "nearest"
    sigma = measured_sigma(residual, valid, normal, bend, profiles, mode)
    touched = maximum_filter1d(profiles.doubt, TOUCHED_POINTS, mode=mode)
    sigma = np.sqrt(sigma**2 + doubt**2 + touched**2) * (1 + CLIPPED * profiles.clipped)
    if period is None:
        sigma *= end_factor(s, *s[valid][[0, -1]])
    return Fitted(spline, sigma)


def fit_spline(s: NDArray, points: NDArray, valid: NDArray, period: float | None, knots: NDArray):
    """Least-squares cubic spline of points over arc length, with the knots given.

    s: (M,) arc length of each point, increasing
    points: (M, K) values; only those where `valid` count
    valid: (M,) bool
    period: length of a closed curve; `None` for an open one
    knots: (Q,) inner and end knots, increasing, of one period
    """
    from scipy.interpolate import make_lsq_spline

    x, y = s[valid], points[valid]
    inner = knots
    if period is not None:  # wrapped on both sides, so that the seam is as smooth as the rest
        reach = min(period / 3, WRAP_PX)
        before, after = x > x[0] + period - reach, x < x[0] + reach
        x = np.r_[x[before] - period, x, x[after] + period]
        y = np.vstack([y[before], y, y[after]])
        inner = np.r_[knots[:-1] - period, knots[:-1], knots + period]
        inner = inner[(inner > x[0] + CLOSEST_PX / 2) & (inner < x[-1] - CLOSEST_PX / 2)]
    inner = inner[(inner > x[0]) & (inner < x[-1])]
    inner = _with_data(inner, x)
    t = np.r_[[x[0]] * 4, inner, [x[-1]] * 4]
    return make_lsq_spline(x, y, t, 3)


def _with_data(inner: NDArray, x: NDArray) -> NDArray:
    """The knots that leave enough points in every interval to determine the spline.

    Only the interval over a gap may be empty, between two that are not: so the cubic that crosses
    it bends as it must, and those on either side follow what was measured there.
    """
    kept, last, crossing = [], 0, False
    for knot in inner:
        upto = int(np.searchsorted(x, knot))
        enough = upto - last >= 3
        beyond = 0 < upto < len(x) and x[upto] - x[upto - 1] > GAP_PX and kept and not crossing
        if (enough or beyond) and len(x) - upto >= 3:
            kept.append(knot)
            last, crossing = upto, not enough
    return np.array(kept)


def place_knots(
    s: NDArray, curvature: NDArray, valid: NDArray, length: float, widest: float
) -> NDArray:
    """Knots over [0, length], closer in bends; at the edges of a gap and none inside it."""
    from scipy.ndimage import maximum_filter1d

    bend = maximum_filter1d(np.abs(curvature), 9)
    spacing = np.clip(BEND_SHARE / np.maximum(bend, 1e-6), CLOSEST_PX, widest)
    knots = [np.array([0.0])]
    for seen in runs(valid, False):
        run, gaps = s[seen], spacing[seen]
        count = np.r_[0.0, np.cumsum(np.diff(run) / ((gaps[1:] + gaps[:-1]) / 2))]
        knots.append(np.interp(np.linspace(0, count[-1], max(1, round(count[-1])) + 1), count, run))
    at = np.unique(np.concatenate([*knots, [length]]))
    return at[(at >= 0) & (at <= length)]


def curvature_of(spline, s: NDArray) -> NDArray:
    """Signed curvature [1/px] of a plane spline."""
    first, second = spline(s, 1), spline(s, 2)
    speed = np.maximum(np.hypot(first[:, 0], first[:, 1]), 1e-9)
    return (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3


def _along_normal(offset: NDArray, normal: NDArray, valid: NDArray) -> NDArray:
    return np.where(valid, (offset * normal).sum(1), 0.0)


def measured_sigma(
    residual: NDArray,
    valid: NDArray,
    normal: NDArray,
    curvature: NDArray,
    profiles: Profiles,
    mode: Literal["wrap", "nearest"],
) -> NDArray[np.float64]:
    """(M,) standard deviation of the fitted line where it was seen [px].

    residual, valid: (M,) measured offset minus the spline [px], and where there is any
    normal, curvature: (M, 2) unit normals of the line, and (M,) its curvature [1/px]
    mode: how the line goes on beyond what was measured: a ring's wraps
    """
    from scipy.ndimage import uniform_filter1d

    power = float((residual[valid] ** 2).mean())
    ratio, most = NOISY * (1 + LOUDER * np.sqrt(power)), LOUD * power
    if not profiles.noisy:
        ratio, most = CLEAN * max(1.0, THIN_PX / profiles.width), GRID_PX**2
    near, share = (
        uniform_filter1d(values, CORNER_PX, mode=mode)
        for values in (np.where(valid, residual**2, 0.0), valid.astype(float))
    )
    corner = CORNER * np.maximum(near / np.maximum(share, 0.05) - most, 0.0)
    slant = np.abs(normal).min(1)
    diagonal = DIAGONAL * np.exp(-(((slant - np.sqrt(0.5)) / DIAGONAL_SLANT) ** 2))
    along = ALONG_PX[profiles.blur > SOFT_PX2] * np.hypot(np.exp(-((slant / SLANT) ** 2)), diagonal)
    bent = drawn_inward(curvature, profiles.blur)  # as much again may be wrong
    noise = ratio**2 * min(power, most)
    return np.sqrt(noise + corner + along**2 + bent**2 + FLOOR_PX**2)


def drawn_inward(curvature: NDArray, blur: float) -> NDArray[np.float64]:
    """(M,) how far blur of that variance [px²] draws a line to the inside of its bends [px].

    In JPEG, too, by the blur that shows: nothing of JPEG's own is taken off a bend.
    """
    return curvature * blur / 2


def end_factor(s: NDArray, first: float, last: float) -> NDArray[np.float64]:
    """(M,) how much less sure an open line is at arc lengths s, measured from `first` to `last`."""
    beyond = np.minimum(np.maximum(first - s, s - last), END_PX)
    return 1 + END * np.exp(beyond / END_PX)


def bridged_sigma(bridged: NDArray, curvature: NDArray, closed: bool) -> NDArray:
    """(M,) what a gap adds: the hand may have bent there as much as it does elsewhere [px].

    A gap of length L and an unknown curvature of standard deviation k leaves k x (L − x)/2 at x.
    """
    extra = np.zeros(len(bridged))
    spread = np.sqrt(np.mean(curvature**2))
    for run in runs(bridged, closed):
        x = np.arange(len(run)) + 0.5
        extra[run] = SWAY * spread * x * (len(run) - x) / 2
    return extra
