"""What stands around a drawn line in published pictures, and pictures that hold nothing else.

Bars on the picture's edge, colour scales, boxes, windows of annotation tools, twenty pens, filled
outlines and outlines with handles. A person takes at most two steps: what comes out at once, or
else what the first advice gives. Nothing but `outcome` uses vfplan.

    python tests/making/surroundings.py [SEED]    prints the table of 300 pictures
"""

from __future__ import annotations

import re
import sys
from collections import Counter

import cv2
import numpy as np
from canvas import RASTERISERS, Canvas, rectangle
from drawing import anatomy, flat, normal_errors, polyline
from scipy.spatial import cKDTree

PENS = (
    *("#ff0000", "#dc143c", "#d62728", "#ffa500", "#ff7f0e", "#ffd700", "#ffff00", "#7fff00"),
    *("#00ff00", "#2ca02c", "#00ff7f", "#40e0d0", "#00ffff", "#00bfff", "#1e90ff", "#1f77b4"),
    *("#0000ff", "#800080", "#ff00ff", "#e0209c"),
)
MAPS = ("autumn", "hot", "jet", "turbo", "hsv")
SHAPE, WINDOW = (420, 480), (600, 900)
# Error across a right line [px], by median, and the share of the true line that it may miss.
RIGHT_PX, MISSING_SHARE = 0.3, 0.05


def rgb(pen):
    return tuple(int(pen[k : k + 2], 16) for k in (1, 3, 5))


class Picture(Canvas):
    """A slice of one kind, with what was drawn on it: `truth`, (M, 2) px or `None`."""

    def __init__(self, kind, seed, has_line):
        self.rng = rng = np.random.default_rng([seed, *kind.encode()])
        window = kind == "window"
        super().__init__(anatomy(WINDOW if window else SHAPE, seed), str(rng.choice(RASTERISERS)))
        # Most planners draw in red; the pens have a kind of their own.
        self.pen = rgb(PENS[seed % len(PENS) if kind == "pen" or rng.random() < 0.4 else 0])
        self.width, self.truth = float(rng.choice([1.5, 2.0, 3.0, 4.0, 5.0])), None
        self.closed = bool(kind in ("fill", "handles") or rng.random() < 0.5)
        if has_line:
            self.truth = self.hand(window)
            if kind == "fill":
                share = np.zeros(self.shape, np.uint8)
                cv2.fillPoly(share, [np.rint(16 * self.truth).astype(int)], 255, cv2.LINE_AA, 4)
                self.paint(share / 255 * rng.uniform(0.1, 0.5), self.pen)
            self.line(self.truth, self.width, self.pen, self.closed)
        if kind not in ("pen", "fill"):
            getattr(self, kind)()

    def hand(self, window):
        """A smooth ring, or two thirds of it, around the middle."""
        rng, angle = self.rng, np.linspace(0, 2 * np.pi, 900, endpoint=False)
        radius = 100 + sum(
            rng.normal(0, 18 / k) * np.cos(k * angle + rng.uniform(0, 6)) for k in (2, 3, 4)
        )
        ring = radius[:, None] * np.column_stack([1.2 * np.cos(angle), np.sin(angle)])
        middle = (560, 290) if window else (230, 210)
        return (ring + middle)[: None if self.closed else 600]

    def bar(self):
        """Flush with the picture's border, whole or in part, with a lighter part inside."""
        rng, (height, width) = self.rng, self.shape
        side, thick = int(rng.integers(4)), int(rng.integers(2, 25))
        start, stop = sorted(rng.uniform(0, 1, 2)) if rng.random() < 0.5 else (0, 1)
        long = height if side % 2 else width
        start, stop = int(start * long), int(max(stop * long, start * long + 60))
        part = [slice(start, stop), slice(0, thick)]
        if side >= 2:
            part[1] = slice((width if side % 2 else height) - thick, None)
        strip = self.picture[tuple(part if side % 2 else part[::-1])]
        strip[:] = 0.2 * strip + 0.8 * np.array(self.pen)

    def scale(self):
        """A colour map, upright or level, with or without a frame."""
        import matplotlib

        rng, colours = self.rng, matplotlib.colormaps[MAPS[int(self.rng.integers(5))]]
        thick, long = int(rng.integers(8, 31)), int(rng.integers(120, 330))
        strip = np.repeat(255 * colours(np.linspace(1, 0, long))[:, None, :3], thick, axis=1)
        place = 440 - int(rng.integers(0, 12)), 40
        if rng.random() < 0.3:
            strip, place = strip.transpose(1, 0, 2), (60, 385)
        (u, v), (rows, columns) = place, strip.shape[:2]
        self.picture[v : v + rows, u : u + columns] = strip[:, : SHAPE[1] - u]

    def box(self):
        """Around a part of the picture, with a small icon beside it."""
        rng = self.rng
        size = rng.uniform(60, 150, 2) if self.truth is None else rng.uniform(330, 350, 2)
        at = rng.uniform(200, 230, 2)
        self.line(rectangle(at, *size), float(rng.integers(1, 6)), self.pen, closed=True)
        if rng.random() < 0.5:
            self.line([(440, 20), (452, 24), (446, 32)], 2.0, self.pen)

    def window(self):
        """An annotation tool: a light window, icons in some colours, and the slice within."""
        rng, inside = self.rng, self.picture[40:560, 240:880].copy()
        self.picture[:] = flat(WINDOW, 235.0)
        self.picture[40:560, 240:880] = inside
        for k in range(int(rng.integers(4, 14))):
            at, size = (20 + 17 * k, 14), int(rng.integers(8, 13))
            self.line(rectangle(at, size, size), 2.0, rgb(PENS[0 if k % 3 else k]), closed=True)
        self.text("cut plane", (20, 120), self.pen, 0.5)
        self.fill(rectangle((110, 200), 160, 18), rgb(PENS[int(rng.integers(20))]))

    def handles(self):
        """Knots as annotation tools draw them: round, square or hollow."""
        size, shape = int(self.rng.integers(2, 5)), int(self.rng.integers(3))
        if self.rng.random() < 0.5:
            self.picture = anatomy(SHAPE, len(self.truth))
            self.truth = self.truth[::100]
            self.line(self.truth, self.width, self.pen, closed=True)
        for at in self.truth if len(self.truth) < 20 else self.truth[::90]:
            if shape == 0:
                self.disc(at, size + 0.5, self.pen)
                continue
            self.box_at(np.rint(at), 2 * size + 1, self.pen)
            if shape == 2:
                self.box_at(np.rint(at), 2 * size - 1, (255, 255, 255))

    def box_at(self, at, side, colour):
        self.fill(rectangle(at, side, side), colour)


# Kind: how many pictures with a line, and how many without.
KINDS = {"pen": (40, 0), "fill": (40, 0), "handles": (40, 0), "bar": (20, 30), "scale": (20, 30),
         "box": (20, 15), "window": (20, 25)}  # fmt: skip


def is_right(found, picture):
    """Whether the first curve is the drawn line."""
    points = found.strokes[0].points_px
    error = np.abs(normal_errors(points, picture.truth, picture.closed))
    missing = cKDTree(points).query(polyline(picture.truth, picture.closed, 1.0))[0] > 2.5
    return (
        np.median(error) <= RIGHT_PX and max(missing.mean(), (error > 2.5).mean()) <= MISSING_SHARE
    )


def outcome(picture, quality=None):
    """ "right", "silent" (a wrong curve without a doubt), "asked" or "refused", and why."""
    from vfplan import extract_curve
    from vfplan.errors import CurveError

    image, options, told = picture.image(quality), {}, ""
    for _ in range(2):
        try:
            found = extract_curve(image, **options)
        except CurveError as error:
            result, words = "refused", f"{error.code}: {error.message}"
        else:
            doubts = [finding for finding in found.findings if finding.severity == "doubt"]
            words = "; ".join(f"{doubt.code}: {doubt.text}" for doubt in doubts)
            if picture.truth is not None and is_right(found, picture):
                return "right", words
            result = "asked" if doubts else "silent"
        told += f"{options} {words} | "
        advice = re.search(r"--colour '(#\w{6})'|--stroke (\d+)", words)
        if result == "silent" or advice is None:
            break
        options |= {"colour": advice[1]} if advice[1] else {"stroke": int(advice[2])}
    return result, told


def main(seed=0):
    counts = Counter()
    for kind, numbers in KINDS.items():
        for has_line, number in zip((True, False), numbers, strict=True):
            for k in range(seed, seed + number):
                result, told = outcome(Picture(kind, k, has_line), None if k % 3 else 85)
                counts[kind, has_line, result] += 1
                if result != "right" and (has_line or result == "silent"):
                    print(f"# {kind} {k} {has_line}: {result}: {told}")
    print("| kind | line | right | silent | asked | refused |\n|---|---|---|---|---|---|")
    for kind, has_line in dict.fromkeys(key[:2] for key in counts):
        cells = (counts[kind, has_line, name] for name in ("right", "silent", "asked", "refused"))
        print(f"| {kind} | {'yes' if has_line else 'no'} | {' | '.join(map(str, cells))} |")


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
