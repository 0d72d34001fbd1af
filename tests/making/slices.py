"""Slices of the kinds that users make, each with the curve that is right; nothing here uses vfplan.

A kind is a function of a random generator that draws on a `Canvas` and returns the truth. `KINDS`
holds those with one right answer, for which neither a refusal nor a warning is wanted, and `TRAPS`
those of which an answer other than the truth must not come without a warning. `HIDDEN` holds
curves with a cover without colour over an end, a letter at it, or a dot beside: such a cover is
told by its edge and its evenness, not by its colour, so that some go unseen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps

import cv2
import numpy as np
from canvas import RASTERISERS, Canvas, rectangle
from drawing import anatomy, arc_of, at_arcs, blend, unit, wavy

SHAPE = (320, 380)
RED, YELLOW, ORANGE, MAGENTA = (255, 0, 0), (255, 255, 0), (255, 165, 0), (255, 0, 255)
CYAN, GREEN, BLUE = (0, 255, 255), (0, 200, 60), (40, 60, 200)
WHITE, BLACK = (255, 255, 255), (0, 0, 0)
OTHERS = (YELLOW, ORANGE, MAGENTA)


@dataclass
class Slice:
    """A drawn slice: (H, W, 3) uint8, and (M, 2) the true curve, `None` where there is none.

    `places` are (u, v) [px] where an answer other than a refusal needs a word.
    """

    kind: str
    seed: int
    rasteriser: str
    quality: int | None
    image: np.ndarray
    truth: np.ndarray | None
    closed: bool
    clear: bool
    places: list


@dataclass
class Family:
    """Kinds of slices, by name, that are begun in one way.

    `begin(kind, seed, rng)` gives the canvas and the quality of JPEG, `None` for PNG. A kind draws
    on the canvas and returns the true curve; with one that is closed or has places, these too.
    """

    clear: dict
    unclear: dict
    begin: Callable

    def draw(self, kind, seed):
        """The slice of a kind's name with this seed."""
        rng = np.random.default_rng([seed, *kind.encode()])
        canvas, quality = self.begin(kind, seed, rng)
        made = {**self.clear, **self.unclear}[kind](canvas, rng)
        truth, closed, *places = made if isinstance(made, tuple) else (made, False)
        image, clear = canvas.image(quality), kind in self.clear
        places = [*places[0]] if places else []
        return Slice(kind, seed, canvas.rasteriser, quality, image, truth, closed, clear, places)


def by_name(*kinds):
    return {kind.__name__.replace("_", " "): kind for kind in kinds}


def _begin(_kind, seed, rng):
    canvas = Canvas(anatomy(SHAPE, int(rng.integers(1000))), RASTERISERS[seed % len(RASTERISERS)])
    return canvas, (None, None, 90, 80)[seed % 4]


def hand(rng, closed=False, margin=0.2):
    """A smooth curve well inside the picture."""
    while True:
        curve = wavy(SHAPE, int(rng.integers(1 << 30)), closed, margin=margin, count=1200)
        if (curve > 26).all() and (curve < np.array(SHAPE[::-1]) - 26).all():
            return curve


def pen(rng, *widths):
    """One of these widths, or of a pen's usual ones [px]."""
    return float(rng.choice(widths or [2.0, 2.5, 3.0, 4.0, 5.0]))


def broad(rng):
    return pen(rng, 3.0, 4.0, 5.0)


def pick(rng, options):
    return options[int(rng.integers(len(options)))]


def penned(rng, **margin):
    """A curve, a pen's width, and the curve's length [px]."""
    curve, width = hand(rng, **margin), pen(rng)
    return curve, width, arc_of(curve)[-1]


def drawn(canvas, rng, **margin):
    """A drawn curve, and the pen's width."""
    curve, width, _ = penned(rng, **margin)
    canvas.line(curve, width, RED)
    return curve, width


def beside_a_line(add):
    """The kind of slice with a drawn line, the one that is meant, and what `add` draws there."""

    @wraps(add)
    def kind(canvas, rng):
        curve, width = drawn(canvas, rng)
        add(canvas, rng, curve, width)
        return curve

    return kind


def part(curve, start, stop):
    """The part of an open curve between two lengths of arc [px]; negative ones from its end."""
    arc = arc_of(curve)
    start, stop = (x if x >= 0 else arc[-1] + x for x in (start, stop))
    at = np.arange(start, stop, 0.5)
    return at_arcs([*at, stop], curve)


def tail(curve, length):
    """The last part of an open curve."""
    return part(curve, -length, arc_of(curve)[-1])


def parts_inside(curve, shape=SHAPE):
    """The parts of a curve that lie in a picture, the longest first."""
    inside = np.flatnonzero(((curve > -0.5) & (curve < np.array(shape[::-1]) - 0.5)).all(1))
    runs = np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1)
    return [curve[run] for run in sorted(runs, key=len, reverse=True)]


def pressed_by(curve, share, rng):
    """By which share of itself a pen's width changes with the hand's pressure, at each point."""
    t = np.linspace(0, 1, len(curve))
    return share * np.sin(2 * np.pi * (rng.uniform(1, 3) * t + rng.uniform()))


def normal_of(curve):
    tangent = np.gradient(curve, axis=0)
    tangent /= np.hypot(*tangent.T)[:, None]
    return np.column_stack([-tangent[:, 1], tangent[:, 0]])


def away(curve, rng, size=(40, 40), clear=25, shape=SHAPE, edge=8, tries=200):
    """The centre of a box of a size that lies `clear` px off a curve, or farther than others."""
    half = np.array(size) / 2
    places = rng.uniform(half + edge, np.array(shape[::-1]) - half - edge, (tries, 2))
    off = np.maximum(np.abs(curve[::8] - places[:, None]) - half, 0.0)
    distance = np.hypot(*np.moveaxis(off, 2, 0)).min(1)
    return places[np.argmax(np.minimum(distance, clear))]


def cross(canvas, at, arm, width, colour):
    """A marker's cross."""
    for step in (np.array([arm, 0.0]), np.array([0.0, arm])):
        canvas.line(np.array([at - step, at + step]), width, colour, cap="butt")


def direction(curve, points=10):
    """Unit vector in which a curve leaves its last point."""
    step = curve[-1] - curve[-points]
    return step / np.hypot(*step)


def turned(vector, angle):
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]])


# One right answer.


def plain(canvas, rng):
    closed = bool(rng.integers(2))
    curve = hand(rng, closed)
    canvas.line(curve, pen(rng, 1.0, 1.5, 2.0, 3.0, 4.5), RED, closed)
    return curve, closed


def thin(canvas, rng):
    curve = hand(rng)
    canvas.line(curve, 1.0, RED)
    return curve


def downscaled(canvas, rng):
    curve = hand(rng)
    big = Canvas(cv2.resize(canvas.picture, None, fx=2, fy=2), canvas.rasteriser)
    big.line(2 * curve + 0.5, 2 * pen(rng), RED)
    canvas.picture = cv2.resize(big.picture, SHAPE[::-1], interpolation=cv2.INTER_AREA)
    return curve


def upscaled(canvas, rng):
    curve, by = hand(rng), rng.uniform(1.4, 2.6)
    canvas.line(curve, pen(rng), RED)
    way = pick(rng, (cv2.INTER_CUBIC, cv2.INTER_LINEAR, cv2.INTER_LANCZOS4))
    larger = cv2.resize(canvas.picture, None, fx=by, fy=by, interpolation=way)
    canvas.picture = np.clip(larger, 0, 255)
    return (curve + 0.5) * by - 0.5


def linear_light(canvas, rng):
    curve = hand(rng)
    share = canvas.line_share(curve, pen(rng))
    canvas.picture = blend(canvas.picture, share, RED, rng.uniform(0.5, 1), 2.2)
    return curve


def scanned(canvas, rng):
    """A dull red on paper, blurred, with noise in every colour."""
    curve = hand(rng)
    canvas.line(curve, pen(rng), (200, 30, 40))
    blurred = cv2.GaussianBlur(canvas.picture, (0, 0), rng.uniform(0.6, 1.2))
    canvas.picture = blurred + rng.normal(0, rng.uniform(3, 9), blurred.shape)
    return curve


def leaves_the_picture(canvas, rng):
    way = (rng.choice([-1, 1]) * rng.uniform(110, 150), rng.uniform(-60, 60))
    curve = hand(rng) + way
    canvas.line(curve, pen(rng), RED)
    return parts_inside(curve)[0]


def mouse(canvas, rng):
    """Straight steps of 2 to 5 px on whole pixels, as a mouse gives them."""
    curve = hand(rng)
    arc = arc_of(curve)
    steps = np.cumsum(rng.uniform(2, 5, int(arc[-1] / 2)))
    at = np.r_[0.0, steps[steps < arc[-1]]]
    curve = np.rint(at_arcs(at, curve))
    curve = curve[np.r_[True, np.diff(curve, axis=0).any(1)]]
    canvas.line(curve, pen(rng), RED)
    return curve


def polygon(canvas, rng):
    curve = hand(rng, True)[:: 1200 // int(rng.integers(7, 14))]
    canvas.line(curve, pen(rng), RED, True)
    return curve, True


def pressure(canvas, rng):
    """A pen whose width varies by 30 to 60 % with the hand's pressure."""
    curve = hand(rng)
    swing = pressed_by(curve, rng.uniform(0.3, 0.6), rng)
    canvas.pressed(curve, rng.uniform(3, 5) * (1 + swing), RED)
    return curve


def taper(canvas, rng):
    """Drawn out to a point over 10 to 40 px at either end or one."""
    curve, over = hand(rng), float(rng.choice([10, 20, 40]))
    arc = arc_of(curve)
    ends = np.minimum(arc, arc[-1] - arc) if rng.integers(2) else arc
    canvas.pressed(curve, pen(rng) * np.clip(ends / over, 0.05, 1), RED)
    return curve


@beside_a_line
def glyphs(canvas, rng, curve, width):
    """Slicer's control points: discs of the line's colour on it."""
    for at in curve[:: len(curve) // int(rng.integers(5, 9))]:
        canvas.disc(at, width * rng.uniform(1.0, 1.6), RED)
    canvas.disc(curve[-1], width * 1.3, RED)


def handles(canvas, rng):
    """An ImageJ polygon with its handles: white squares with a dark border."""
    curve = hand(rng, True)[:: 1200 // int(rng.integers(8, 14))]
    canvas.line(curve, pen(rng, 2.0, 3.0), RED, True)
    for at in np.rint(curve):
        canvas.box(at, 7, 7, BLACK)
        canvas.box(at, 5, 5, WHITE)
    return curve, True


@beside_a_line
def scale_bar(canvas, rng, curve, width):
    length = rng.uniform(50, 100)
    at = away(curve, rng, (length, 40))
    bar = at + np.array([[-length / 2, 0], [length / 2, 0]])
    canvas.line(bar, 2.0, RED, cap="butt")
    for end in bar:
        canvas.line(end + np.array([[0, -5], [0, 5]]), 2.0, RED, cap="butt")
    canvas.text("5 cm", np.add(at, [-16, -8]), RED)


@beside_a_line
def calliper(canvas, rng, curve, width):
    """A measured distance: a slanting line with a cross at either end and its length in words."""
    length, angle = rng.uniform(40, 80), rng.uniform(0.2, 1.3)
    way = unit(angle)
    at = away(curve, rng, length * way + 12)
    ends = at + length / 2 * np.array([-way, way])
    canvas.line(ends, 1.5, RED, cap="butt")
    for end in ends:
        cross(canvas, end, 6, 1.5, RED)


@beside_a_line
def window_frame(canvas, rng, curve, width):
    """A rectangle beside or round the curve, as a viewport's border."""
    inset = rng.uniform(6, 14)
    centre = (np.array(SHAPE[::-1]) - 1) / 2
    corners = rectangle(centre, SHAPE[1] - 2 * inset, SHAPE[0] - 2 * inset)
    if rng.integers(2):
        size = rng.uniform(30, 52, 2)
        corners = rectangle(away(curve, rng, size), *size)
    canvas.line(corners, 2.0, RED, True)


@beside_a_line
def region(canvas, rng, curve, width):
    """A filled patch of the pen's colour beside the curve."""
    turn = np.linspace(0, 2 * np.pi, 80, endpoint=False)
    radius = rng.uniform(12, 22) * (1 + 0.2 * np.sin(3 * turn))
    at = away(curve, rng, (50, 50))
    canvas.fill(at + radius[:, None] * unit(turn), RED)


@beside_a_line
def dot_end(canvas, rng, curve, width):
    """A blob where the pen rested at one end."""
    canvas.disc(curve[-1], width * rng.uniform(1.2, 2.2), RED)


def arrow_head(canvas, rng):
    """A filled head at the end, whose tip is the curve's end."""
    curve, width = hand(rng), pen(rng)
    canvas.line(part(curve, 0, -8.0), width, RED)
    tip = curve[-1]
    back = part(curve, -14.0, -10.0)[0]
    along = (tip - back) / np.hypot(*(tip - back))
    across = np.array([-along[1], along[0]])
    back, aside = tip - 3 * width * along, 3 * width / 2 * across
    canvas.fill([tip, back + aside, back - aside], RED)
    return curve


def leader(canvas, rng):
    """A thin line from words to near the curve, not touching it."""
    curve = hand(rng)
    canvas.line(curve, 3.0, RED)
    at = away(curve, rng, (60, 20), 45)
    nearest = curve[np.hypot(*(curve - at).T).argmin()]
    way = (nearest - at) / np.hypot(*(nearest - at))
    canvas.line([at, nearest - 9 * way], 1.0, RED)
    canvas.text("cut", np.add(at, [-26, -4]) if way[0] > 0 else np.add(at, [2, 4]), RED)
    return curve


@beside_a_line
def crosses(canvas, rng, curve, width):
    """Marker crosses of the pen's colour with their labels."""
    for k in range(int(rng.integers(3, 7))):
        at = away(curve, rng, (28, 28), rng.uniform(12, 60))
        cross(canvas, at, 6, 1.5, RED)
        canvas.text(f"x{k}", np.add(at, [6, -5]), YELLOW, 0.4)


@beside_a_line
def words(canvas, rng, curve, width):
    canvas.text("L hip 3", away(curve, rng, (70, 14)) - [34, -6], RED)


def _straightest(curve, low, high):
    """Where between two shares of a curve's points it bends least."""
    turn = np.abs(np.gradient(np.unwrap(np.arctan2(*np.gradient(curve, axis=0).T))))
    first, last = int(low * len(curve)), int(high * len(curve))
    bend = np.convolve(turn, np.ones(81), "same")[first:last]
    return (first + int(bend.argmin())) / len(curve)


def lifts(canvas, rng):
    """The pen was lifted twice over 5 to 14 px."""
    curve, width, length = penned(rng)
    a, b = (length * _straightest(curve, *share) for share in ((0.2, 0.45), (0.55, 0.8)))
    gaps = rng.uniform(5, 14, 2) + width
    for start, stop in ((0, a), (a + gaps[0], b), (b + gaps[1], length)):
        canvas.line(part(curve, start, stop), width, RED)
    return curve


def touched(canvas, rng, order=None):
    """A line of another colour that runs along the curve's edge for a while."""
    curve, width = hand(rng), broad(rng)
    other = pick(rng, OTHERS)
    size = pen(rng, 1.5, 3.0, 5.0)
    length = arc_of(curve)[-1]
    start = length * rng.uniform(0.2, 0.4)
    beside = curve + (width + size) / 2 * rng.uniform(0.75, 1.05) * normal_of(curve)
    run = part(beside, start, start + rng.uniform(60, 140))
    lead = [run[0] + 25 * normal_of(run)[0] - 10, *run, run[-1] + 25 * normal_of(run)[-1] + 10]
    on_top = bool(rng.integers(2)) if order is None else order
    pens = [(np.array(lead), size, other), (curve, width, RED)]
    for points, wide, colour in pens if on_top else pens[::-1]:
        canvas.line(points, wide, colour)
    return curve


def touched_red_on_top(canvas, rng):
    return touched(canvas, rng, True)


@beside_a_line
def crossed(canvas, rng, curve, width):
    """Lines of other colours across the curve."""
    for where in (0.3, 0.65):
        k = int(where * len(curve))
        at, normal = curve[k], normal_of(curve)[k]
        lean = normal + rng.uniform(-0.5, 0.5) * np.array([-normal[1], normal[0]])
        colour = pick(rng, (*OTHERS, CYAN, GREEN))
        canvas.line(np.array([at - 40 * lean, at + 40 * lean]), rng.uniform(1.5, 4), colour)


@beside_a_line
def bars(canvas, rng, curve, width):
    """A red curve beside a chart's orange bars."""
    at = np.add(away(curve, rng, (34, 60)), [0, 25])
    for k in range(3):
        height = rng.uniform(20, 50)
        canvas.box(np.add(at, [10 * k - 10, -height / 2]), 7, height, (255, 127, 14))


# An answer other than the truth must be warned of, or refused.


def goes_on_along_an_axis(canvas, rng):
    """Beyond a lift of more than the longest bridged, a straight piece along a row or column."""
    width, gap = pen(rng), rng.uniform(26, 45)
    u, v = rng.uniform(40, 60), rng.uniform(120, 200)
    t = np.linspace(0, 1, 800)
    curve = np.column_stack([u + 170 * t, v + 35 * np.sin(np.pi * t) ** 2 * np.cos(3 * t)])
    start = u + 170 + gap
    straight = np.array([[start, v], [start + rng.uniform(24, 42), v + rng.uniform(-1, 1)]])
    whole = np.vstack([curve, straight])
    if rng.integers(2):
        whole, curve, straight = (x[:, ::-1] * [1, 0.92] for x in (whole, curve, straight))
    canvas.line(curve, width, RED)
    canvas.line(straight, width, RED)
    return whole


def short_pieces(canvas, rng):
    """The curve goes on beyond 22 to 35 px in pieces shorter than a line may be."""
    curve, width, length = penned(rng, margin=0.12)
    stop = length * rng.uniform(0.6, 0.75)
    canvas.line(part(curve, 0, stop), width, RED)
    at = stop
    while (at := at + rng.uniform(22, 35) + width) < length - 5:
        canvas.line(part(curve, at, min(at + rng.uniform(8, 16), length)), width, RED)
        at += 12
    return curve


def goes_on_dashed(canvas, rng):
    curve, width, length = penned(rng, margin=0.12)
    at = length * rng.uniform(0.55, 0.75)
    canvas.line(part(curve, 0, at), width, RED)
    dash, gap = rng.uniform(5, 12), rng.uniform(8, 24) + width
    while at + gap + dash < length:
        at += gap
        canvas.line(part(curve, at, at + dash), width, RED)
        at += dash
    return part(curve, 0, at)


def rectangle_with_a_line(canvas, rng):
    """The planned cut is a rectangle; a short line stands inside it."""
    centre = (np.array(SHAPE[::-1]) - 1) / 2 + rng.uniform(-20, 20, 2)
    corners = rectangle(centre, rng.uniform(160, 220), rng.uniform(130, 190))
    canvas.line(corners, pen(rng), RED, True)
    t = np.linspace(-1, 1, 100)[:, None]
    short = centre + rng.uniform(16, 24) * t * [0.9, 0.5] + [0, 3] * np.sin(3 * t)
    canvas.line(short, 2.5, RED)
    return corners, True


@beside_a_line
def end_under_a_box(canvas, rng, curve, width):
    hidden = tail(curve, rng.uniform(35, 90))
    low, high = hidden.min(0) - 6, hidden.max(0) + 6
    colour = pick(rng, (*OTHERS, CYAN, GREEN, BLUE))
    canvas.box((low + high) / 2, *(high - low), colour)


def end_among_specks(canvas, rng):
    """The last 35 to 90 px of a curve broken into specks among others."""
    curve, width, length = penned(rng)
    stop = length - rng.uniform(35, 90)
    canvas.line(part(curve, 0, stop), width, RED)
    at = stop + width
    while at < length:
        at += rng.uniform(4, 12)
        canvas.disc(part(curve, min(at, length - 1), length)[0], rng.uniform(0.8, 1.8), RED)
    for _ in range(25):
        canvas.disc(curve[-1] + rng.normal(0, 30, 2), rng.uniform(0.8, 1.8), RED)
    return curve


def beyond_a_long_lift(canvas, rng):
    """One more stroke of 25 to 40 px, 30 to 60 px on, wherever the curve has bent to."""
    curve, width, length = penned(rng, margin=0.12)
    start = length - rng.uniform(25, 40)
    canvas.line(part(curve, 0, start - rng.uniform(30, 60) - width), width, RED)
    canvas.line(part(curve, start, length), width, RED)
    return curve


def opening(canvas, rng):
    """A C: nearly closed, with an opening of 6 to 26 px."""
    curve, width = hand(rng, True), pen(rng)
    curve = part(curve, 0, arc_of(curve)[-1] - rng.uniform(6, 26) - width)
    canvas.line(curve, width, RED)
    return curve


def orange_bar(canvas, rng):
    """No curve at all: a chart's orange bars."""
    at = rng.uniform(90, 200, 2)
    orange = pick(rng, ((255, 127, 14), ORANGE))
    for k in range(int(rng.integers(1, 4))):
        canvas.box(np.add(at, [18 * k, 0]), rng.uniform(6, 9), rng.uniform(60, 110), orange)
    return


def lone_bar(canvas, rng):
    """No curve at all: one bar in a red that is nearly the pen's."""
    red = pick(rng, ((255, 69, 0), (255, 80, 20), (250, 60, 0)))
    canvas.box(rng.uniform(90, 200, 2), rng.uniform(6, 9), rng.uniform(60, 110), red)
    return


@beside_a_line
def hidden_stretch(canvas, rng, curve, width):
    """Something broader than the longest bridged lies over the line."""
    at = curve[int(rng.uniform(0.4, 0.6) * len(curve))]
    canvas.disc(at, rng.uniform(14, 22), pick(rng, (*OTHERS, CYAN, GREEN)))


def letter_turns_off(canvas, rng):
    """A thinner stroke of a letter that goes off to one side from the curve's end."""
    curve, width = hand(rng), broad(rng)
    along = direction(curve)
    aside = turned(along, rng.choice([-1, 1]) * rng.uniform(1.1, 1.7))
    canvas.line(curve, width, RED)
    start = curve[-1] + 0.2 * width * along
    canvas.line([start, start + rng.uniform(12, 16) * aside], width / 2, RED)
    return curve


# A cover over an end that has no colour, a letter, a dot.


def _over_the_end(canvas, rng):
    """A drawn curve, and the box that hides its last 35 to 90 px, half of them on whole pixels."""
    curve, _ = drawn(canvas, rng)
    hidden = tail(curve, rng.uniform(35, 90))
    low, high = hidden.min(0) - rng.uniform(4, 14), hidden.max(0) + rng.uniform(4, 14)
    if rng.integers(2):
        low, high = np.rint(low) - 0.5, np.rint(high) + 0.5
    return curve, ((low + high) / 2, *(high - low))


def box_over_the_end(canvas, rng, opacity=1.0):
    """White, black or grey."""
    curve, (at, width, height) = _over_the_end(canvas, rng)
    tone, before = float(rng.choice([0.0, 255.0, rng.uniform(40, 215)])), canvas.picture
    canvas.box(at, width, height, (tone,) * 3)
    canvas.picture = (1 - opacity) * before + opacity * canvas.picture
    return curve


def veil_over_the_end(canvas, rng):
    """Half to four fifths opaque: the ink shows through."""
    return box_over_the_end(canvas, rng, opacity=rng.uniform(0.5, 0.8))


@beside_a_line
def letter_at_the_end(canvas, rng, curve, width):
    """A letter in the pen's colour that the curve runs into."""
    way = direction(curve)
    at = curve[-1] + (width / 2 + rng.uniform(3, 7)) * way
    canvas.text(pick(rng, "LATxK"), np.add(at, (-5, 6)), RED, rng.uniform(0.4, 0.6))


def dot_beside(canvas, rng):
    """A dot of the same pen that touches the line from one side."""
    curve, width = hand(rng), broad(rng)
    at = int(rng.uniform(0.3, 0.7) * len(curve))
    radius = width * rng.uniform(1.2, 1.8)
    canvas.line(curve, width, RED)
    canvas.disc(curve[at] + rng.uniform(0.7, 0.9) * radius * normal_of(curve)[at], radius, RED)
    return curve


KINDS = by_name(
    plain, thin, downscaled, upscaled, linear_light, scanned, leaves_the_picture, mouse,
    polygon, pressure, taper, glyphs, handles, scale_bar,
    calliper, window_frame, region, dot_end, arrow_head, leader, crosses, words, lifts, touched,
    touched_red_on_top, crossed, bars,
)  # fmt: skip
TRAPS = by_name(
    goes_on_along_an_axis, short_pieces, goes_on_dashed, rectangle_with_a_line, end_under_a_box,
    end_among_specks, beyond_a_long_lift, opening, orange_bar, lone_bar, hidden_stretch,
    letter_turns_off,
)  # fmt: skip
HIDDEN = by_name(box_over_the_end, veil_over_the_end, letter_at_the_end, dot_beside)
FAMILY = Family(KINDS, {**TRAPS, **HIDDEN}, _begin)
draw = FAMILY.draw
