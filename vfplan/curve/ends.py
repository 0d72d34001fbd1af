"""Where a line was begun and where it was lifted.

A round pen leaves a half disc beyond the centre line's end, one that is cut flat leaves nothing
("butt" caps) or half a square ("square", "projecting" caps). Both are fitted to the pixels there;
what speaks for either tells how far the centre line stops short of the ink. Where the picture
cannot tell, the answer lies between.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.pen import Pen
from vfplan.curve.point import Point
from vfplan.curve.profile import Profiles
from vfplan.curve.tip import Tip, fitted_tips

# How far a centre line is taken to end before the ink's own [px]. Programs that draw may run on by
# the last step of the hand, up to 2 px, so a round end lies where it is good with either habit, and
# further back for thin pens, which may pass for flat. A flat cut hides more: butt and square caps
# look the same.
FLAT_PX, EARLY_PX = 1.1, ((2.2, 3.0), (1.0, 0.78))
ROUND = 0.44  # log odds for a round pen before anything was seen: most programs draw with one
SHOWS = 0.25  # of the usual ink
# The square of a fall of the ink, over its usual change along the line and so much more; it begins
# where the line is full. A sign's strokes are so full for no more pixels, and a dot or an arrow's
# head has more ink. An end cut blunt falls within half a width and so many pixels.
FALL, EVEN, FULL, SIGN_PX, HEAD, BLUNT = 0.75, 0.03, 0.8, 14, 2.2, 3
# Log odds: of a form that is surely the pen's own, of a cut beside such an end, and of a slanting
# cut by itself, which the end of a jagged line may seem.
SURE, CUT, SLANTED = 8.0, 12.0, 20.0
THINNEST_PX = 1.5  # of a thinner pen no pixel shows how it is cut
UNTAPERED = 0.9  # of the usual ink
CUT_OFF = (
    "is cut off flat or on a slant, as this pen's own ends are not: something may hide the rest"
)
ODD = (
    CUT_OFF,
    "lies beyond a place where the ink grows thinner at once, or all but stops: a sign that "
    "touches the end there, or another pen's line, may be no part of it",
)
UNSURE_PX = 1.5  # of where a line ends: more is told
SURELY_OFF_PX = 1.0  # beyond the border: less may be a round end that touches it
# A dot at an end: so many widths across, how round, how long; and the points over which it begins.
BLOT, ROUNDISH, LONGEST_BLOT, ABRUPT = 1.4, 0.25, 6.0, 3


class LineEnds(NamedTuple):
    """The (first, last) end of a line."""

    # Indices into the path; a line that is drawn out to a point may end beyond it
    places: tuple[float, float]
    # Whether it is cut off as no pen's own end is: one pen draws both alike, and none on a slant
    cut: tuple[bool, bool]
    own: tuple[bool, bool]  # whether it is surely the pen's own: round, a dot, or a point
    unsure: tuple[float, float]  # standard deviation of where it is, by points alone [px]


def ink_ends(profiles: Profiles, valid: NDArray) -> tuple[float, float]:
    """Where the coverage summed across the line falls to one half, as indices into the path.

    profiles: what was read across a path that reaches beyond both ends, about a point a pixel
    valid: (M,) bool, where the line was seen
    """
    on, last = np.flatnonzero(valid), len(valid) - 1
    return last - _half(profiles.mass[::-1], last - on[0]), _half(profiles.mass, on[-1])


def stepped_ends(
    profiles: Profiles, used: NDArray, width: float, places: tuple[float, float]
) -> tuple[bool, bool]:
    """Whether the ink falls at once towards either end, and then goes on up to its `places`.

    A pen that is lifted, drawn out or pressed less grows thinner along its way. A letter that the
    end runs into, and another pen's line, is thinner at once, and the ink may all but stop there.
    """
    from scipy.ndimage import uniform_filter1d

    first, last = np.flatnonzero(used)[[0, -1]]
    off, rows = np.abs(profiles.x), np.arange(len(used))
    ink = profiles.alpha[:, off <= (width + 1) / 2].clip(0.0).sum(1)
    seen = profiles.seen[:, off < width / 2].all(1) & (profiles.clipped == 0) | used
    ink = np.interp(rows, rows[seen], ink[seen]) / max(np.median(ink[used]), 1e-6)
    beyond = np.maximum(places[0] - rows, rows - places[1])
    ink[beyond > width / 2 + 1] = 0.0  # what the line does not reach
    if profiles.noisy:
        ink = uniform_filter1d(ink, 3, mode="constant")
    reach = round(width / 2) + BLUNT
    whole = ink[first : last + 1]
    changes = np.abs(whole[reach:] - whole[:-reach])
    usual = EVEN + (np.quantile(changes, 0.75) if len(changes) else 0.0)
    lines = ((ink[::-1], profiles.mass[::-1]), (ink, profiles.mass))
    return tuple(_fall(*line, reach) ** 2 > FALL * usual for line in lines)


def _fall(ink: NDArray, mass: NDArray, reach: int) -> float:
    """The most by which ink falls over up to `reach` points, and does not over as many more."""
    most, heads = (np.maximum.accumulate(values[::-1])[::-1] for values in (ink, mass))
    full = np.cumsum((ink >= FULL)[::-1])[::-1]
    deepest = 0.0
    for n in range(2, reach + 1):
        before, after, beyond = np.minimum(ink[: -2 * n], 1.0), ink[n:-n], most[2 * n :]
        fall = np.minimum(before - after, before - after - 2 * (after - beyond))
        sign = (beyond >= SHOWS) & (full[n:-n] <= SIGN_PX) & (heads[: -2 * n] <= HEAD)
        deepest = max(deepest, fall[sign & (before >= FULL)].max(initial=0.0))
    return float(deepest)


def told_ends(*odd: tuple[bool, bool]) -> tuple[tuple[str, ...], ...]:
    """What of `ODD` is true of either end, from a pair of flags for each."""
    at_ends = zip(*odd, strict=True)
    return tuple(tuple(w for w, f in zip(ODD, flags, strict=True) if f) for flags in at_ends)


def unsure_end(sigma: float) -> tuple[str, ...]:
    """What is said of an end whose place is known to `sigma` px only, if that is too much."""
    told = f"is drawn out: where it ends is unsure by {sigma:.0f} px"
    return (told,) if sigma > UNSURE_PX else ()


def blot_middle(mass: NDArray, ink: float, width: float) -> float | None:
    """The middle of a dot in which (M,) coverage across a line ends at `ink`; `None` for none.

    A dot's chords are longest in its middle; an arrow's head, whose tip is the end, is none.
    """
    wide = np.flatnonzero(mass[: int(ink) + 1] > BLOT)
    if not len(wide):
        return None
    run = wide[np.flatnonzero(np.diff(wide, prepend=-2) > 1)[-1] :]
    middle, half = (run[0] + run[-1]) / 2, (run[-1] - run[0] + 1) / 2
    radius = np.hypot(half, BLOT * width / 2)
    round_one = abs(ink - middle - radius) < ROUNDISH * radius + 1.0
    abrupt = mass[max(run[0] - ABRUPT, 0)] < (1 + BLOT) / 2  # a pen pressed harder grows slowly
    return float(middle) if round_one and abrupt and len(run) < LONGEST_BLOT * width else None


def line_ends(
    rgb: NDArray,
    path: NDArray,
    used: NDArray,
    profiles: Profiles,
    pen: Pen,
    points: tuple[Point, Point],
) -> LineEnds:
    """Both ends of the centre line itself.

    rgb: (H, W, 3) image
    path, used: (M, 2) points of the line, about one a pixel, to beyond both ends, and (M,) where it
        was measured
    profiles: what was read across it
    points: what speaks for either's being drawn out beyond its ink
    """
    last, inks = len(path) - 1, ink_ends(profiles, used)
    tips, outward = fitted_tips(rgb, path, used, profiles, pen, inks), (last - inks[0], inks[1])
    both = list(zip((profiles.mass[::-1], profiles.mass), outward, strict=True))
    dots = [blot_middle(mass, ink, profiles.width) for mass, ink in both]
    off = [_off(rgb, *line) for line in zip((path[::-1], path), outward, strict=True)]
    told = [tip.flat_odds for tip, beyond in zip(tips, off, strict=True) if not beyond]
    odds = np.clip(sum(told) - ROUND, -50, 50)
    flat = 1 / (1 + np.exp(-odds))  # how likely; one pen drew both ends
    found, unsure = [], []
    for ink, point, dot, tip, beyond in zip(outward, points, dots, tips, off, strict=True):
        round_at = tip.round_at - np.interp(2 * tip.half, *EARLY_PX)
        end = min(flat * (tip.flat_at - FLAT_PX) + (1 - flat) * round_at, ink)  # within the ink
        end = ink if beyond else end
        end = end if dot is None else dot
        found.append(ink + point.beyond if point.drawn_out else end)
        unsure.append(0.0 if beyond or dot is not None else point.unsure(end - ink))
    drawn = any(dot is not None or point.drawn_out for dot, point in zip(dots, points, strict=True))
    whole = profiles.width >= THINNEST_PX and not drawn and not profiles.clipped.any()
    abrupt = not any(_tapers(mass, ink, profiles.width) for mass, ink in both)
    cut = _cut(tips) if whole and abrupt else (False, False)
    own = (
        dot is not None or point.surely(profiles.width) or bool(tip.cut_odds <= -SURE)
        for dot, point, tip in zip(dots, points, tips, strict=True)
    )
    return LineEnds((last - found[0], found[1]), cut, tuple(own), tuple(unsure))


def _off(rgb: NDArray, path: NDArray, ink: float) -> bool:
    """Whether a line runs out of the picture: its end is the border, and no pixel shows the pen's.

    The outermost pixels are read on beyond it, so that its ink seems to end there.
    """
    place = np.array([np.interp(ink - SURELY_OFF_PX, np.arange(len(path)), at) for at in path.T])
    room = np.minimum(place, np.array(rgb.shape[1::-1]) - 1 - place)
    return bool(room.min() <= -0.5)


def _tapers(mass: NDArray, ink: float, width: float) -> bool:
    """Whether the ink falls to its half more slowly than by a cut on a slant of 60°."""
    begins = np.flatnonzero(mass[: int(ink) + 1] >= UNTAPERED).max(initial=0)
    return bool(ink - begins > (UNTAPERED - 0.5) * np.tan(np.pi / 3) * width + 1.0)


def _cut(tips: tuple[Tip, Tip]) -> tuple[bool, bool]:
    return tuple(
        bool((tip.cut_odds >= CUT and -other.cut_odds >= SURE) or tip.slant_odds >= SLANTED)
        for tip, other in (tips, tips[::-1])
    )


def _half(mass: NDArray, at: int) -> float:
    """Where the mass falls to one half, going on from `at`."""
    while at > 0 and mass[at] < 0.5:
        at -= 1
    while at + 1 < len(mass) and mass[at + 1] >= 0.5:
        at += 1
    if at + 1 >= len(mass):
        return float(at)
    return at + (mass[at] - 0.5) / max(mass[at] - mass[at + 1], 1e-9)
