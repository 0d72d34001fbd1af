"""What stands around a drawn line in published pictures, and pictures that hold nothing else.

Bars on the picture's edge, colour scales, boxes, windows of annotation tools, twenty pens, filled
outlines and outlines with handles. A person takes at most two steps: what comes out at once, or
else what the first advice gives.

    python tests/making/surroundings.py [SEED]    prints the table of 300 pictures
"""

from __future__ import annotations

import re
import sys
from collections import Counter

import matplotlib
import numpy as np
from canvas import RASTERISERS, Canvas, rectangle
from drawing import anatomy, flat, normal_errors, polyline
from scipy.spatial import cKDTree

from vfplan.curve.extraction import extract_curve
from vfplan.errors import CurveError

HEX = """ff0000 dc143c d62728 ffa500 ff7f0e ffd700 ffff00 7fff00 00ff00 2ca02c
    00ff7f 40e0d0 00ffff 00bfff 1e90ff 1f77b4 0000ff 800080 ff00ff e0209c"""
PENS = np.frombuffer(bytes.fromhex(HEX), np.uint8).reshape(20, 3)
SHAPE, WINDOW = (420, 480), (600, 900)
# How many pictures of each kind have a line, and how many have none.
LINES = {"pen": 40, "fill": 40, "handles": 40, "bar": 20, "scale": 20, "box": 20, "window": 20}
EMPTY = {"bar": 30, "scale": 30, "box": 15, "window": 25}


class Picture(Canvas):
    """A slice of one kind, with what was drawn on it: `truth`, (M, 2) px or `None`."""

    def __init__(self, kind, seed, has_line):
        self.rng = rng = np.random.default_rng([seed, *kind.encode()])
        shape = WINDOW if kind == "window" else SHAPE
        super().__init__(anatomy(shape, seed), str(rng.choice(RASTERISERS)))
        # Most planners draw in red; the pens have a kind of their own.
        self.pen = PENS[seed % 20 if kind == "pen" or rng.random() < 0.4 else 0]
        self.width, self.truth = float(rng.choice([1.5, 2.0, 3.0, 4.0, 5.0])), None
        self.closed = bool(kind in ("fill", "handles") or rng.random() < 0.5)
        if has_line:
            self.truth = self.hand((560, 290) if kind == "window" else (230, 210))
            if kind == "fill":
                before = self.picture
                self.fill(self.truth, self.pen)
                self.picture += rng.uniform(0.5, 0.9) * (before - self.picture)
            self.line(self.truth, self.width, self.pen, self.closed)
        if kind not in ("pen", "fill"):
            getattr(self, kind)(rng)

    def hand(self, middle):
        """A smooth ring, or two thirds of it."""
        angle = np.linspace(0, 2 * np.pi, 900, endpoint=False)
        radius = np.full(900, 100.0)
        for k in (2, 3, 4):
            radius += self.rng.normal(0, 18 / k) * np.cos(k * angle + self.rng.uniform(0, 6))
        ring = radius[:, None] * np.column_stack([1.2 * np.cos(angle), np.sin(angle)])
        return (ring + middle)[: None if self.closed else 600]

    def bar(self, rng):
        """Flush with the picture's border, whole or in part."""
        sides, thick = int(rng.integers(4)), int(rng.integers(2, 25))
        picture = np.rot90(self.picture, sides)
        start, stop = sorted(rng.uniform(0, 1, 2)) if rng.random() < 0.5 else (0, 1)
        first = int(start * picture.shape[1])
        part = picture[:thick, first : max(int(stop * picture.shape[1]), first + 60)]
        part[:] = 0.2 * part + 0.8 * self.pen

    def scale(self, rng):
        """A colour map, upright or level."""
        colours = matplotlib.colormaps[str(rng.choice(["autumn", "hot", "jet", "turbo", "hsv"]))]
        thick, long = int(rng.integers(8, 31)), int(rng.integers(120, 330))
        strip = np.repeat(255 * colours(np.linspace(1, 0, long))[:, None, :3], thick, axis=1)
        u, v = 440 - int(rng.integers(0, 12)), 40
        if rng.random() < 0.3:
            strip, u, v = strip.transpose(1, 0, 2), 60, 385
        self.picture[v:, u:][: len(strip), : strip.shape[1]] = strip[: SHAPE[0] - v]

    def box(self, rng):
        """Around a part of the picture, with or without a small icon beside it."""
        size = rng.uniform(60, 150, 2) if self.truth is None else rng.uniform(330, 350, 2)
        self.line(rectangle(rng.uniform(200, 230, 2), *size), rng.integers(1, 6), self.pen, True)
        if rng.random() < 0.5:
            self.line([(440, 20), (452, 24), (446, 32)], 2.0, self.pen)

    def window(self, rng):
        """An annotation tool: a light window, icons in some colours, and the slice within."""
        inside = self.picture[40:560, 240:880].copy()
        self.picture[:] = flat(WINDOW, 235.0)
        self.picture[40:560, 240:880] = inside
        for k in range(int(rng.integers(4, 14))):
            icon = rectangle((20 + 17 * k, 14), *[int(rng.integers(8, 13))] * 2)
            self.line(icon, 2.0, PENS[0 if k % 3 else k], closed=True)
        self.text("cut plane", (20, 120), self.pen, 0.5)
        self.fill(rectangle((110, 200), 160, 18), PENS[int(rng.integers(20))])

    def handles(self, rng):
        """Knots as annotation tools draw them: round, square or hollow."""
        size, shape = int(rng.integers(2, 5)), int(rng.integers(3))
        knots = self.truth[::100]
        if rng.random() < 0.5:
            self.picture, self.truth = anatomy(SHAPE, len(knots)), knots
            self.line(knots, self.width, self.pen, closed=True)
        for knot in knots:
            if shape == 0:
                self.disc(knot, size + 0.5, self.pen)
            for side, colour in ((2 * size + 1, self.pen), (2 * size - 1, (255,) * 3))[:shape]:
                self.fill(rectangle(np.rint(knot), side, side), colour)


def outcome(picture, quality=None):
    """What becomes of a picture, and what was said; a wrong curve without a doubt is silent."""
    image, options, told = picture.image(quality), {}, ""
    for _ in range(2):
        try:
            found = extract_curve(image, **options)
        except CurveError as error:
            result, words = "refused", error.message
        else:
            words = "; ".join(f.text for f in found.findings if f.severity == "doubt")
            if picture.truth is not None and is_right(found.strokes[0].points, picture):
                return "right", words
            result = "asked" if words else "silent"
        told += f"{options} {words} | "
        advice = re.search(r"--colour '(#\w{6})'|--stroke (\d+)", words)
        if result == "silent" or advice is None:
            break
        options |= {"colour": advice[1]} if advice[1] else {"stroke": int(advice[2])}
    return result, told


def is_right(points, picture):
    """Whether a curve is all of the drawn line, to 0.3 px by median."""
    error = np.abs(normal_errors(points, picture.truth, picture.closed))
    far = cKDTree(points).query(polyline(picture.truth, picture.closed, 1.0))[0] > 2.5
    return np.median(error) <= 0.3 and max(far.mean(), (error > 2.5).mean()) <= 0.05


def table(seed, share=1.0):
    """{(kind, has a line): {outcome: count}}; prints what is not right."""
    counts = {}
    for kind, has_line in [(kind, True) for kind in LINES] + [(kind, False) for kind in EMPTY]:
        row = counts[kind, has_line] = Counter()
        number = (LINES if has_line else EMPTY)[kind]
        for k in range(seed, seed + int(share * number)):
            result, told = outcome(Picture(kind, k, has_line), None if k % 3 else 85)
            row[result] += 1
            if result == "silent" or (has_line and result != "right"):
                print(f"# {kind} {k}: {result}: {told}")
    return counts


if __name__ == "__main__":
    for (kind, has_line), row in table(int(sys.argv[1]) if sys.argv[1:] else 0).items():
        print(f"| {kind} | {'a line' if has_line else 'no line'} | {dict(row)} |")
