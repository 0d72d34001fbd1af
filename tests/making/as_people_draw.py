"""Slices as people draw them: arrows, labels and leader lines in the pen's colour, lifts, dots.

A person says by a click which line is meant. `places` are a place on the true line, and then the
ends of every stretch of it that shows no ink, in pairs.
"""

from __future__ import annotations

import numpy as np
from slices import (
    RED,
    Family,
    _begin,
    arc_of,
    by_name,
    direction,
    drawn,
    hand,
    part,
    parts_inside,
    pen,
    penned,
    turned,
)

WORDS = ("cut", "OSTEOTOMY", "A1", "resect")


def _clicked(curve, rng, *hidden):
    return curve, False, [curve[rng.integers(len(curve))], *hidden]


def arrow_that_touches(canvas, rng):
    curve, width = drawn(canvas, rng, margin=0.12)
    tip = curve[rng.integers(200, 1000)]
    back = turned(direction(curve), rng.uniform(1.0, 2.1)) * rng.choice([-1.0, 1.0])
    for angle, length in ((0, rng.uniform(50, 90)), (0.4, 12), (-0.4, 12)):
        canvas.line([tip, tip + length * turned(back, angle)], width, RED)
    return _clicked(curve, rng)


def label_on_the_line(canvas, rng):
    curve, _ = drawn(canvas, rng, margin=0.12)
    at = curve[rng.integers(200, 900)] + (-10, 5)
    canvas.text(rng.choice(WORDS), at, RED, rng.uniform(0.4, 0.7), int(rng.integers(1, 3)))
    return _clicked(curve, rng)


def leader_line(canvas, rng):
    """A straight line to a label goes on beyond a small gap at the end of the curve."""
    curve, width = drawn(canvas, rng, margin=0.12)
    out = turned(direction(curve[::-1]), rng.uniform(-0.5, 0.5))
    start = curve[0] + (width + rng.uniform(5, 14)) * out
    canvas.line([start, start + rng.uniform(30, 60) * out], width, RED)
    return _clicked(curve, rng)


def lifted_pen(canvas, rng):
    curve, width, length = penned(rng, margin=0.12)
    start, hidden = 0.0, []
    for middle in np.sort(rng.uniform(0.15, 0.85, 2)) * length:
        half = (width + rng.uniform(6, 40)) / 2
        if middle - half - start > 25:
            canvas.line(part(curve, start, middle - half), width, RED)
            start = middle + half
            hidden += [part(curve, 0, s)[-1] for s in (middle - half, start)]
    canvas.line(part(curve, start, length), width, RED)
    return _clicked(part(curve, 0, length), rng, *hidden)


def dots(canvas, rng):
    curve = hand(rng, margin=0.12)
    radius, step = rng.uniform(1.5, 3.0), rng.uniform(9, 14)
    for at in np.arange(0, arc_of(curve)[-1], step):
        canvas.disc(part(curve, 0, max(at, 0.5))[-1], radius, RED)
    return _clicked(part(curve, 0, at), rng)


def leaves(canvas, rng):
    """The end of the line is cut off by the picture's border."""
    curve, width = hand(rng, margin=0.12), pen(rng)
    at = curve[int(rng.integers(700, 1000))]
    border = [*at, *(canvas.shape[::-1] - at)]
    side = int(np.argmin(border))
    curve = curve + np.eye(2)[side % 2] * border[side] * (-1 if side < 2 else 1)
    curve = parts_inside(curve)[0]
    canvas.line(curve, width, RED)
    return _clicked(curve, rng)


def ends_that_overlap(canvas, rng, off_px=None):
    """The last stretch of a ring lies on or beside the first; with `off_px` they cross."""
    ring, width = hand(rng, True), pen(rng)
    count, over = len(ring), int(rng.integers(40, 120))
    share = np.linspace(-1, 1, count + over)
    inward = (ring.mean(0) - ring[0]) / np.hypot(*(ring.mean(0) - ring[0]))
    aside = np.abs(share) ** 8 * (np.sign(share) * rng.uniform(0, 3) if off_px is None else off_px)
    path = ring[np.arange(count + over) % count] + aside[:, None] * inward
    canvas.line(path, width, RED)
    # Closed half-way along the overlap, where ends cross that lie on one side.
    return path[over // 2 :][:count], True, [path[rng.integers(over + 60, count - 60)]]


def ends_that_cross(canvas, rng):
    return ends_that_overlap(canvas, rng, rng.uniform(12, 20))


KINDS = by_name(
    arrow_that_touches, label_on_the_line, leader_line, lifted_pen, dots, leaves,
    ends_that_overlap, ends_that_cross,
)  # fmt: skip
draw = Family(KINDS, {}, _begin).draw
