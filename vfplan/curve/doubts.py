"""What may be wrong with a measured curve: an opening, a bar, runs side by side.

None of it proves the curve wrong, so it is told with its pixels; only two runs that surely lie side
by side are refused: they would be measured midway.

A pen changes its strength with its opacity and with the ground under it, its width it keeps. So a
place counts as wide by the smaller of two ratios to the line's usual: of the coverage summed across
the line, its mass, and of that sum over the profile's peak. JPEG blurs the profile so that its peak
falls with its width, and only the mass still tells: one that speaks for `BESIDE_PX` is doubted
where the other ratio rises at all. A pen that is pressed changes its width all along; where a
second line begins, it changes at once.

Several lines side by side all along are no wider run: their profile has a valley. A single pen's
has one hill. A spiral's turns drift across the path, so the profiles are averaged over short runs,
and the median of all runs speaks for the line: in the coverage where the picture is clean, and in
the brightness where JPEG's coarse colour fills the valley.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.candidates import Candidate, angle_deg, inked_ends
from vfplan.curve.path import normals, runs
from vfplan.curve.pen import Pen
from vfplan.curve.profile import Profiles
from vfplan.errors import CurveError

AHEAD_DEG = 60.0  # between an end's direction and the way to what may carry it on
NEAR_GAPS, NEAR_SHARE = 3.0, 0.1  # of the longest gap bridged, of the length: nearly closed
BAR_PX, BAR_DEG, BAR_ASIDE = 5.0, 8.0, 0.04  # width, hue, share of its length: a chart's bar
MOST_LIFTS = 2  # a ring drawn with more is no C

RUN, LEAST_RUN = 4.0, 12  # widths, points: a corner or a blot is shorter
DOUBTED, REFUSED = (1.1, 1.25), (1.3, 1.35)  # in clean pictures, in those with JPEG's noise
USUAL = 0.35  # quantile: a second line may run beside most of this one
BLOT, BLOT_PX, DOT = 4.5, 40.0, 1.25  # widths, px: so short a run, somewhere so wide, is a dot
BLOT_DOUBT = 0.06  # of its width beyond the line's: how far beside its middle the line may run
BESIDE_PX = 0.65  # between two runs: the line midway is 0.3 px off either
OUTLIER = 4.0  # times the spread of the line's mass
AT_ONCE = 4.0  # times the line's usual change over 12 points: another begins there
BEND_POINTS = 5  # of the path, about a pixel apart
TIGHT = 0.5  # of a bend's radius, a profile's reach: more, and it sees the bend's other side
RISEN = (1.04, 1.05)  # of mass over peak, at least, where the mass alone speaks for two runs
LEAST_PX = 3.0  # narrower is no two lines that could be seen apart
STRETCH = 24  # points, about a pixel apart
COVERAGE, BRIGHTNESS = (0.08, 0.12), (0.08, 0.16)  # of the hill: doubted, refused
CLEAR = 10.0  # times the ground's roughness over a run: there the brightness counts
LEAST_GREY = 25.0  # levels between line and ground: JPEG's ringing is no valley in more
EDGE_PX = 1.0  # of the line left out of the brightness: a dark outline reaches in so far

Verdict = Literal["single", "doubted", "several"]


def nearly_closed(line: Candidate, mask: NDArray[np.bool_], max_gap_px: float) -> list[str]:
    """A warning for a short opening between a line's ends, whether it was closed or left open."""
    gaps = list(runs(line.bridged, True)) if line.closed else []
    if 0 < len(gaps) <= MOST_LIFTS:  # of a ring with few lifts, any may be its opening
        run = max(gaps, key=len)
        u, v = line.path[run[len(run) // 2]]
        return [
            f"a gap of about {len(run):.0f} px at ({u:.0f}, {v:.0f}) was bridged, which closes the "
            "curve; a smaller --max-gap leaves it open"
        ]
    ends = inked_ends(line, mask)
    if len(ends) < 2:
        return []
    (a, from_a), (b, from_b) = ends
    missing = float(np.hypot(*(b - a)))
    if missing > max(NEAR_GAPS * max_gap_px, NEAR_SHARE * line.length_px) or missing <= 0:
        return []
    if max(angle_deg(from_a, b - a), angle_deg(from_b, a - b)) > AHEAD_DEG:
        return []
    (u, v), (p, q) = a, b
    return [
        f"the curve is nearly closed: {missing:.0f} px are missing between ({u:.0f}, {v:.0f}) and "
        f"({p:.0f}, {q:.0f})"
    ]


def a_bar(line: Candidate, pen: Pen) -> list[str]:
    """A warning for a broad line along a row or column whose hue is not quite the pen's."""
    if line.closed or line.width_px < BAR_PX or angle_deg(line.mark.pen.along, pen.along) < BAR_DEG:
        return []
    if np.ptp(line.path, axis=0).min() > BAR_ASIDE * line.length_px:
        return []
    u, v = line.path[len(line.path) // 2]
    return [
        f"the line at ({u:.0f}, {v:.0f}), {line.width_px:.0f} px wide, runs straight along a row "
        "or column, in a hue that is not quite the pen's: it may be a chart's bar"
    ]


def several(line: Candidate, single: bool) -> list[str]:
    """A warning where two lines may lie side by side all along."""
    if single:
        return []
    return [
        f"the line's profile, {line.width_px:.1f} px wide, sinks in its middle: if it is two lines "
        "side by side, it is measured midway between them"
    ]


def side_by_side(line: Candidate, widest: Widening | None, accepted: bool) -> list[str]:
    """A warning where two runs may lie side by side; raises `CurveError` where they surely do.

    An arrow was named by somebody who saw its head.
    """
    if widest is None or not widest.doubted:
        return []
    u, v = widest.place
    what = f"the line is {widest.ratio:.2f} times as wide as elsewhere around ({u:.0f}, {v:.0f})"
    if widest.refused and line.kind != "arrow" and not accepted:
        raise CurveError(
            f"{what}: it touches itself or another there, and which way it runs would be a guess; "
            "if the pen was pressed harder there, --accept-width takes it",
            where=f"pixel ({u:.0f}, {v:.0f})",
        )
    return [f"{what}: if two runs touch there, they are measured midway between them"]


@dataclass(frozen=True, eq=False)
class Widening:
    """The widest run of a line."""

    ratio: float  # its width over the line's own median
    place: tuple[float, float]  # (u, v) of its middle [px]
    # Whether this may be, or surely is, no single run of the pen
    doubted: bool
    refused: bool
    # (M,) how far from either run the line may be measured, where it is doubted, or from the line
    # itself in a dot on it [px]; else 0
    doubt: NDArray[np.float64]


def widest_run(
    profiles: Profiles, base: NDArray, valid: NDArray, width: float, closed: bool
) -> Widening:
    """The widest run of 4 widths along a (M, 2) path, where (M,) `valid` says it was seen."""
    from scipy.ndimage import binary_propagation, maximum_filter1d, uniform_filter1d

    seen = np.where(profiles.seen, np.clip(profiles.alpha, 0.0, None), 0.0)
    mass = seen.sum(1)
    across = mass / np.maximum(seen.max(1), 1e-6)
    count = min(max(LEAST_RUN, round(RUN * width)), len(base))
    mode = "wrap" if closed else "nearest"
    touched = maximum_filter1d(profiles.doubt, count, mode=mode) > 0  # its blur widens the edge
    clear = valid & ~touched if (valid & ~touched).any() else valid
    mass, across = (values / np.quantile(values[clear], USUAL) for values in (mass, across))
    blots = _blots(np.minimum(mass, across), min(BLOT * width, BLOT_PX))
    plain = clear & ~blots
    both, mean, across = (
        uniform_filter1d(np.where(plain, values, 1.0), count, mode=mode)
        for values in (np.minimum(mass, across), mass, across)
    )
    noisy = profiles.noisy
    # A pen whose strength changes at once raises its mass, and in JPEG what is across, a little.
    more, risen = (v / np.median(v[plain]) if plain.any() else v for v in (mean, across))
    by_mass = (width * (more - 1) > BESIDE_PX) & (risen > RISEN[noisy])
    by_mass &= more - 1 > OUTLIER * 1.48 * float(np.median(np.abs(more - np.median(more))))
    by_mass &= maximum_filter1d(_turn(base, closed), count, mode=mode) * profiles.x[-1] < TIGHT
    at_once = _changes_at_once(uniform_filter1d(1.0 * plain, count, mode=mode), both)
    wide = (width * (both - 1) > BESIDE_PX / 2) & at_once
    doubted = (wide & (both > DOUBTED[noisy])) | by_mass
    refused = bool((wide & (both > REFUSED[noisy])).any())
    ratio = both if refused else np.where(by_mass, more, both)
    at = int(np.where(doubted, ratio, 0.0).argmax() if doubted.any() else ratio.argmax())
    # From where it is doubted on, as far as the mass speaks for it at all.
    aside = width * (np.maximum(ratio, more) - 1) / 2
    near = binary_propagation(doubted, mask=doubted | (aside > BESIDE_PX / 4))
    doubt = maximum_filter1d(np.where(near, aside, 0.0), count, mode=mode)
    doubt = np.maximum(doubt, np.where(blots, BLOT_DOUBT * width * (mass - 1), 0.0))
    place = (float(base[at, 0]), float(base[at, 1]))
    return Widening(float(ratio[at]), place, bool(doubted.any()), refused, doubt)


def _changes_at_once(whole: NDArray, values: NDArray) -> bool:
    """Whether a width changes at once somewhere, between places that are `whole`.

    A pen that is pressed, or fades, varies all along.
    """
    both = (whole[LEAST_RUN:] > 1 - 1e-6) & (whole[:-LEAST_RUN] > 1 - 1e-6)
    change = np.abs(values[LEAST_RUN:] - values[:-LEAST_RUN])[both]
    return bool(len(change) and change.max() > AT_ONCE * np.median(change))


def _blots(ratio: NDArray, longest: float) -> NDArray[np.bool_]:
    """(M,) what is wide over a short run only: a dot, a glyph, an arrow's head on the line."""
    blots = np.zeros(len(ratio), bool)
    for run in runs(ratio > DOUBTED[0], False):
        blots[run] = len(run) <= longest and ratio[run].max() > DOT
    return blots


def _turn(base: NDArray, closed: bool) -> NDArray[np.float64]:
    """(M,) curvature of the path [1/px], over a few pixels."""
    from scipy.ndimage import uniform_filter1d

    normal = normals(base, closed)
    ahead = np.roll(normal, -1, 0)
    sine = normal[:, 0] * ahead[:, 1] - normal[:, 1] * ahead[:, 0]
    if not closed:
        sine[-1] = 0.0
    return np.abs(uniform_filter1d(sine, BEND_POINTS, mode="wrap" if closed else "nearest"))


def lines_in(profiles: Profiles, valid: NDArray, width: float) -> Verdict:
    """Whether a line is several side by side all along, as its (M,) `valid` profiles show it."""
    if width <= LEAST_PX or valid.sum() < STRETCH:
        return "single"
    x = profiles.x
    share = _mean(valid.astype(float))
    alpha = np.where(profiles.seen & valid[:, None], profiles.alpha, 0.0)
    mean = _mean(alpha) / np.maximum(share, 1 / STRETCH)[:, None]
    hill = np.maximum(mean.max(1), 1e-3)
    coverage = float(np.median(_valley(mean[:, np.abs(x) <= width / 2])[valid] / hill[valid]))
    brightness = _by_light(profiles, valid, width)
    found = ((coverage, COVERAGE), (brightness, BRIGHTNESS))
    if any(depth > refused for depth, (_, refused) in found):
        return "several"
    return "doubted" if any(depth > doubted for depth, (doubted, _) in found) else "single"


def _by_light(profiles: Profiles, valid: NDArray, width: float) -> float:
    """The valley of the brightness less the ground; 0 where unclear."""
    x, left, rough = profiles.x, profiles.light, profiles.rough
    depth = left[:, np.abs(x) <= width / 2].mean(1)
    weight = np.where(valid, depth / rough**2, 0.0)
    power = _mean(weight * depth)
    mean = _mean(weight[:, None] * left) / np.maximum(power, 1e-9)[:, None]
    clear = valid & (power * STRETCH > CLEAR**2) & (_mean(np.abs(depth)) > LEAST_GREY)
    inner = np.abs(x) <= width / 2 - EDGE_PX
    return float(np.median(_valley(mean[clear][:, inner]))) if clear.sum() >= STRETCH else 0.0


def _valley(profiles: NDArray) -> NDArray[np.float64]:
    """(M,) how far each of (M, K) profiles sinks between two hills."""
    left = np.maximum.accumulate(profiles, axis=1)
    right = np.maximum.accumulate(profiles[:, ::-1], axis=1)[:, ::-1]
    return (np.minimum(left, right) - profiles).max(1)


def _mean(values: NDArray) -> NDArray[np.float64]:
    """Along the line, over runs of it."""
    from scipy.ndimage import uniform_filter1d

    return uniform_filter1d(values, STRETCH, axis=0, mode="nearest")
