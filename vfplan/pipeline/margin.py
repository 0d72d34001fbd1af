"""A safety margin against registration error: a thicker fixture, or a curve moved to one side."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, SettingError
from vfplan.fixture import Curve, Fixture

if TYPE_CHECKING:
    from vfplan.pipeline.settings import FixtureSettings
    from vfplan.registration import Registration

Array = NDArray[np.float64]
Side = Literal["both", "left", "right", "inside", "outside"]
SIDES: tuple[Side, ...] = ("both", "left", "right", "inside", "outside")
# A moved point nearer to the drawn curve than this share of its margin lies inside a bend.
_KEPT = 0.98
_TANGENT = 2  # samples to both sides over which the direction is taken


@dataclass(frozen=True)
class Margin:
    """What was added, as the report has it.

    Parameters
    ----------
    side
        "both": the points' radius grew; else the side the curve moved to.
    largest_m, smallest_m
        The margin along the curve [m]; equal for "both".
    dropped
        Samples of the moved curve left out, because they fell inside a tight bend.
    """

    side: Side
    largest_m: float
    smallest_m: float
    dropped: int = 0

    @property
    def report(self) -> dict[str, Any]:
        """For `--json`."""
        data = {"kind": "tre95", "side": self.side, "largest_m": self.largest_m}
        if self.side == "both":
            return data | {"added_point_radius_m": self.largest_m}
        return data | {"smallest_m": self.smallest_m, "samples_dropped": self.dropped}


def add_margin(
    curve: Fixture, registration: Registration, settings: FixtureSettings
) -> tuple[Fixture, FixtureSettings, Margin | None]:
    """The curve and the settings with the margin that `settings.margin` asks for.

    "tre95" is the bound that the registration's error stays within over the whole curve with
    probability 0.95. On side "both" its largest value is added to the point radius r_v; on one side
    each sample moves there, in the slice's plane, by the bound at that sample.

    Raises
    ------
    SettingError
        An unknown margin or side, or a side that this curve does not have.
    CurveError
        A margin that leaves nothing of a stroke.
    """
    if settings.margin is None:
        return curve, settings, None
    if settings.margin != "tre95":
        raise SettingError(f"margin is {settings.margin!r}; 'tre95' or none is allowed")
    if settings.margin_side not in SIDES:
        allowed = ", ".join(SIDES)
        raise SettingError(f"margin side is {settings.margin_side!r}; allowed: {allowed}")
    bound = registration.tre95_curve_m(curve.points)
    if settings.margin_side == "both":
        largest = float(bound.max())
        thicker = replace(settings, point_radius=settings.point_radius + largest)
        return curve, thicker, Margin("both", largest, largest)
    moved, kept = _moved(curve, registration, bound, settings.margin_side)
    margin = Margin(
        settings.margin_side, float(bound.max()), float(bound.min()), int((~kept).sum())
    )
    return moved, settings, margin


def _moved(
    curve: Fixture, registration: Registration, bound: Array, side: Side
) -> tuple[Fixture, NDArray[np.bool_]]:
    """The curve with every sample moved to one side, and which samples were kept."""
    if registration.source.shape[1] != 2 or curve.curve is None:
        raise SettingError(
            f"a margin on side {side!r} needs an ordered curve drawn in a plane; use side 'both'"
        )
    a = registration.T_target_source[:3, :2]
    points, kept = curve.points.copy(), np.zeros(len(curve.points), dtype=bool)
    for k, closed in enumerate(curve.curve.closed):
        own = np.flatnonzero(curve.curve.stroke == k)
        drawn = curve.points[own, :2]
        across = _to_side(drawn, bool(closed), side, a)
        shift = across * bound[own, None]
        moved = drawn + shift @ np.linalg.pinv(a).T
        good = _clear(drawn @ a.T, bool(closed), drawn @ a.T + shift, bound[own])
        if good.sum() < 2:
            raise CurveError(
                f"a margin of {bound.max() * 1e3:.3f} mm to the {side} leaves nothing of stroke {k}"
            )
        points[own, :2] = moved
        kept[own] = good
    bridged = curve.curve.bridged
    stroke = Curve(
        curve.curve.stroke[kept],
        curve.curve.closed,
        None if bridged is None else bridged[kept],
    )
    sigma = None if curve.sigma is None else curve.sigma[kept]
    return replace(curve, points=points[kept], sigma=sigma, curve=stroke), kept


def _to_side(drawn: Array, closed: bool, side: Side, a: Array) -> Array:
    """(M, 3) unit vectors in the slice's plane, across the curve, to the side asked for.

    Left and right are those of who follows the drawn curve from its start, seen in the image (u to
    the right, v down).
    """
    if len(drawn) < 2:
        raise CurveError("a stroke of one sample has no sides; use margin side 'both'")
    if closed:
        step = np.roll(drawn, -_TANGENT, axis=0) - np.roll(drawn, _TANGENT, axis=0)
    else:
        index = np.arange(len(drawn))
        ahead = np.minimum(index + _TANGENT, len(drawn) - 1)
        step = drawn[ahead] - drawn[np.maximum(index - _TANGENT, 0)]
    if side in ("inside", "outside"):
        if not closed:
            raise SettingError(f"an open curve has no {side}; margin side left, right or both")
        u, v = drawn.T
        clockwise = (u * np.roll(v, -1) - v * np.roll(u, -1)).sum() > 0
        side = "right" if clockwise == (side == "inside") else "left"
    tangent = step @ a.T
    normal = np.cross(a[:, 0], a[:, 1])
    left = np.cross(tangent, normal)
    left /= np.maximum(np.linalg.norm(left, axis=1, keepdims=True), np.finfo(float).tiny)
    return left if side == "left" else -left


def _clear(drawn: Array, closed: bool, moved: Array, bound: Array) -> NDArray[np.bool_]:
    """(M,) bool: moved points that keep their margin from all of the drawn curve.

    Where a curve bends tighter than the margin, points moved to the hollow side cross over.
    """
    from scipy.spatial import cKDTree

    ring = np.vstack([drawn, drawn[:1]]) if closed else drawn
    steps = np.linalg.norm(np.diff(ring, axis=0), axis=1)
    pieces = int(np.clip(np.ceil(steps.max() / (0.1 * bound.min())), 1, 200))
    part = np.arange(pieces) / pieces
    fine = (ring[:-1, None] + np.diff(ring, axis=0)[:, None] * part[None, :, None]).reshape(-1, 3)
    distance, _ = cKDTree(np.vstack([fine, ring[-1:]])).query(moved)
    return distance >= _KEPT * bound
