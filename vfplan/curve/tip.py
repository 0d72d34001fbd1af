"""The end of a pen's line, fitted to the pixels around it.

A line as wide and as blurred as its own profile shows is laid along its path with an end that is
round, cut off straight or cut off on a slant, and moved along; what is left of the pixels, when
ground and line are fitted as well, says how likely each is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.path import extended, normals
from vfplan.curve.pen import Pen
from vfplan.curve.profile import LUMINANCE, MIDDLE_PX, STEP_PX, Profiles

HALF_DISC = 0.85  # of its radius: where a round end's ink falls to half the width
SLANTS = np.tan(np.radians([-60.0, -30.0, 30.0, 60.0]))  # px along the line per px across
SEARCH_PX, TRIALS = (0.5, 0.1), np.arange(-5, 6)  # steps, from the ink's end and then the best's
STRIPS, NO_SHARE = 16, 1e-12  # of the pen, across the line
# Pixels looked at, before the tip, beside the line, and further than the path was read.
BACK_PX, SIDE_PX, AHEAD_PX = 5.0, 3.0, 4.0
SCALE_PX = 6.0  # of the ground's polynomial, to keep its numbers small
RIDGE = 1e-6  # of the mean square: what nothing in the picture determines stays 0
HALVES = np.arange(0.55, 1.16, 0.05)  # of the mask's width: JPEG's colour makes a thin line wide
BLURS_PX = np.r_[0.4:0.7:0.05, 0.7:1.6:0.1]  # an edge's standard deviation along a profile,
SAMPLING_PX2, SHARPEST_PX = 0.2, 0.3  # of which so much is its own, read between pixels; a pixel's
# Pixels whose misfit hangs together: in JPEG's colour, in its brightness over bones, and without.
ALIKE_COLOUR, ALIKE_LIGHT, ALIKE_CLEAN = 14.0, 6.0, 1.0
CRISP_PX = 0.35  # the blur of a picture that was not enlarged: pixels hang together over more
FAINTEST, FAINTEST_GREY = 0.01, 1.0  # of full coverage, and of 255: no model is better
LEAST_SEEN, CLEAR = (
    8,
    1.0,
)  # pixels, or profiles in which a line stands out of its flanks' roughness so


@dataclass(frozen=True)
class Tip:
    """A line's end as it was fitted."""

    round_at: float  # row of the path where its centre line ends if it is round,
    flat_at: float  # and if it is cut off straight
    flat_odds: float  # log odds of an end cut off straight against a round one,
    cut_odds: float  # of one cut off at any angle against a round one,
    slant_odds: float  # and of one cut off on a slant against both others
    half: float  # half the pen's width [px]


@dataclass(frozen=True, eq=False)
class View:
    """A value of pixels that shows the line, `rgb` @ `row`, and how the line looks in it."""

    row: NDArray[np.float64]  # (3,)
    half: float  # half the line's width [px]
    blur: float  # standard deviation of its edges [px]
    alike: float
    faintest: float

    def coverage(self, beyond: NDArray, across: NDArray, slant: float | None) -> NDArray:
        """(T, N) coverage (T, N) px past the line's end and (N,) across; a round one for `None`.

        The blurred pen shows at a pixel strips that reach differently far: their mean and variance
        there are the place and the blur of the end.
        """
        from scipy.special import ndtr

        edges = np.linspace(-self.half, self.half, STRIPS + 1)
        strips = (edges[1:] + edges[:-1]) / 2
        shares = -np.diff(ndtr((across - edges[:, None]) / self.blur), axis=0)
        line = shares.sum(0)
        shares /= np.maximum(line, NO_SHARE)
        reach = np.sqrt(self.half**2 - strips**2) if slant is None else slant * strips
        mean = reach @ shares
        blur = np.sqrt(self.blur**2 + np.maximum(reach**2 @ shares - mean**2, 0.0))
        return ndtr((mean - beyond) / blur) * line

    def drift(self, beyond: NDArray, across: NDArray) -> NDArray[np.float64]:
        """(T, N) what the line's coverage changes by, up to a factor, when it moves sideways."""
        from scipy.special import ndtr

        left, right = ((across + side) / self.blur for side in (self.half, -self.half))
        return ndtr(-beyond / self.blur) * (np.exp(-(left**2) / 2) - np.exp(-(right**2) / 2))


def fitted_tips(
    rgb: NDArray, path: NDArray, used: NDArray, profiles: Profiles, pen: Pen, inks: tuple
) -> tuple[Tip, Tip]:
    """Both ends of the line along a path that reaches beyond them, fitted.

    rgb: (H, W, 3) image
    path, used: (M, 2) points, about one a pixel, and (M,) where the line was measured; beyond, it
        is carried on as it bends there
    profiles: what was read across the path
    inks: rows of the path where the ink ends
    """
    (first, stop), last = np.flatnonzero(used)[[0, -1]], len(path) - 1
    by = max(first, last - stop)
    path = extended(path[first : stop + 1], by, profiles.width)[by - first :][: last + 1]
    views = _views(profiles, used, pen)
    head = fitted(views, rgb, path[::-1], profiles.seen[::-1, ::-1], last - inks[0])
    return head, fitted(views, rgb, path, profiles.seen, inks[1])


def _views(profiles: Profiles, used: NDArray, pen: Pen) -> list[View]:
    """The coverage, and where that is coarse the brightness as well."""
    x, halves = profiles.x, HALVES * profiles.width / 2
    colour, seen = pen.along / pen.strength, used[:, None] & profiles.seen
    mean = np.where(seen, profiles.alpha, 0.0).sum(0) / np.maximum(seen.sum(0), 1)
    if not profiles.noisy:
        return [View(colour, *_pen_of(x, mean, halves), ALIKE_CLEAN, FAINTEST)]
    depth = profiles.light[:, np.abs(x) <= MIDDLE_PX].mean(1)
    clear = seen.all(1) & (np.abs(depth) > CLEAR * profiles.rough)
    if clear.sum() < LEAST_SEEN:
        return [View(colour, *_pen_of(x, mean, halves), ALIKE_COLOUR, FAINTEST)]
    light = (depth / profiles.rough**2)[clear] @ profiles.light[clear]
    half, sharp = _pen_of(x, light, halves)
    return [
        View(colour, *_pen_of(x, mean, np.array([half])), ALIKE_COLOUR, FAINTEST),
        View(LUMINANCE, half, sharp, ALIKE_LIGHT, FAINTEST_GREY),
    ]


def _pen_of(x: NDArray, profile: NDArray, halves: NDArray) -> tuple[float, float]:
    """Half the width, among `halves`, and the blur of the line whose profile is most like this."""
    from scipy.special import ndtr

    pens = np.stack(np.meshgrid(halves, BLURS_PX, indexing="ij"), -1).reshape(-1, 2, 1)
    half, blur = pens[:, 0], pens[:, 1]
    shapes = ndtr((x + half) / blur) - ndtr((x - half) / blur)
    shapes = shapes - shapes.mean(1, keepdims=True)
    explained = (shapes @ (profile - profile.mean())) ** 2 / (shapes**2).sum(1)
    half, blur = pens[np.argmax(explained), :, 0]
    return float(half), float(np.sqrt(max(blur**2 - SAMPLING_PX2, SHARPEST_PX**2)))


def fitted(views: list[View], rgb: NDArray, path: NDArray, seen: NDArray, ink: float) -> Tip:
    """The end of a path's line of which the ink ends near row `ink`."""
    half = views[-1].half
    s, x, u, v = _around(path, seen, ink - half - BACK_PX, half + SIDE_PX, rgb.shape)
    if len(s) < LEAST_SEEN:  # it lies outside of the picture
        return Tip(ink - HALF_DISC * half, ink, 0.0, 0.0, 0.0, half)
    pixels = rgb[v, u] * (255.0 / np.iinfo(rgb.dtype).max)
    slants = [None, 0.0, *SLANTS]
    at = np.where([slant is None for slant in slants], ink - HALF_DISC * half, ink)
    for step in SEARCH_PX:
        trials = at[:, None] + step * TRIALS
        caps = list(zip(slants, trials, strict=True))
        doubt = np.zeros(trials.shape)
        for view in views:
            power = np.array([_misfit(view, s, x, pixels @ view.row, *cap) for cap in caps])
            noise = power.min() + view.faintest**2
            alike = max(view.alike, (view.blur / CRISP_PX) ** 2)
            doubt += len(s) / alike / 2 * power / noise
        at = np.take_along_axis(trials, doubt.argmin(1)[:, None], 1)[:, 0]
    disc, flat, *slanted = doubt.min(1)
    best = min(slanted)
    return Tip(at[0], at[1], disc - flat, disc - min(flat, best), min(disc, flat) - best, half)


def _around(
    path: NDArray, seen: NDArray, first: float, reach: float, shape: tuple[int, ...]
) -> tuple[NDArray, ...]:
    """Pixels within reach of a (M, 2) path from row `first` on: their row, place across, u and v.

    Of those only what (M, K) profiles saw.
    """
    rows = np.arange(max(0, int(first)), len(path))
    places, normal = path[rows], normals(path, False)[rows]
    low = np.maximum(np.floor(places.min(0) - reach), 0).astype(int)
    high = np.minimum(np.ceil(places.max(0) + reach) + 1, shape[1::-1]).astype(int)
    high = np.maximum(low, high)
    v, u = (grid.ravel() for grid in np.mgrid[low[1] : high[1], low[0] : high[0]])
    off = np.column_stack([u, v])[:, None] - places
    nearest = (off**2).sum(2).argmin(1)
    off, normal = off[np.arange(len(off)), nearest], normal[nearest]
    x = (off * normal).sum(1)
    s = rows[nearest] + off[:, 0] * normal[:, 1] - off[:, 1] * normal[:, 0]
    place = np.clip(np.rint(x / STEP_PX).astype(int) + seen.shape[1] // 2, 0, seen.shape[1] - 1)
    keep = (
        (np.abs(x) <= reach)
        & (s >= rows[0])
        & (s <= rows[-1] + AHEAD_PX)
        & seen[rows[nearest], place]
    )
    return s[keep], x[keep], u[keep], v[keep]


def _misfit(
    view: View, s: NDArray, x: NDArray, value: NDArray, slant: float | None, ends: NDArray
) -> NDArray[np.float64]:
    """(T,) mean square of what a line that ends at (T,) rows `ends` leaves of (N,) values.

    The ground is a quadratic in both directions, the line's own value changes evenly along it, and
    the line may lie a little beside the path and at a small angle to it.
    """
    beyond = s - ends[:, None]
    along, across = (s - ends.mean()) / SCALE_PX, x / SCALE_PX
    ground = np.column_stack([np.ones_like(s), along, across, along**2, along * across, across**2])
    line = view.coverage(beyond, x, slant)[..., None]
    aside = view.drift(beyond, x)[..., None]
    basis = np.concatenate([(1 - line) * ground, line * ground[:, :2], aside * ground[:, :2]], 2)
    power = basis.transpose(0, 2, 1) @ basis + RIDGE * len(s) * np.eye(basis.shape[2])
    parts = np.linalg.solve(power, basis.transpose(0, 2, 1) @ value[:, None])
    return ((value - (basis @ parts)[..., 0]) ** 2).mean(1)
