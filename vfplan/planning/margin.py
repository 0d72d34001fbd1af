"""A safety margin against registration error: a thicker fixture, or a curve moved to one side."""

from __future__ import annotations

from dataclasses import dataclass, replace
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, SettingError
from vfplan.fixture import Curve, Fixture

if TYPE_CHECKING:
    from vfplan.planning.settings import FixtureSettings
    from vfplan.registration import Registration

Array = NDArray[np.float64]
Side = Literal["both", "left", "right", "inside", "outside"]
SIDES: tuple[Side, ...] = ("both", "left", "right", "inside", "outside")
# A moved point nearer to the drawn curve than this share of its margin lies inside a bend.
_KEPT = 0.98
CORNER = 0.5  # radians turned at one sample: more is a corner, less a smooth bend
ARC_STEP = 0.15  # radians between the samples of an arc around a corner


@dataclass(frozen=True)
class Margin:
    """What was added, as the report has it."""

    kind: str  # "tre95", or "given" for a number of metres
    side: Side  # "both": the points' radius grew; else the side the curve moved to
    # The margin along the curve [m]; equal for "both"
    largest_m: float
    smallest_m: float
    dropped: int = 0  # samples of the moved curve left out, because they fell inside a tight bend

    @property
    def report(self) -> dict[str, Any]:
        """For `--json`."""
        data = {"kind": self.kind, "side": self.side, "largest_m": self.largest_m}
        if self.side == "both":
            return data | {"added_point_radius_m": self.largest_m}
        return data | {"smallest_m": self.smallest_m, "samples_dropped": self.dropped}


def add_margin(
    curve: Fixture, registration: Registration, settings: FixtureSettings
) -> tuple[Fixture, FixtureSettings, Margin]:
    """The curve and the settings with the margin that `settings.margin` asks for.

    "tre95" is the bound that the registration's error stays within over the whole curve with
    probability 0.95; a number is a margin [m], the same everywhere. On side "both" its largest
    value is added to the point radius r_v; on one side each sample moves there, in the slice's
    plane, by the margin at that sample.

    Raises SettingError: an unknown margin or side, or a side that this curve does not have
    Raises CurveError: a margin that leaves nothing of a stroke
    """
    given = settings.margin
    number = isinstance(given, Real) and not isinstance(given, bool)
    if given != "tre95" and not (number and 0 <= given < np.inf):
        raise SettingError(f"margin is {given!r}; metres of at least 0, 'tre95' or none is allowed")
    if settings.margin_side not in SIDES:
        allowed = ", ".join(SIDES)
        raise SettingError(f"margin side is {settings.margin_side!r}; allowed: {allowed}")
    if given != "tre95":
        kind, bound = "given", np.full(len(curve.points), float(given))
    else:
        kind, bound = "tre95", registration.tre95_curve_m(curve.points)
    if settings.margin_side == "both":
        # Up to the next nanometre: an id must not depend on a processor's last bit.
        largest = float(np.ceil(bound.max() * 1e9) / 1e9)
        thicker = replace(settings, point_radius=settings.point_radius + largest)
        return curve, thicker, Margin(kind, "both", largest, largest)
    moved, dropped = _moved(curve, registration, bound, settings.margin_side)
    margin = Margin(kind, settings.margin_side, float(bound.max()), float(bound.min()), dropped)
    return moved, settings, margin


def _moved(
    curve: Fixture, registration: Registration, bound: Array, side: Side
) -> tuple[Fixture, int]:
    """The curve moved to one side, and how many of its samples were dropped."""
    if registration.source.shape[1] != 2 or curve.curve is None:
        raise SettingError(
            f"a margin on side {side!r} needs an ordered curve drawn in a plane; use side 'both'"
        )
    a = registration.T_target_source[:3, :2]
    back = np.linalg.pinv(a).T
    places, samples, dropped = [], [], 0
    for k, closed in enumerate(curve.curve.closed):
        own = np.flatnonzero(curve.curve.stroke == k)
        drawn = curve.points[own, :2]
        line = drawn @ a.T
        index, across = _to_side(line, bool(closed), _turn(drawn, bool(closed), side, a))
        moved = line[index] + across * bound[own[index], None]
        good = _clear(line, bool(closed), moved, bound[own[index]])
        if good.sum() < 2:
            raise CurveError(
                f"a margin of {bound.max() * 1e3:.3f} mm to the {side} leaves nothing of stroke {k}"
            )
        dropped += len(own) - len(np.unique(index[good]))
        places.append(moved[good] @ back)
        samples.append(own[index[good]])
    taken = np.concatenate(samples)
    points = curve.points[taken]
    points[:, :2] = np.concatenate(places)
    strokes = Curve(curve.curve.stroke[taken], curve.curve.closed)
    for name in ("bridged", "edited"):
        flags = getattr(curve.curve, name)
        if flags is not None:
            strokes = replace(strokes, **{name: flags[taken]})
    sigma = None if curve.sigma is None else curve.sigma[taken]
    return replace(curve, points=points, sigma=sigma, curve=strokes), dropped


def _turn(drawn: Array, closed: bool, side: Side, a: Array) -> Array:
    """(3,) axis about which a quarter turn takes the curve's direction to the side asked for.

    Left and right are those of who follows the drawn curve from its start, seen in the image (u to
    the right, v down).
    """
    if side in ("inside", "outside"):
        if not closed:
            raise SettingError(f"an open curve has no {side}; margin side left, right or both")
        u, v = drawn.T
        clockwise = (u * np.roll(v, -1) - v * np.roll(u, -1)).sum() > 0
        side = "right" if clockwise == (side == "inside") else "left"
    normal = np.cross(a[:, 0], a[:, 1])
    normal /= np.linalg.norm(normal)
    return normal if side == "right" else -normal


def _to_side(line: Array, closed: bool, axis: Array) -> tuple[NDArray[np.intp], Array]:
    """Directions to the side: the sample each belongs to (K,), and a vector (K, 3).

    A sample where the curve hardly turns has one, as long as keeps its neighbours' straight pieces
    at full distance; one where it turns sharply away has several unit ones, an arc around it.
    """
    steps = np.diff(np.vstack([line, line[:1]]) if closed else line, axis=0)
    length = np.linalg.norm(steps, axis=1)
    if not (length > 0).any():
        raise CurveError("a stroke without length has no sides; use margin side 'both'")
    alive = np.flatnonzero(length > 0)
    ahead = alive[np.minimum(np.searchsorted(alive, np.arange(len(line))), len(alive) - 1)]
    before = alive[np.maximum(np.searchsorted(alive, np.arange(len(line)), "left") - 1, 0)]
    if closed:
        before = np.where(np.arange(len(line)) <= alive[0], alive[-1], before)
    across = np.cross(axis, steps / np.maximum(length, np.finfo(float).tiny)[:, None])
    first, last = across[before], across[ahead]
    # Positive where the curve turns away from the side, so that the moved one has to open up.
    angle = -np.arctan2(np.cross(first, last) @ axis, (first * last).sum(axis=1))
    count = np.where(angle > CORNER, np.ceil(angle / ARC_STEP).astype(int) + 1, 1)
    index = np.repeat(np.arange(len(line)), count)
    place = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
    part = np.where(count[index] > 1, place / np.maximum(count[index] - 1, 1), 0.5)
    turned = -part * angle[index]
    vectors = (
        first[index] * np.cos(turned)[:, None]
        + np.cross(axis, first[index]) * np.sin(turned)[:, None]
    )
    mitre = np.where(count == 1, 1 / np.cos(np.clip(angle, -CORNER, CORNER) / 2), 1.0)
    return index, vectors * mitre[index, None]


def _clear(drawn: Array, closed: bool, moved: Array, bound: Array) -> NDArray[np.bool_]:
    """(M,) bool: moved points that keep their margin from all of the drawn curve.

    Where a curve bends tighter than the margin, points moved to the hollow side cross over.
    """
    from scipy.spatial import cKDTree

    ring = np.vstack([drawn, drawn[:1]]) if closed else drawn
    steps = np.linalg.norm(np.diff(ring, axis=0), axis=1)
    finest = max(0.1 * bound.min(), 1e-12)  # no margin asks for no finer one
    pieces = int(np.clip(np.ceil(steps.max() / finest), 1, 200))
    part = np.arange(pieces) / pieces
    fine = (ring[:-1, None] + np.diff(ring, axis=0)[:, None] * part[None, :, None]).reshape(-1, 3)
    distance, _ = cKDTree(np.vstack([fine, ring[-1:]])).query(moved)
    return distance >= _KEPT * bound
