"""Curves with a cover without colour over an end, a letter at it, or a dot beside; no vfplan here.

Such a cover is told by its edge and its evenness, not by its colour, so that some go unseen: these
kinds stand apart from those of `slices`, of which none may be silently wrong.
"""

from __future__ import annotations

import numpy as np
from canvas import rectangle
from slices import RED, arc_of, hand, normal_of, part, pen


def _over_the_end(canvas, rng):
    """A drawn curve, and the box that hides its last 35 to 90 px, half of them on whole pixels."""
    curve = hand(rng)
    canvas.line(curve, pen(rng), RED)
    length = arc_of(curve)[-1]
    hidden = part(curve, length - rng.uniform(35, 90), length)
    low, high = hidden.min(0) - rng.uniform(4, 14), hidden.max(0) + rng.uniform(4, 14)
    if rng.integers(2):
        low, high = np.rint(low) - 0.5, np.rint(high) + 0.5
    return curve, ((low + high) / 2, *(high - low))


def _tone(rng):
    return float(rng.choice([0.0, 255.0, rng.uniform(40, 215)]))


def box_over_the_end(canvas, rng, opacity=1.0, words=False):
    """White, black or grey."""
    curve, (at, width, height) = _over_the_end(canvas, rng)
    tone, before = _tone(rng), canvas.picture
    canvas.box(at, width, height, (tone,) * 3)
    if words:
        for v in np.arange(at[1] - height / 2 + 12, at[1] + height / 2, 16):
            text = "Lt 12 mm cut"[: max(1, int((width - 6) / 9))]
            ink = (0.0 if tone > 127 else 255.0,) * 3
            canvas.text(text, (at[0] - width / 2 + 3, v), ink, 0.4)
    canvas.picture = (1 - opacity) * before + opacity * canvas.picture
    return curve, False


def framed_box_over_the_end(canvas, rng):
    curve, (at, width, height) = _over_the_end(canvas, rng)
    tone = _tone(rng)
    canvas.box(at, width, height, (tone,) * 3)
    canvas.line(rectangle(at, width, height), 1.0, (255 - tone,) * 3, True)
    return curve, False


def panel_over_the_end(canvas, rng):
    """Words on white, black or grey."""
    return box_over_the_end(canvas, rng, words=True)


def veil_over_the_end(canvas, rng):
    """Half to four fifths opaque: the ink shows through."""
    return box_over_the_end(canvas, rng, opacity=rng.uniform(0.5, 0.8))


def disc_over_the_end(canvas, rng):
    """White, black or grey, as large as what it hides."""
    curve, (at, width, height) = _over_the_end(canvas, rng)
    canvas.disc(at, np.hypot(width, height) / 2, (_tone(rng),) * 3)
    return curve, False


def turned_box_over_the_end(canvas, rng):
    """At any angle."""
    curve, (at, width, height) = _over_the_end(canvas, rng)
    turn, size = rng.uniform(0, np.pi / 2), np.hypot(width, height)
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    canvas.fill(at + rectangle((0, 0), size, size) @ axes, (_tone(rng),) * 3)
    return curve, False


def _patch_over_the_end(canvas, rng, look):
    """A box with the grey levels that `look` gives for (rows, columns)."""
    curve, (at, width, height) = _over_the_end(canvas, rng)
    before = canvas.picture
    canvas.box(at, width, height, (255.0,) * 3)
    white = canvas.picture
    canvas.picture = before
    canvas.box(at, width, height, (0.0,) * 3)
    share = (white - canvas.picture) / 255
    grey = look(*np.mgrid[: before.shape[0], : before.shape[1]])
    canvas.picture = before * (1 - share) + share * grey[..., None]
    return curve, False


def hatched_box_over_the_end(canvas, rng):
    """In stripes of two greys."""
    pitch, tones = int(rng.integers(3, 7)), (_tone(rng), _tone(rng))
    return _patch_over_the_end(canvas, rng, lambda v, u: np.where((u + v) // pitch % 2, *tones))


def shaded_box_over_the_end(canvas, rng):
    """From dark to bright, as a grey scale."""
    low, high = rng.uniform(0, 100), rng.uniform(150, 255)
    return _patch_over_the_end(canvas, rng, lambda v, u: low + (high - low) * v / v.max())


def letter_at_the_end(canvas, rng):
    """A letter in the pen's colour that the curve runs into."""
    curve, width = hand(rng), pen(rng)
    canvas.line(curve, width, RED)
    way = (curve[-1] - curve[-10]) / np.hypot(*(curve[-1] - curve[-10]))
    at = curve[-1] + (width / 2 + rng.uniform(3, 7)) * way
    canvas.text("LATxK"[int(rng.integers(5))], np.add(at, (-5, 6)), RED, rng.uniform(0.4, 0.6))
    return curve, False


def dot_beside(canvas, rng):
    """A dot of the same pen that touches the line from one side."""
    curve, width = hand(rng), float(rng.choice([3.0, 4.0, 5.0]))
    at = int(rng.uniform(0.3, 0.7) * len(curve))
    radius = width * rng.uniform(1.2, 1.8)
    canvas.line(curve, width, RED)
    canvas.disc(curve[at] + rng.uniform(0.7, 0.9) * radius * normal_of(curve)[at], radius, RED)
    return curve, False


HIDDEN = {
    f.__name__.replace("_", " "): f
    for f in (
        box_over_the_end, framed_box_over_the_end, panel_over_the_end, disc_over_the_end,
        turned_box_over_the_end, veil_over_the_end, hatched_box_over_the_end,
        shaded_box_over_the_end, letter_at_the_end, dot_beside,
    )
}  # fmt: skip
