"""Drawn slices whose line ends in the open or under a grey box, as the input of a review sheet."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from canvas import Canvas
from drawing import anatomy
from slices import SHAPE, drawn, part, tail

from vfplan import PlannedImage
from vfplan.curve.account import AccountEntry
from vfplan.fixture import Fixture, Provenance, Stroke
from vfplan.review.markers import Marker
from vfplan.review.plan import Outcome, Plan


@dataclass
class Drawn:
    """A slice, the visible part of its line, the pen's width, and the box over the end if any.

    `box` is (u, v, width, height): its first pixel and its size.
    """

    image: np.ndarray
    line: np.ndarray
    width: float
    box: tuple[int, int, int, int] | None


def draw(seed, *, covered="end", tone=None):
    """A hand-drawn line; a box hides 35 to 60 px of it at its "start", its "end" or nowhere."""
    rng = np.random.default_rng([seed, 36])
    canvas = Canvas(anatomy(SHAPE, int(rng.integers(1000))), "exact")
    line, width = drawn(canvas, rng)
    hidden_length = rng.uniform(35, 60)
    box = None
    if covered:
        at_end = covered == "end"
        hidden = tail(line, hidden_length) if at_end else part(line, 0, hidden_length)
        low = np.floor(hidden.min(0) - rng.uniform(3, 8)).astype(int)
        high = np.ceil(hidden.max(0) + rng.uniform(3, 8)).astype(int)
        grey = rng.choice([0.0, 255.0, 60.0, 110.0, 160.0]) if tone is None else tone
        canvas.box((low + high) / 2, *(high - low + 1), (float(grey),) * 3)
        box = (*low, *(high - low + 1))
        inside = ((line >= low - 0.5) & (line <= high + 0.5)).all(axis=1)
        outside = np.flatnonzero(~inside)
        line = line[: outside[-1] + 1] if at_end else line[outside[0] :]
    return Drawn(canvas.image(None), line, width, tuple(map(int, box)) if box else None)


def shown_of(image, *strokes, **values):
    """A slice with its lines, as a sheet shows them, and what else shall be on the sheet."""
    points = np.pad(np.concatenate([stroke.points for stroke in strokes]), ((0, 0), (0, 1)))
    sha256 = "ab" * 32
    provenance = Provenance("2026-01-02T03:04:05Z", "vfplan", {"image": sha256})
    fixture = Fixture("image", points, provenance)
    shown = Plan.of(fixture, "slice.png", PlannedImage(image, None, sha256))
    return with_values(shown, **{"strokes": strokes, "account": (), **values})


def with_values(shown, **values):
    """The same with values in place of those that follow from the plan."""
    other = copy(shown)
    if "findings" in values:
        fixture = replace(shown.fixture, findings=values.pop("findings"))
        values |= {"fixture": fixture, "outcome": Outcome(fixture, fixture.findings)}
    vars(other).update(values)
    return other


def shown(drawn, **values):
    """A drawn slice whose visible line was taken."""
    sigma = np.full(len(drawn.line), 0.1)
    return shown_of(drawn.image, Stroke(drawn.line, False, sigma, width=drawn.width), **values)


def markers(rng, shape, count):
    """Markers anywhere on a slice, with residuals of a pixel or so."""
    height, width = shape[:2]
    places = rng.uniform((2, 2), (width - 3, height - 3), (count, 2))
    residuals = rng.normal(0, 0.7, (count, 2))
    return tuple(
        Marker(f"M{k}", place, (), (), k != 3, 0.0, 5e-4 * float(np.hypot(*residual)), residual)
        for k, (place, residual) in enumerate(zip(places, residuals, strict=True))
    )


def account(rng, shape, count):
    """Pieces of other ink anywhere on a slice."""
    height, width = shape[:2]
    places = [(rng.uniform(0, width - 1), rng.uniform(0, height - 1)) for _ in range(count)]
    return tuple(
        AccountEntry(k, u, v, 91 - k, 0.01, 9.0, "ink") for k, (u, v) in enumerate(places, 1)
    )
