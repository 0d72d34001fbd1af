"""Thirty kinds of drawn slices on which extractions are measured and compared.

Sixteen kinds are clear: one curve is meant, and an extraction should return it. Fourteen are
ambiguous: a person has to say what is meant, so an extraction must not return another curve
without a word about the place. Five rasterisers draw them, half of the slices are PNG and the rest
JPEG of quality 60 to 90. Nothing here uses vfplan.
"""

from __future__ import annotations

from importlib.util import find_spec

import cv2
import numpy as np
from canvas import Canvas
from drawing import anatomy, polyline, unit
from slices import (
    Family,
    arc_of,
    away,
    by_name,
    cross,
    direction,
    normal_of,
    part,
    parts_inside,
    pen,
    pick,
    pressed_by,
    tail,
    turned,
)  # fmt: skip

RASTERISERS = ("exact", "agg", "pil", "opencv", *(["skia"] if find_spec("skia") else []))
ROUND_CAPS_ONLY = ("pil", "opencv")
WITHOUT_OPACITY_STEPS = 4  # samples a pixel along either axis, of the rasteriser "pil"
QUALITIES = (None, None, None, None, 90, 90, 75, 60)  # one of them for each slice in turn
SHAPE = (340, 420)
LARGE_SHAPE = (786, 871)
RED = (255, 0, 0)
REDS = (RED, RED, RED, (220, 20, 60), (200, 30, 40), (255, 40, 20))
YELLOW, CYAN = (255, 255, 0), (0, 255, 255)
OTHERS = (YELLOW, (255, 165, 0), (255, 0, 255), CYAN, (0, 200, 60), (40, 60, 220))


class Sheet(Canvas):
    """A canvas with one pen: its colour, width, opacity and cap."""

    def __init__(self, ground, rasteriser, rng):
        super().__init__(ground, rasteriser)
        self.rng = rng
        self.width = pen(rng, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 9.0)
        if rasteriser == "opencv":
            self.width = float(max(1, round(self.width)))
        self.red = pick(rng, REDS)
        self.opacity = float(rng.uniform(0.5, 0.9)) if rng.random() < 0.25 else 1.0
        is_flat = rng.random() < 0.25 and rasteriser not in ROUND_CAPS_ONLY
        self.cap = "butt" if is_flat else "round"

    def line_share(self, points, width, closed=False, cap="round"):
        points = np.asarray(points, float)
        if self.rasteriser == "pil":
            return _pil(self.shape, polyline(points, closed, 0.2), np.array([width]))
        if self.rasteriser == "opencv":
            return _opencv(self.shape, points, width, closed)
        return super().line_share(points, width, closed, cap)

    def fill(self, points, colour):
        if self.rasteriser not in ROUND_CAPS_ONLY:
            super().fill(points, colour)
            return
        share = np.zeros(self.shape, np.uint8)
        outline = np.rint(np.asarray(points) * 16).astype(np.int32)
        cv2.fillPoly(share, [outline], 255, cv2.LINE_AA, 4)
        self.paint(share / 255.0, colour)

    def pressed(self, points, widths, colour):
        if self.rasteriser not in ROUND_CAPS_ONLY:
            super().pressed(points, widths, colour)
            return
        points = np.asarray(points, float)
        dense = polyline(points, False, 0.2)
        arc = arc_of(points)
        at = np.linspace(0, arc[-1], len(dense))
        self.paint(_pil(self.shape, dense, np.interp(at, arc, widths)), colour)

    def draw(self, curves, closed=False):
        """Draw the pen's own lines in one go, as a translucent layer is."""
        shares = [self.line_share(curve, self.width, closed, self.cap) for curve in curves]
        self.paint(np.max(shares, axis=0) * self.opacity, self.red)


def _begin(kind, _seed, rng):
    rasteriser = pick(rng, RASTERISERS)
    quality = pick(rng, QUALITIES)
    return Sheet(_ground(LARGE_SHAPE if kind in LARGE else SHAPE, rng), rasteriser, rng), quality


def _ground(shape, rng):
    seed = int(rng.integers(10_000))
    choice = rng.random()
    if choice < 0.6:
        return anatomy(shape, seed)
    if choice < 0.8:  # soft noise, like a projection
        noise = np.random.default_rng(seed).normal(0, 1, shape)
        grey = 110 + 320 * cv2.GaussianBlur(noise, (0, 0), 8) + 3 * noise
        return np.repeat(np.clip(grey, 0, 255)[..., None], 3, axis=2)
    rows, cols = np.mgrid[: shape[0], : shape[1]]
    body = np.hypot((cols / shape[1] - 0.5) / 0.46, (rows / shape[0] - 0.5) / 0.42)
    grey = np.where(body < 1, 95.0, 8.0)  # a body in air, with a row of bright bones
    for _ in range(6):
        at = rng.uniform(0.2, 0.8, 2) * shape[::-1]
        size = rng.uniform(0.02, 0.1) * shape[1]
        away = np.hypot((cols - at[0]) * rng.uniform(0.6, 1.4), rows - at[1])
        grey = np.where(away < size, 150.0, grey)
        grey = np.where(np.abs(away - size) < rng.uniform(2, 5), 235.0, grey)
    grey = cv2.GaussianBlur(grey, (0, 0), 1.0) + rng.normal(0, 4, shape)
    return np.repeat(np.clip(grey, 0, 255)[..., None], 3, axis=2)


def hand(sheet, rng, closed=False):
    """A smooth curve of a hand, well inside the picture; (M, 2) every half pixel."""
    height, width = sheet.shape
    clear = 30 + 2 * sheet.width
    while True:
        curve = _closed_hand(height, width, rng) if closed else _open_hand(height, width, rng)
        inside = (curve > clear).all() and (curve < np.array([width, height]) - clear).all()
        if inside and not _near_itself(curve, 4 * sheet.width + 16, closed):
            return curve


def _open_hand(height, width, rng):
    """A walk whose curvature wanders, as a hand's does."""
    count = int(rng.uniform(0.9, 2.2) * width)
    knots = rng.normal(0, 1, count // 40 + 4)
    bend = np.interp(np.linspace(0, len(knots) - 1, count), np.arange(len(knots)), knots)
    bend = cv2.GaussianBlur(bend[:, None], (1, 41), 10).ravel() * rng.uniform(0.2, 1.0) / 45
    heading = rng.uniform(0, 2 * np.pi) + np.cumsum(bend)
    curve = np.cumsum(0.5 * unit(heading), axis=0)
    middle = (curve.max(0) + curve.min(0)) / 2
    return curve - middle + np.array([width, height]) / 2 + rng.uniform(-20, 20, 2)


def _closed_hand(height, width, rng):
    turn = np.linspace(0, 2 * np.pi, 1600, endpoint=False)
    radius = np.full(len(turn), rng.uniform(0.2, 0.32) * height)
    for k in range(2, 7):
        radius *= 1 + rng.normal(0, 0.22 / k) * np.cos(k * turn + rng.uniform(0, 2 * np.pi))
    ring = radius[:, None] * np.column_stack([rng.uniform(0.9, 1.3) * np.cos(turn), np.sin(turn)])
    return ring + np.array([width, height]) / 2 + rng.uniform(-15, 15, 2)


def _near_itself(curve, distance, closed):
    """Whether two parts of a curve that are far along it lie close to each other."""
    step = max(1, round(4 / np.median(np.diff(arc_of(curve)))))
    thin = curve[::step]
    apart = np.hypot(*np.moveaxis(thin[:, None] - thin, 2, 0))
    arc = 4.0 * np.arange(len(thin))
    along = np.abs(arc[:, None] - arc)
    if closed:
        along = np.minimum(along, arc[-1] + 4 - along)
    return bool((apart[along > 2.5 * distance] < distance).any())


def away_from(curve, sheet, rng, size, clear):
    """The centre of a box that lies `clear` px off a curve, or as far as there is room."""
    return away(curve, rng, size, clear, sheet.shape, 6, 300)


def drawn(sheet, rng, closed=False):
    """A curve, drawn with the sheet's pen."""
    curve = hand(sheet, rng, closed)
    sheet.draw([curve], closed)
    return curve


def set_markers(sheet, rng, curve, count, farthest):
    """Crosses with labels, 20 px off the curve or more."""
    for k in range(1, count + 1):
        at = away_from(curve, sheet, rng, (30, 30), rng.uniform(20, farthest))
        cross(sheet, at, 7, 2.0, CYAN)
        sheet.text(f"x{k}", np.add(at, [8, -6]), YELLOW, 0.5)


def in_any_order(rng, *layers):
    for layer in layers if rng.integers(2) else layers[::-1]:
        layer()


def any_other(rng):
    return pick(rng, OTHERS)


# Clear kinds: (sheet, rng) -> the curve that is meant, and whether it is closed.


def plain(sheet, rng):
    return drawn(sheet, rng)


def closed(sheet, rng):
    return drawn(sheet, rng, True), True


def taper(sheet, rng):
    """Drawn out to a point over 8 to 40 px at one end or both."""
    curve = hand(sheet, rng)
    arc = arc_of(curve)
    widths = np.clip((arc[-1] - arc) / rng.uniform(8, 40), 0.04, 1)
    if rng.integers(2):
        widths *= np.clip(arc / rng.uniform(8, 40), 0.04, 1)
    sheet.pressed(curve, max(sheet.width, 2.0) * widths, sheet.red)
    return curve


def lifts(sheet, rng):
    """One to three pen lifts that leave 3 to 14 px of paper."""
    curve = hand(sheet, rng)
    length = arc_of(curve)[-1]
    count, start, runs = int(rng.integers(1, 4)), 0.0, []
    for k in range(count):
        stop = length * (k + rng.uniform(0.7, 1.0)) / (count + 1)
        runs.append(part(curve, start, stop))
        start = stop + rng.uniform(3, 14) + sheet.width
    runs.append(part(curve, start, length))
    sheet.draw(runs)
    return curve


def crossed_by_colours(sheet, rng):
    curve = drawn(sheet, rng)
    for share in (0.25, 0.5, 0.75)[: int(rng.integers(1, 4))]:
        k = int(share * len(curve))
        lean = turned(normal_of(curve)[k], rng.uniform(-0.5, 0.5))
        reach = rng.uniform(20, 60) * lean
        across = np.array([curve[k] - reach, curve[k] + reach])
        sheet.line(across, rng.uniform(1.5, 4), any_other(rng))
    return curve


def touched_along(sheet, rng):
    """A line of another colour runs along one edge of the curve."""
    sheet.width = max(sheet.width, 2.0)
    curve = hand(sheet, rng)
    size = pen(rng, 1.0, 2.0, 3.0)
    aside = (sheet.width + size) / 2 * rng.uniform(0.85, 1.2)
    beside = curve + rng.choice([-1, 1]) * aside * normal_of(curve)
    length = arc_of(beside)[-1]
    start = length * rng.uniform(0.25, 0.4)
    run = part(beside, start, start + rng.uniform(40, 100))
    colour = any_other(rng)
    in_any_order(rng, lambda: sheet.line(run, size, colour), lambda: sheet.draw([curve]))
    return curve


def letters_near(sheet, rng):
    curve = drawn(sheet, rng)
    for word in ("L", "hip 3", "cut A")[: int(rng.integers(1, 4))]:
        at = away_from(curve, sheet, rng, (50, 16), rng.uniform(8, 30))
        sheet.text(word, np.subtract(at, [22, -6]), sheet.red, rng.uniform(0.4, 0.6))
    return curve


def dots_and_crosses_near(sheet, rng):
    curve = drawn(sheet, rng)
    for _ in range(int(rng.integers(2, 6))):
        at = away_from(curve, sheet, rng, (20, 20), rng.uniform(6, 40))
        if rng.integers(2):
            sheet.disc(at, rng.uniform(1.5, 5), sheet.red)
        else:
            cross(sheet, at, 6, 1.5, sheet.red)
    return curve


def boxes_and_swatch_near(sheet, rng):
    curve = drawn(sheet, rng)
    for low, high, least, colour in (
        (16, 40, 8, None), (10, 24, 10, sheet.red), (20, 50, 8, (120, 120, 120)),
    ):  # fmt: skip
        size = rng.uniform(low, high, 2)
        at = away_from(curve, sheet, rng, size, rng.uniform(least, 40))
        sheet.box(at, *size, colour or any_other(rng))
    return curve


def marker_crosses(sheet, rng):
    curve = drawn(sheet, rng)
    for k in range(int(rng.integers(4, 9))):
        at = away_from(curve, sheet, rng, (26, 26), rng.uniform(10, 50))
        cross(sheet, at, 6, 1.5, CYAN)
        sheet.text(f"x{k}", np.add(at, [6, -5]), YELLOW, 0.4)
    return curve


def leaves_the_picture(sheet, rng):
    curve = hand(sheet, rng)
    size = np.array(sheet.shape[::-1])
    middle = curve[len(curve) // 2]
    edge = [middle[0], size[0] - middle[0], middle[1], size[1] - middle[1]]
    axis = int(rng.integers(4))
    shift = (edge[axis] - rng.uniform(0, 12)) * np.array([[-1, 0], [1, 0], [0, -1], [0, 1]])[axis]
    curve = curve + shift
    sheet.draw([curve])
    longest, *others = parts_inside(curve, sheet.shape)
    if len(longest) < 160 or sum(len(run) for run in others) > 10:
        # Draw it again on a fresh ground.
        sheet.picture = _ground(sheet.shape, rng)
        return leaves_the_picture(sheet, rng)
    return longest


def pressure(sheet, rng):
    """The width follows the hand's pressure by 20 to 50 %."""
    curve = hand(sheet, rng)
    swing = pressed_by(curve, rng.uniform(0.2, 0.5), rng)
    sheet.pressed(curve, max(sheet.width, 2.5) * (1 + swing), sheet.red)
    return curve


def polygon(sheet, rng):
    curve = hand(sheet, rng, True)[:: 1600 // int(rng.integers(6, 14))]
    sheet.draw([curve], True)
    return curve, True


def planned(sheet, rng):
    """A whole screen: an open curve, nine markers with labels, a grey scale bar."""
    sheet.width = pen(rng, 2.0, 2.2, 3.0, 4.5)
    curve = drawn(sheet, rng)
    set_markers(sheet, rng, curve, 9, 120)
    sheet.box((60, sheet.shape[0] - 20), 80, 4, (230, 230, 230))
    return curve


def neighbour(sheet, rng):
    """A closed curve, and another colour's closed curve close outside of it."""
    curve = hand(sheet, rng, True)
    other = pen(rng, 1.5, 2.0, 3.0)
    aside = (sheet.width + other) / 2 + rng.uniform(-0.3, 3)
    outside = curve - aside * normal_of(np.vstack([curve, curve[:1]]))[:-1]
    in_any_order(rng, lambda: sheet.line(outside, other, any_other(rng), True),
                 lambda: sheet.draw([curve], True))  # fmt: skip
    return curve, True


def taper_on_a_planned_slice(sheet, rng):
    curve = taper(sheet, rng)
    set_markers(sheet, rng, curve, 5, 80)
    return curve


# Ambiguous kinds: what a person has to look at lies at the places.


def long_gap(sheet, rng):
    """A lift of 26 to 45 px, more than the longest that is bridged."""
    curve = hand(sheet, rng)
    length = arc_of(curve)[-1]
    stop = length * rng.uniform(0.35, 0.6)
    gap = rng.uniform(26, 45)
    first, second = part(curve, 0, stop), part(curve, stop + gap + sheet.width, length)
    sheet.draw([first, second])
    return curve, False, [first[-1], second[0]]


def short_pieces(sheet, rng):
    """The curve goes on in short pieces with long lifts between them."""
    curve = hand(sheet, rng)
    length = arc_of(curve)[-1]
    at = length * rng.uniform(0.55, 0.7)
    runs = [part(curve, 0, at)]
    end = runs[0][-1]
    while at < length - 30:
        at += rng.uniform(22, 34) + sheet.width
        if at > length - 2:  # What is left of the curve is too short to be a piece.
            break
        runs.append(part(curve, at, min(at + rng.uniform(6, 14), length)))
        at += 12
    sheet.draw(runs)
    return curve, False, [end]


def level_tail(sheet, rng):
    """Beyond a long lift the curve goes on straight along a row or a column."""
    sheet.width = min(sheet.width, 5.0)
    t = np.linspace(0, 1, 700)
    start = np.array([rng.uniform(45, 60), rng.uniform(130, 200)])
    bow = rng.uniform(25, 45) * np.sin(np.pi * t) ** 2 * np.cos(3 * t)
    curve = start + np.column_stack([180 * t, bow])
    gap = rng.uniform(26, 42) + sheet.width
    more = start + np.array([[180 + gap, 0.0], [180 + gap + rng.uniform(22, 40), 0.0]])
    if rng.integers(2):
        curve, more = curve[:, ::-1], more[:, ::-1]
    sheet.draw([curve, more])
    return np.vstack([curve, more]), False, [curve[-1]]


def fork(sheet, rng):
    curve = hand(sheet, rng)
    k = int(rng.uniform(0.35, 0.65) * len(curve))
    way = turned(np.gradient(curve, axis=0)[k] * 2, rng.choice([-1, 1]) * rng.uniform(0.5, 1.2))
    branch = curve[k] + np.linspace(0, rng.uniform(30, 80), 120)[:, None] * way / np.hypot(*way)
    sheet.draw([curve, branch])
    return None, False, [curve[k]]


def two_curves(sheet, rng):
    """Two curves of like length, one above the other."""
    height, width = sheet.shape
    t = np.linspace(0, 1, 700)
    curves = []
    for row in (0.3, 0.7):
        v = height * row + rng.uniform(8, 25) * np.sin(rng.uniform(3, 7) * t + rng.uniform(0, 6))
        u = 50 + (width - 100) * rng.uniform(0.75, 1.0) * t
        curves.append(np.column_stack([u, v]))
    sheet.draw(curves)
    return None, False, [curves[0][350], curves[1][350]]


def double_run(sheet, rng):
    """Two strokes side by side over half of the curve or more."""
    curve = hand(sheet, rng)
    aside = sheet.width * rng.uniform(0.6, 1.1) + rng.uniform(0, 1.5)
    beside = curve + aside * normal_of(curve)
    length = arc_of(beside)[-1]
    start = length * rng.uniform(0.0, 0.4)
    run = part(beside, start, start + length * rng.uniform(0.5, 0.6))
    sheet.draw([curve, run])
    return None, False, [run[len(run) // 2], run[len(run) // 4], run[3 * len(run) // 4]]


def grey_box_over_an_end(sheet, rng, colour=None):
    """A box over the last 12 to 40 px of a curve."""
    colour = colour or (rng.uniform(0, 255),) * 3
    kind, low, high = _end_to_hide(sheet, rng, (12, 40))
    sheet.box((low + high) / 2, *(high - low), colour)
    return kind


def coloured_box_over_an_end(sheet, rng):
    return grey_box_over_an_end(sheet, rng, any_other(rng))


def veil_over_an_end(sheet, rng):
    """A translucent grey box, through which the end shows faintly."""
    kind, low, high = _end_to_hide(sheet, rng, (15, 45))
    share = np.zeros(sheet.shape)
    (left, top), (right, bottom) = np.rint(low).astype(int), np.rint(high).astype(int)
    share[top:bottom, left:right] = rng.uniform(0.55, 0.9)
    sheet.paint(share, (rng.uniform(60, 220),) * 3)
    return kind


def _end_to_hide(sheet, rng, length):
    """What a kind returns whose end is hidden, so long [px], and the corners of a box over it."""
    curve = drawn(sheet, rng)
    hidden = tail(curve, rng.uniform(*length))
    kind = curve, False, [hidden[0], hidden[-1]]
    return kind, hidden.min(0) - 6, hidden.max(0) + 6


def letter_at_an_end(sheet, rng):
    """A letter in the pen's colour begins where the curve ends."""
    curve = drawn(sheet, rng)
    way = direction(curve, 12)
    at = curve[-1] + (sheet.width / 2 + rng.uniform(-1, 3)) * way
    letter = pick(rng, "AFLTX")
    size = rng.uniform(0.35, 0.6)
    box, _ = cv2.getTextSize(letter, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    middle = at + way * np.array(box) / 2
    sheet.text(letter, middle + np.array([-box[0], box[1]]) / 2, sheet.red, size)
    return curve, False, [curve[-1]]


def dot_beside(sheet, rng):
    curve = drawn(sheet, rng)
    k = int(rng.uniform(0.2, 0.8) * len(curve))
    radius = rng.uniform(1.5, 3.5)
    at = curve[k] + (sheet.width / 2 + radius + rng.uniform(-1.5, 2)) * normal_of(curve)[k]
    sheet.disc(at, radius, sheet.red)
    return curve, False, [at]


def other_colour_over_the_end(sheet, rng):
    """A line of another colour crosses the very end."""
    curve = drawn(sheet, rng)
    across = turned(direction(curve, 12), np.pi / 2 + rng.uniform(-0.4, 0.4))
    at = curve[-1] - rng.uniform(0, 3) * direction(curve, 12)
    sheet.line(np.array([at - 25 * across, at + 25 * across]), rng.uniform(3, 8), any_other(rng))
    return curve, False, [curve[-1]]


def ring_with_an_opening(sheet, rng):
    ring = hand(sheet, rng, True)
    curve = part(ring, 0, arc_of(ring, True)[-2] - rng.uniform(5, 30) - sheet.width)
    sheet.draw([curve])
    return curve, False, [curve[0], curve[-1]]


def planned_level_tail(sheet, rng):
    curve, is_closed, places = level_tail(sheet, rng)
    set_markers(sheet, rng, curve, 4, 80)
    return curve, is_closed, places


CLEAR = by_name(
    plain, closed, taper, lifts, crossed_by_colours, touched_along, letters_near,
    dots_and_crosses_near, boxes_and_swatch_near, marker_crosses, leaves_the_picture, pressure,
    polygon, planned, neighbour, taper_on_a_planned_slice,
)  # fmt: skip
AMBIGUOUS = by_name(
    long_gap, short_pieces, level_tail, planned_level_tail, fork, two_curves, double_run,
    grey_box_over_an_end, coloured_box_over_an_end, veil_over_an_end, letter_at_an_end, dot_beside,
    other_colour_over_the_end, ring_with_an_opening,
)  # fmt: skip
LARGE = ("planned", "taper on a planned slice")
FAMILY = Family(CLEAR, AMBIGUOUS, _begin)
draw = FAMILY.draw


def _pil(shape, dense, widths):
    """Pillow at four times the size, reduced by the mean: discs along a dense polyline.

    Pillow cuts the numbers of an ellipse's box down to whole pixels and paints both borders. The
    box is therefore that of the pixels whose centres lie in the disc; the nearest one of a disc
    that holds none.
    """
    from PIL import Image, ImageDraw

    n = WITHOUT_OPACITY_STEPS
    picture = Image.new("L", (shape[1] * n, shape[0] * n))
    pencil = ImageDraw.Draw(picture)
    radii = np.broadcast_to(n * np.asarray(widths, float) / 2, len(dense))[:, None]
    centres = (dense + 0.5) * n - 0.5
    low, high = np.ceil(centres - radii), np.floor(centres + radii)
    empty = low > high
    low[empty] = high[empty] = np.rint(centres)[empty]
    for box in np.hstack([low, high]).tolist():
        pencil.ellipse(box, fill=255)
    fine = np.asarray(picture, np.float32)
    return fine.reshape(shape[0], n, shape[1], n).mean((1, 3)) / 255.0


def _opencv(shape, points, width, closed):
    share = np.zeros(shape, np.uint8)
    at = np.rint(points * 16).astype(np.int32)
    cv2.polylines(share, [at], closed, 255, max(1, round(width)), cv2.LINE_AA, 4)
    return share / 255.0
