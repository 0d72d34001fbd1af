"""Where a line was begun and where it was lifted.

A round pen leaves a half disc beyond the centre line's end, one that is cut flat leaves nothing
("butt" caps) or half a square ("square", "projecting" caps). Both are fitted to the pixels around
either end: to the coverage and, where that is coarse, as JPEG's colour is, to the brightness too,
which is kept sharp. What speaks for either decides how far the centre line stops short of the ink.
Where the picture cannot tell, the answer lies between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.curve.light import LUMINANCE, is_coarse, without_ground
from vfplan.curve.path import extended, normals
from vfplan.curve.pen import Pen, sample_pixels
from vfplan.curve.profile import STEP_PX as PROFILE_STEP_PX
from vfplan.curve.profile import Profiles
from vfplan.curve.tip import Around, Tip, misfit

# How far a centre line is taken to end before the ink's own [px]. Programs that draw may run on by
# the last step of the hand, up to 2 px, so a round end lies where it is good with either habit, and
# further back for thin pens, which may pass for flat. A flat cut hides more: butt and square caps
# look the same.
FLAT_PX, EARLY_PX = 1.1, ((2.2, 3.0), (1.0, 0.78))
ROUND = 0.44  # log odds for a round pen before anything was seen: most programs draw with one
HALF_DISC = 0.85  # of its radius: where a round end's ink falls to half the width
SEARCH_PX, TRIAL_PX = 2.5, 0.1
# Of a pen drawn out to a point, so much coverage is seen surely, and the rest follows; a blunt end
# has lost it so soon, in clean pictures and where JPEG's noise goes on.
POINT, BLUNT_PX, SHORT = (0.3, 0.2), (4.0, 6.0), 3
# Of the usual ink: so little, so much less than nearer to the end, within so many pixels of it;
# more than so much there is an arrow's head.
THINNED, BREAK, BREAK_PX, HEAD = 0.75, 0.55, 14, 2.2
# A dot at an end: so many widths across, how round, how long; and the points over which it begins.
BLOT, ROUNDISH, LONGEST_BLOT, ABRUPT = 1.4, 0.25, 6.0, 3
BEYOND_PX = 4  # further than the path was read: ground there tells ink from none
BROAD_PX = 5.0  # a pen this wide hides how the line bends at its end, which tilts its cut:
BENDS = np.linspace(-0.06, 0.06, 7)  # by so much more than the path does [1/px]
COARSE = 5  # trial ends at a time when bends are compared
HALVES = np.arange(0.55, 1.16, 0.05)  # of the mask's width: JPEG's colour makes a thin line wide
# Pixels whose misfit hangs together: in JPEG's colour, in its brightness over bones, and without.
ALIKE_COLOUR, ALIKE_LIGHT, ALIKE_CLEAN = 14.0, 6.0, 1.0
FAINTEST, FAINTEST_GREY = 0.01, 1.0  # of full coverage, and of 255: no model is better
BESIDE_PX = 5.0
CLEAR, LEAST = 1.0, 8  # a line stands out of its flanks' roughness by so much, in so many profiles
MIDDLE_PX = 0.5


def ink_ends(profiles: Profiles, valid: NDArray) -> tuple[float, float]:
    """Where the coverage summed across the line falls to one half, as indices into the path.

    profiles: what was read across a path that reaches beyond both ends, about a point a pixel
    valid: (M,) bool, where the line was seen
    """
    on, last = np.flatnonzero(valid), len(valid) - 1
    return last - _half(profiles.mass[::-1], last - on[0]), _half(profiles.mass, on[-1])


def points_of(profiles: Profiles, used: NDArray) -> tuple[float, float]:
    """How far ink goes on beyond half of the line's coverage, at both ends [px].

    A pen that is drawn out to a point does so, and one that was pressed less at its end. Where the
    ink still shows at the end of what was read, it goes on at least so far. A tint is no ink.
    """
    blunt = BLUNT_PX[profiles.noisy]
    return tuple(_point(mass, at, blunt) for mass, at in _outward(profiles, used))


def fading_ends(profiles: Profiles, used: NDArray) -> tuple[bool, bool]:
    """Whether ink still shows at either end of what was read, though no point was found there."""
    beyond = (mass[int(np.ceil(_half(mass, at))) :] for mass, at in _outward(profiles, used))
    pairs = zip(beyond, points_of(profiles, used), strict=True)
    return tuple(len(m) > SHORT and m.min() >= POINT[1] and not found for m, found in pairs)


def broken_ends(profiles: Profiles, used: NDArray, width: float) -> tuple[bool, bool]:
    """Whether the ink all but stops shortly before either end, and comes back: it may be a sign's.

    A letter that touches the line's end is thinner, forks and bends; a pen's own end does not.
    """
    first, last = np.flatnonzero(used)[[0, -1]]
    found = []
    for turn, at in ((-1, len(used) - 1 - first), (1, last)):
        mass, seen = profiles.mass[::turn], profiles.seen.all(1)[::turn]
        end = int(_half(mass, int(at)))
        run = slice(end, max(end - int(width / 2) - BREAK_PX, 0), -1)
        beyond = np.maximum.accumulate(mass[run])
        thin = seen[run] & (mass[run] < THINNED) & (beyond < HEAD)
        found.append(bool((thin & (mass[run] < beyond - BREAK)).any()))
    return found[0], found[1]


def _outward(profiles: Profiles, used: NDArray) -> tuple[tuple[NDArray, int], ...]:
    """The line's own coverage, without a tint's, towards both ends; the last point used of each."""
    first, last = np.flatnonzero(used)[[0, -1]]
    tint = np.minimum(profiles.alpha[:, :2].min(1), profiles.alpha[:, -2:].min(1)).clip(0.0)
    line = (profiles.alpha - tint[:, None]).clip(0.0).sum(1)
    mass = np.minimum(profiles.mass, line / np.median(line[used]))
    return (mass[::-1], int(len(used) - 1 - first)), (mass, int(last))


def _point(mass: NDArray, at: int, blunt: float) -> float:
    half = _half(mass, at)
    beyond = mass[int(np.ceil(half)) :]
    thinner, thin = (int(np.argmax(np.r_[beyond, 0.0] < share)) for share in POINT)
    return thin + POINT[1] / (POINT[0] - POINT[1]) * (thin - thinner) if thin > blunt else 0.0


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
    rgb: NDArray, line: NDArray, used: NDArray, profiles: Profiles, pen: Pen, width: float
) -> tuple[float, float]:
    """Both ends of the centre line itself, as float indices into the path it was read along.

    A line that is drawn out to a point may end beyond the path.

    rgb: (H, W, 3) image
    line, used: (M, 2) the line as it was measured, a point for each of the path, and where it was
    profiles: what was read across the path
    pen, width: the pen, and the width of its mask [px]
    """
    last, inner = len(line) - 1, np.flatnonzero(used)[[0, -1]]
    views = _views(rgb, line, used, profiles, pen, width)
    path, back = _carried_on(line, *inner, width), slice(None, None, -1)
    seen = np.pad(profiles.seen, ((BEYOND_PX, BEYOND_PX), (0, 0)), mode="edge")
    start, stop = ink_ends(profiles, used)
    reach = np.array([last - start, last - inner[0], stop, inner[1]]) + BEYOND_PX
    head = _end(views, rgb, path[back], seen[back, back], *reach[:2])
    tail = _end(views, rgb, path, seen, *reach[2:])
    half = views[-1].tip.half
    short = np.array([FLAT_PX, np.interp(2 * half, *EARLY_PX)])
    odds = np.clip(head.flat_odds + tail.flat_odds - ROUND, -50, 50)
    share = np.array([1.0, np.exp(-odds)]) / (1 + np.exp(-odds))  # one pen drew both ends
    first, end = (float((found.places - short) @ share - BEYOND_PX) for found in (head, tail))
    first, end = min(first, last - start), min(end, stop)  # within the ink
    drawn_out = points_of(profiles, used)
    if drawn_out[0]:
        first = last - start + drawn_out[0]
    if drawn_out[1]:
        end = stop + drawn_out[1]
    dots = (
        blot_middle(profiles.mass[::-1], last - start, width),
        blot_middle(profiles.mass, stop, width),
    )
    first, end = (at if dot is None else dot for at, dot in zip((first, end), dots, strict=True))
    return last - first, end


def _carried_on(line: NDArray, first: int, last: int, width: float) -> NDArray[np.float64]:
    """(M + 2 `BEYOND_PX`, 2) what was measured of the line, carried on at both ends."""
    by = max(first, len(line) - 1 - last) + BEYOND_PX
    start = by - first - BEYOND_PX
    return extended(line[first : last + 1], by, width)[start : start + len(line) + 2 * BEYOND_PX]


@dataclass(frozen=True, eq=False)
class _View:
    """A value of pixels that shows the line: `rgb` @ `row`, and the pen's tip in it."""

    row: NDArray[np.float64]  # (3,)
    tip: Tip
    alike: float
    faintest: float


def _views(
    rgb: NDArray, line: NDArray, used: NDArray, profiles: Profiles, pen: Pen, width: float
) -> list[_View]:
    """The coverage, and where that is coarse the brightness as well."""
    x, normal, seen = profiles.x, normals(line, False), used[:, None] & profiles.seen
    colour, halves = pen.along / pen.strength, HALVES * width / 2
    mean = np.where(seen, profiles.alpha, 0.0).sum(0) / np.maximum(seen.sum(0), 1)
    mean = (mean + mean[::-1]) / 2
    off = (width + BESIDE_PX) * normal
    beside = sample_pixels(rgb, *np.moveaxis(np.stack([line - off, line + off], 1), 2, 0))
    if not is_coarse((beside @ colour)[used]):
        return [_View(colour, Tip.of_profile(x, mean, halves), ALIKE_CLEAN, FAINTEST)]
    u, v = line[:, :1] + normal[:, :1] * x, line[:, 1:] + normal[:, 1:] * x
    profile = _light_profile(x, sample_pixels(rgb, u, v) @ LUMINANCE, seen, width)
    if profile is None:
        return [_View(colour, Tip.of_profile(x, mean, halves), ALIKE_COLOUR, FAINTEST)]
    sharp = Tip.of_profile(x, profile, halves)
    blurred = Tip.of_profile(x, mean, np.array([sharp.half]))
    return [
        _View(colour, blurred, ALIKE_COLOUR, FAINTEST),
        _View(LUMINANCE, sharp, ALIKE_LIGHT, FAINTEST_GREY),
    ]


def _light_profile(x: NDArray, light: NDArray, seen: NDArray, width: float) -> NDArray | None:
    """(K,) the line's mean profile in (M, K) brightness; `None` where it does not stand out."""
    left, rough = without_ground(x, light, width)
    depth = left[:, np.abs(x) <= MIDDLE_PX].mean(1)
    clear = seen.all(1) & (np.abs(depth) > CLEAR * rough)
    if clear.sum() < LEAST:
        return None
    profile = (depth / rough**2)[clear] @ light[clear]
    return (profile + profile[::-1]) / 2


@dataclass(frozen=True, eq=False)
class _Found:
    """An end, as a row of the path: (2,) `places` if flat, if round; log odds for flat."""

    places: NDArray[np.float64]
    flat_odds: float


def _end(
    views: list[_View], rgb: NDArray, path: NDArray, seen: NDArray, ink: float, known: float
) -> _Found:
    """Where a path's line ends of which the ink ends near row `ink`; measured up to row `known`."""
    half = max(view.tip.half for view in views)
    around = Around.path(path, normals(path, False), ink, half, rgb.shape)
    around = around.where(_unhidden(around, seen))
    levels = rgb[around.v, around.u] * (255.0 / np.iinfo(rgb.dtype).max)
    trial = ink + np.arange(-SEARCH_PX, SEARCH_PX + TRIAL_PX / 2, TRIAL_PX)
    caps = np.stack([trial, trial - HALF_DISC * half])
    if half > BROAD_PX / 2:
        bent = [around.bent(known, bend) for bend in BENDS]
        doubts = [_doubt(views, each, levels, caps[:, ::COARSE]).min() for each in bent]
        around = bent[int(np.argmin(doubts))]
    doubt = _doubt(views, around, levels, caps)
    flat, disc = doubt.min(1)
    return _Found(caps[[0, 1], doubt.argmin(1)], float(disc - flat))


def _doubt(
    views: list[_View], around: Around, levels: NDArray, caps: NDArray
) -> NDArray[np.float64]:
    """(2, T) minus the log likelihood of ends at (2, T) `caps`, cut flat and round."""
    doubt = np.zeros(caps.shape)
    for view in views:
        value = levels @ view.row
        power = [misfit(view.tip, around, value, ends, cap > 0) for cap, ends in enumerate(caps)]
        count = len(value) / view.alike / 2
        noise = np.min(power) + view.faintest**2
        doubt += count * (np.array(power) / noise + np.log(noise))
    return doubt


def _unhidden(around: Around, seen: NDArray) -> NDArray[np.bool_]:
    """Which pixels lie where (M, K) profiles were `seen`."""
    rows, count = seen.shape
    row = np.clip(np.rint(around.s).astype(int), 0, rows - 1)
    place = np.rint(around.x / PROFILE_STEP_PX).astype(int) + count // 2
    return seen[row, np.clip(place, 0, count - 1)]


def _half(mass: NDArray, at: int) -> float:
    """Where the mass falls to one half, going on from `at`."""
    while at > 0 and mass[at] < 0.5:
        at -= 1
    while at + 1 < len(mass) and mass[at + 1] >= 0.5:
        at += 1
    if at + 1 >= len(mass):
        return float(at)
    return at + (mass[at] - 0.5) / max(mass[at] - mass[at + 1], 1e-9)
