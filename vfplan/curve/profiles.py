"""What the picture shows across a line, and where the pen was put down and lifted.

One rule finds blunt and tapered ends. Along the line its ink, the coverage summed across, falls
from full to nothing. Straight falls of many lengths and places are held against it, and each counts
by how well it fits. A short fall is a blunt end: the centre of the pen's tip lies a part of the
width before the middle of the fall. A long fall is a pen that was drawn out, and the fall's foot is
its point. Where both fit, the end lies between them, and its deviation says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from math import erf, sqrt

import numpy as np
from numpy.typing import NDArray

from vfplan.curve import tuned
from vfplan.curve.coverage import OTHER_UNIT, Ink, brightness, sample
from vfplan.geometry.lines import Array, Flags, gaussian


@dataclass(frozen=True, eq=False)
class Profiles:
    """Samples across a path of M points, at K places.

    Parameters
    ----------
    x
        (K,) the places across the path [px].
    coverage
        (M, K) of the pen.
    is_line
        (M, K) bool: in the picture, and no ink of a neighbour.
    inside
        (M, K) bool: in the picture.
    mass
        (M,) coverage summed across the line, 1 where it is as usual.
    valid
        (M,) bool: the line was seen.
    hidden
        (M,) bool: another colour lies over it.
    has_other
        (M,) bool: another colour lies over it or close to its edge.
    covered
        (M,) how much of the line's width another colour hides, with the sign of its side [px].
    width
        The line's width [px].
    """

    x: Array
    coverage: Array
    is_line: Flags
    inside: Flags
    mass: Array
    valid: Flags
    hidden: Flags
    has_other: Flags
    covered: Array
    width: float

    @property
    def core(self) -> Flags:
        """(K,) the places within the line."""
        return np.abs(self.x) <= self.width / 2

    @property
    def peak(self) -> Array:
        """(M,) the largest coverage across the line."""
        return np.where(self.is_line, self.coverage, 0).max(1)

    def offset(self, ink: Ink, path: NDArray, normal: NDArray, noisy: bool) -> Array:
        """(M,) how far off the path, along its (M, 2) normals, the line lies [px]."""
        by_colour = self.offset_of_colour(noisy)
        offset = add_brightness(ink, path, normal, self, by_colour) if noisy else by_colour
        return off_opposite(ink, path, normal, self, offset)

    def offset_of_colour(self, noisy: bool) -> Array:
        """(M,) the same by the pen's coverage alone.

        Two measures: the centroid of the line's own ink, and the shift of its mean profile that
        fits best. The centroid follows a pen whose width changes; the shift is less disturbed by
        noise in the flanks. Where colour is noisy the shift counts, else what scatters less.
        """
        ink = np.where(self.is_line, np.clip(self.coverage, 0, None), 0)
        centroid = (ink @ self.x) / np.maximum(ink.sum(1), 1e-6)
        # Another colour hides one side: what shows lies half of its width to the other side.
        centroid = np.where(self.valid, centroid + self.covered / 2, 0.0)
        whole = self.is_line.all(1) & self.valid
        if whole.sum() < tuned.MIN_PROFILES:
            return centroid
        mean = symmetric(self.coverage[whole].mean(0))
        shift = fit_shift(self.x, self.coverage, self.is_line, mean, np.ones((len(self.x), 1)))
        clear = self.valid & ~self.hidden & (self.mass > tuned.VISIBLE)
        usable = clear & (np.abs(shift) <= self.width / 2 + 1)
        shift = np.where(usable, shift, centroid)
        if noisy or self.scatter(shift) < self.scatter(centroid):
            return shift
        # The centroid of a line that the picture's border cuts lies too far inside.
        return np.where(usable & ~self.inside[:, self.core].all(1), shift, centroid)

    def scatter(self, offset: NDArray) -> float:
        """Variance of an offset around its slow changes [px^2], whatever a few outliers do."""
        return float(np.median((offset - gaussian(offset, tuned.TREND_PX))[self.valid] ** 2))


def read_profiles(ink: Ink, path: NDArray, normal: NDArray, width: float) -> Profiles:
    """Read the coverage across a (M, 2) path with (M, 2) unit normals."""
    half = np.ceil((width / 2 + tuned.FLANK_PX) / tuned.STEP_PX)
    x = np.arange(-half, half + 1) * tuned.STEP_PX
    u, v = places_across(path, normal, x)
    coverage = sample(ink.coverage, u, v).astype(float)
    other = sample(ink.other, u, v) / OTHER_UNIT
    columns, rows = ink.size
    inside = (u > -0.5) & (u < columns - 0.5) & (v > -0.5) & (v < rows - 0.5)
    is_line = ~_beyond_valley(coverage, x, width)
    mass = np.where(is_line, np.clip(coverage, 0, None), 0).sum(1) * tuned.STEP_PX
    is_inside = inside[:, len(x) // 2]
    shows = is_inside & sample(ink.mask.view(np.uint8), u, v).any(axis=1)
    # Of a path that is mostly bare, the usual ink is that of the part that shows some.
    if not 0 < 2 * shows.sum() < is_inside.sum():
        shows = is_inside
    usual = max(float(np.median(mass[shows])), 1e-6)
    mass = mass / usual
    core = np.abs(x) <= width / 2 + tuned.STEP_PX
    has_other = (other > tuned.FOREIGN).any(1)
    hidden = (other[:, core] > tuned.FOREIGN).any(1) & (mass < tuned.HIDDEN)
    side = np.sign((other * x)[:, core].sum(1))
    covered = np.where(hidden, side * (1 - mass) * usual, 0.0)
    valid = (mass > np.where(hidden, tuned.HALF, tuned.VISIBLE)) & is_inside
    is_line &= inside
    return Profiles(x, coverage, is_line, inside, mass, valid, hidden, has_other, covered, width)


def off_opposite(
    ink: Ink, path: NDArray, normal: NDArray, profiles: Profiles, offset: NDArray
) -> Array:
    """(M,) offsets less what a line of the opposite hue along one edge adds to all of them.

    Its coverage is below 0, and takes from the pen's own where blur mixes both.
    """
    offset = offset.copy()
    reach = profiles.x[-1] + tuned.BESIDE_PX
    x = np.arange(-reach, reach + tuned.STEP_PX, tuned.STEP_PX)
    for side in (1, -1):
        is_beside = profiles.coverage[:, side * profiles.x < 0].min(1) < -tuned.RISE
        is_beside &= profiles.coverage[:, side * profiles.x > 0].min(1) > -tuned.RISE
        # JPEG surrounds a pen with such coverage too, but with no other ink.
        is_beside &= profiles.valid & profiles.has_other
        if is_beside.sum() >= tuned.LONG_STRETCH_PX:
            places = places_across(path[is_beside], normal[is_beside], side * x)
            profile = sample(ink.coverage, *places).mean(0, dtype=float)
            place = place_beside(x, profile, profiles.width)
            if place is not None:
                offset[is_beside] += side * place - np.median(offset[is_beside])
    return offset


# Least and largest place of a pen and half its width [px], the paper between it and another pen
# (below 0 they overlap), the width of that one, the blur of both [px], and their coverage. They are
# wide: what no pen of up to 12 px does is no fit.
STRIPES = ((-5, 0.25, -2, 0.5, 0.3, 0.3, 0.1), (5, 6, 5, 8, 3, 4, 6))


def place_beside(x: NDArray, profile: NDArray, width: float) -> float | None:
    """Where a pen lies in a (K,) profile, beside another one at smaller `x`.

    Each is a stripe, and both are blurred alike. `None` where they are not.
    """
    from scipy.optimize import least_squares
    from scipy.special import ndtr

    def misfit(numbers: NDArray) -> Array:
        place, size, gap, other, blur, height, depth = numbers
        edges = place - np.cumsum([-size, 2 * size, gap, other])
        steps = ndtr((x - edges[:, None]) / blur)
        return np.array([-height, height, depth, -depth]) @ steps - profile

    start = np.clip([0, width / 2, 0.5, 2, 0.8, 1, 1], *STRIPES)
    fit = least_squares(misfit, start, bounds=STRIPES)
    return fit.x[0] if np.abs(fit.fun).max() <= tuned.RISE else None


def symmetric(profile: NDArray) -> Array:
    """A (K,) profile and its mirror image, averaged."""
    return (profile + profile[::-1]) / 2


def fit_shift(x: NDArray, rows: NDArray, is_line: NDArray, mean: NDArray, ground: NDArray) -> Array:
    """(M,) how far a (K,) mean profile is shifted in each of (M, K) rows of values [px].

    A least-squares fit of the profile, its derivative and a ground (K, G), through the samples that
    are the line's own; 0 where the profile does not show.
    """
    basis = np.column_stack([mean, np.gradient(mean, x), ground])
    fit = rows @ np.linalg.pinv(basis).T
    for row in np.flatnonzero(~is_line.all(1)):
        visible = is_line[row]
        if visible.sum() > basis.shape[1]:
            fit[row] = np.linalg.lstsq(basis[visible], rows[row, visible], rcond=None)[0]
    height = np.where(fit[:, 0] > tuned.RISE, fit[:, 0], np.inf)
    return -fit[:, 1] / height


def places_across(path: NDArray, normal: NDArray, x: NDArray) -> tuple[NDArray, NDArray]:
    """(M, K) columns u and rows v of the places `x` across a path [px]."""
    return path[:, :1] + normal[:, :1] * x, path[:, 1:] + normal[:, 1:] * x


def _beyond_valley(coverage: NDArray, x: NDArray, width: float) -> Flags:
    """Where coverage rises again, outward from the line's edge: the ink of a neighbour."""
    beyond = np.zeros(coverage.shape, bool)
    for side in (1, -1):
        outward = np.flatnonzero(side * x >= width / 2)[::side]
        run = coverage[:, outward]
        rises = run - np.minimum.accumulate(run, axis=1) > tuned.RISE
        for row in np.flatnonzero(rises.any(1)):
            bottom = run[row, : rises[row].argmax()].argmin()
            beyond[row, outward[bottom + 1 :]] = True
    return beyond


def add_brightness(
    ink: Ink, path: NDArray, normal: NDArray, profiles: Profiles, offset: NDArray
) -> Array:
    """(M,) offsets with what the brightness adds, which JPEG keeps at full resolution.

    The ground is a straight run from flank to flank. Coverage and brightness count by their own
    noise, so that coverage alone counts where it is clean, and where the ground is rough or as
    bright as the pen.
    """
    x = profiles.x
    light = brightness(ink.rgb, *places_across(path, normal, x))
    flank = np.abs(x) > profiles.width / 2 + tuned.FLANK_PX / 2
    ramp = np.column_stack([np.ones(len(x)), x])
    line = light - light[:, flank] @ np.linalg.pinv(ramp[flank]).T @ ramp.T
    rough = np.sqrt((line[:, flank] ** 2).mean(1)) + 1.0  # Grey levels are whole numbers.
    depth = line[:, ~flank].mean(1)
    clear = profiles.valid & ~profiles.hidden & profiles.is_line.all(1) & (np.abs(depth) > rough)
    if clear.sum() < tuned.MIN_PROFILES:
        return offset
    depth = np.where(clear, depth, 1.0)
    weight = np.where(clear, depth / rough**2, 0.0)
    mean = symmetric(weight @ line / (weight @ depth))
    is_line = profiles.is_line | ~clear[:, None]
    by_light = fit_shift(x, line / depth[:, None], is_line, mean, ramp)
    # Brightness that lies more than half a width off the colour is not the line's.
    clear &= np.abs(by_light - offset) <= profiles.width / 2
    if clear.sum() < tuned.MIN_PROFILES:
        return offset
    trend = gaussian(offset, tuned.TREND_PX)
    colour_variance = profiles.scatter(offset)
    light_variance = (rough / depth) ** 2
    light_variance *= np.median(((by_light - trend) ** 2 / light_variance)[clear])
    # JPEG stores colour at half the resolution, so its noise hangs together over twice the length,
    # and smoothing along the line averages half as much of it.
    light_variance /= 2
    share = np.where(clear, colour_variance / (colour_variance + light_variance), 0.0)
    return offset + share * (by_light - offset)


# Pixels: lengths of the falls that are held against the ink.
FALLS_PX = np.array([1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 10, 12, 14, 17, 20, 24, 29, 35, 42])
HIGH = tuned.FALL_SHARE
LOW = 1 - tuned.FALL_SHARE


@dataclass(frozen=True)
class End:
    """One end of an open line, in points of its path, which lie 1 px apart.

    Parameters
    ----------
    place
        The centre of the pen's tip, or the point of a pen that was drawn out.
    whole
        Up to where profiles across the line are whole.
    sigma
        Standard deviation of the place along the line [px].
    fall
        Pixels over which the ink of a drawn out pen falls from full to nothing; 0 of a blunt end.
    continues
        Whether faint ink goes on beyond the end, as under a veil.
    """

    place: float
    whole: float
    sigma: float
    fall: float
    continues: bool


def find_ends(profiles: Profiles, valid: Flags, noisy: bool) -> tuple[End, End]:
    """The first and the last end of a line.

    profiles: read across a path of M points that reaches beyond both ends
    valid: (M,) bool, where the line was seen
    noisy: whether the picture's colour is noisy, as that of JPEG is
    """
    visible = np.flatnonzero(valid)
    last = len(valid) - 1
    pen = *_pen_width(profiles, valid), noisy
    mass, coverage = profiles.mass[::-1], profiles.coverage[::-1]
    backwards = replace(profiles, mass=mass, coverage=coverage)
    first = _find_end(backwards, int(last - visible[0]), *pen)
    first = replace(first, place=last - first.place, whole=last - first.whole)
    return first, _find_end(profiles, int(visible[-1]), *pen)


def _pen_width(profiles: Profiles, valid: Flags) -> tuple[float, float]:
    """The pen's width without blur, and over how much its edge falls from high to low [px].

    The usual profile is that of an even pen, blurred by a Gaussian. A broad pen's profile is as
    wide as the pen at half of its height. The less broad the pen is beside the blur, the more of
    that width is blur, and the longer is the edge beside it.
    """
    usual = symmetric(np.median(profiles.coverage[valid], axis=0))[len(profiles.x) // 2 :]
    usual = usual / max(float(usual.max()), 1e-6)
    high = _crossing(usual, int(usual.argmax()), HIGH)
    edge = (_crossing(usual, high, LOW) - high) * tuned.STEP_PX
    width = 2 * _crossing(usual, high, tuned.HALF) * tuned.STEP_PX
    edges, shares = _blurred_pens()
    # Ink that lies beside the path alone leaves no width at half height.
    share = float(np.interp(edge / max(width, 1e-6), edges, shares))
    return max(width * share, 1.0), edge  # No picture shows a line narrower than its pixels.


@cache
def _blurred_pens() -> tuple[Array, Array]:
    """Profiles of pens of many widths, each blurred by a Gaussian of 1 px.

    Two (N,) arrays, each over the profile's width at half of its height: how long its edge is from
    high to low, which rises, and how wide the pen is.
    """
    # From 20 blurs on, a pen's own width shows. With 60 pens and 100 places in each profile the
    # shares are right to 0.003, of the thinnest pens to 0.012.
    pens = np.linspace(20, 0, 60, endpoint=False)
    edges, shares = np.zeros(len(pens)), np.zeros(len(pens))
    erf_of = np.vectorize(erf)
    for k, pen in enumerate(pens):
        x = np.linspace(0, pen / 2 + 5, 100)  # A Gaussian has ended 5 deviations away.
        profile = erf_of((x + pen / 2) / sqrt(2)) - erf_of((x - pen / 2) / sqrt(2))
        profile = profile / profile[0]
        high, half, low = np.interp([-HIGH, -tuned.HALF, -LOW], -profile, x)
        edges[k] = (low - high) / (2 * half)
        shares[k] = pen / (2 * half)
    return edges, shares


def _find_end(profiles: Profiles, visible: int, pen_px: float, edge_px: float, noisy: bool) -> End:
    """The end of a line, from the ink that it shows along itself towards its last point.

    visible: the last point at which the line was seen
    pen_px, edge_px: of the pen, as `_pen_width` has them
    noisy: whether the picture's colour is noisy, as that of JPEG is
    """
    # A pressed pen has another width here than elsewhere, and may have rested at the end. Where it
    # rested the ink is a disc, broader than the line.
    # It is smoothed, so that noise leaves it one crossing of each level.
    ink = gaussian(profiles.mass, tuned.MASK_BLUR_PX)
    before = ink[max(visible - tuned.TANGENT_PX, 0) : visible + 1]
    level = max(float(np.median(before)), 1e-6)
    highest = before[-tuned.TANGENT_PX // 2 :].max()
    rested = highest > tuned.WIDE * min(level, 1.0)
    if rested:
        level = highest
    ink = ink / level
    width = pen_px * level
    noise = tuned.INK_NOISE_NOISY if noisy else tuned.INK_NOISE
    visible_ink = tuned.VISIBLE_SIGMAS * noise
    high = _crossing(ink, _last_high(ink, visible), HIGH)
    half = _crossing(ink, high, tuned.HALF)
    low = _crossing(ink, half, LOW)

    # The longest fall that a blunt end shows: the round of the tip, and what blurs it.
    blunt = tuned.BLUNT_PX + tuned.BLUNT_EDGES * edge_px + tuned.BLUNT_SHARE * pen_px
    inner = profiles.mass[tuned.TAPER_REACH_PX : visible + 1]
    rough = float(np.median(np.abs(inner - gaussian(inner, tuned.TREND_PX / 2))))
    blunt += tuned.BLUNT_ROUGH_PX * rough
    tapered = _taper_share(FALLS_PX, blunt)
    if not noisy:  # The ink close by is plain to see, and a pressed pen ends at once there.
        # From high to half the ink falls a part of the way; the whole fall is as steep.
        observed = _taper_share((half - high) / (HIGH - tuned.HALF), blunt)
        tapered = np.minimum(tapered, observed)

    # A tip that was cut off square, or is rounder than a half disc, ends elsewhere.
    flat, reach = (0.0, 1.0) if rested else _tip_shape(profiles, visible, width, noisy)

    # Each foot and each length of the fall counts by how well it fits the ink.
    foot = np.arange(half - 1, half + FALLS_PX[-1] / 2, tuned.STEP_PX)[:, None]
    likely = _likelihood(ink, low, foot, noise) * (1 - (1 - tuned.TAPER_PRIOR) * tapered)
    likely = likely / likely.sum()
    back = tuned.ROUND_SHARE * width * reach
    middle = np.clip(foot - FALLS_PX / 2, high, low)
    blunt_place = middle - back * (1 - flat)
    place = tapered * foot + (1 - tapered) * blunt_place
    mean = float((likely * place).sum())
    spread = (place - mean) ** 2 + tapered * (1 - tapered) * (foot - blunt_place) ** 2
    variance = float((likely * spread).sum())
    variance += flat * (1 - flat) * back**2 + tuned.END_SIGMA_PX**2

    is_drawn_out = (likely * tapered).sum() > tuned.HALF
    whole = _crossing(ink, half, visible_ink) if is_drawn_out else half
    beyond = max(int(np.ceil(mean + pen_px / 2 + tuned.FLANK_PX)), 0)
    ahead = ink[beyond : beyond + tuned.SUDDEN_PX]
    # More ink than `VISIBLE` is no faint one; the account lists it.
    reaches = len(ahead) == tuned.SUDDEN_PX
    continues = reaches and bool(visible_ink < np.median(ahead) <= tuned.VISIBLE)
    fall = float((likely * tapered * FALLS_PX).sum())
    return End(mean, whole, float(np.sqrt(variance)), fall, continues)


def _taper_share(fall: NDArray | float, blunt: float) -> NDArray | float:
    """How far falls of the ink are a drawn out pen's: 0 to 1, where `blunt` is a blunt end's."""
    return np.clip((fall / blunt - 1) / (tuned.TAPER_TIMES - 1), 0, 1)


def _likelihood(ink: NDArray, low: float, foot: NDArray, noise: float) -> Array:
    """(F, L) how likely a fall with each foot (F, 1) and length is, of ink with a noise.

    All of them add up to 1. The height from which the ink falls is fitted, and so is an even slope
    before, as of a pen that is pressed less and less.
    """
    first = max(int(low - FALLS_PX[-1]), 0)
    at = np.arange(first, min(int(low) + tuned.SUDDEN_PX, len(ink)))
    observed = ink[at]
    ahead = foot[..., None] - at
    fall = np.clip(ahead / FALLS_PX[:, None], 0, 1)
    slope = np.maximum(ahead - FALLS_PX[:, None], 0)
    # Least squares for the height and the slope.
    ff, fs, ss = (fall**2).sum(2) + 1e-9, (fall * slope).sum(2), (slope**2).sum(2) + 1e-9
    fy, sy = fall @ observed, slope @ observed
    determinant = ff * ss - fs**2
    height = (ss * fy - fs * sy) / determinant
    steep = (ff * sy - fs * fy) / determinant
    misfit = observed - height[..., None] * fall - steep[..., None] * slope
    squares = (misfit**2).sum(2)
    spread = tuned.INK_HANGS_PX * max(noise**2, squares.min() / len(at))
    likely = np.exp((squares.min() - squares) / (2 * spread))
    return likely / likely.sum()


def _tip_shape(profiles: Profiles, visible: int, width: float, noisy: bool) -> tuple[float, float]:
    """The shape of a tip that is as wide as `width`, as far as a thin pen shows it.

    Returns how surely the tip was cut off square (0 to 1), and how far a round tip reaches, over
    how far a half disc as broad as the line reaches.

    A round tip ends earlier at its sides than in its middle, a tip that was cut off square does
    not, and a drawn out one ends far earlier. A tip whose disc is smaller than the line is broad,
    as OpenCV draws it, falls back farther than a half disc. Both sides are averaged, so that a line
    that does not leave its tip at a right angle looks the same.
    """
    side = tuned.TIP_SIDE
    band = tuned.TIP_BAND * width
    bands = (0, band + tuned.STEP_PX / 2), (-side * width, band), (side * width, band)
    middle, left, right = (
        _end_of_band(profiles.coverage, visible, np.abs(profiles.x - at) <= half)
        for at, half in bands
    )
    if middle is None or left is None or right is None:
        return 0.0, 1.0
    falls_back = max((middle - (left + right) / 2) / width, 1e-6)
    flat = float(np.clip(2 - falls_back / tuned.ROUND_BACK, 0, 1))
    # The radius of the disc through the middle of the tip and both sides; half of the line's ink
    # is left where that disc is half as broad as the line.
    radius = np.clip((side**2 + falls_back**2) / (2 * falls_back), 1 / 4, 1 / 2)
    reach = np.sqrt((radius**2 - 1 / 16) / (1 / 4 - 1 / 16))
    from_width = tuned.FLAT_WIDTH_NOISY_PX if noisy else tuned.FLAT_WIDTH_PX
    shows = float(np.clip((width - from_width) / tuned.FLANK_PX, 0, 1))
    reach = float(1 - (1 - reach) * shows)
    return flat * shows, reach


def _end_of_band(coverage: NDArray, visible: int, band: Flags) -> float | None:
    """Where half of the ink is left in a band along the line; `None` in an empty band."""
    if not band.any():
        return None
    ink = gaussian(coverage[:, band].mean(1), tuned.MASK_BLUR_PX)
    before = ink[max(visible - tuned.TANGENT_PX, 0) : visible + 1]
    ink = ink / max(float(np.median(before)), 1e-6)
    return _crossing(ink, _last_high(ink, visible), tuned.HALF)


def _last_high(ink: NDArray, visible: int) -> int:
    """The last point up to `visible` at which the ink is `HIGH`."""
    above = np.flatnonzero(ink[: visible + 1] >= HIGH)
    return int(above[-1]) if len(above) else visible


def _crossing(ink: NDArray, start: float, level: float) -> float:
    """Where the ink first falls below a level, from `start` on."""
    first = int(start)
    below = np.flatnonzero(ink[first:] < level)
    if len(below) == 0:
        return float(len(ink) - 1)
    k = first + int(below[0])
    return float(start) if k == first else k - (level - ink[k]) / max(ink[k - 1] - ink[k], 1e-9)
