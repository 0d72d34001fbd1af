"""Guidance: the drawn curve as a ruler. A thin Python face over the native guide.

The tip is kept within a tube around the curve, or led along it. docs/guidance.md says how.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan import _core
from vfplan.engine.parameters import Vector, check_axis, check_points, number
from vfplan.engine.renderable import check_pieces
from vfplan.engine.ticks import Status, check_hip, check_path
from vfplan.errors import SceneError, SettingError
from vfplan.fixture import Pieces

Ends = Literal["stop", "open"]
ENDS: tuple[Ends, ...] = get_args(Ends)
Hold = Literal["at_once", "on_entry"]


@dataclass(frozen=True, eq=False)
class GuideTrace:
    """A path's answer, a row a tick.

    Parameters
    ----------
    proxy, force
        (T, 3) nearest place of the tube [m], the HIP's own where it is free; force on the hand [N].
    arc_m, lateral_m, remaining_m
        (T,) the place on the curve as arc length from its first point, the HIP's distance from
        that place, and what remains of the curve from there on [m].
    stroke
        (T,) int32, the curve followed.
    held
        (T,) bool, whether the guide has hold of the tip.
    status
        (T,) uint8, values of `Status`: `BAD_HIP`, or `LIMIT` where the place moves on in the next
        tick, as the force may change no faster.
    """

    proxy: Vector
    force: Vector
    arc_m: Vector
    lateral_m: Vector
    remaining_m: Vector
    stroke: NDArray[np.int32]
    held: NDArray[np.bool_]
    status: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.arc_m)

    def first(self) -> GuideStep:
        """The first tick's answer."""
        row = [getattr(self, field.name)[0] for field in fields(self)]
        return GuideStep(*row[:2], *(value.item() for value in row[2:-1]), Status(int(row[-1])))


@dataclass(frozen=True, eq=False)
class GuideStep:
    """One tick's answer: a row of a `GuideTrace`."""

    proxy: Vector
    force: Vector
    arc_m: float
    lateral_m: float
    remaining_m: float
    stroke: int
    held: bool
    status: Status


class Guide:
    """Keeps the tip within a tube around a curve: no force inside, K times the way back beyond.

    The guide keeps its place on the curve and moves it only along the curve, so that the force has
    no part along it and strands that run close by or cross change nothing. In a tick the force
    changes by at most K (|Δx| + 2e-5 m).

    Parameters
    ----------
    points
        (N, 3) the curve's points in order [m]; or several such curves, of which the one nearest at
        the start is followed, never changed under the hand. Or lines and arcs, across an axis: then
        `closed` is theirs.
    radius
        ρ of the tube [m]. One that runs into itself, where the curve turns round or another strand
        runs beside it, is refused, and so is a bend that is tighter than the tube is wide.
    closed
        Whether the last point joins the first; one truth, or one a curve.
    stiffness
        K beyond the tube [N/m].
    ends
        What an open curve's ends do: "stop" (a cap closes the tube) or "open" (the tip goes free,
        and what was left of the force dies down without giving energy).
    hold
        "at_once": from the first tick on, with whatever force that takes. "on_entry": once the tip
        is within the tube.
    cut_bends
        Takes bends tighter than the tube, with a warning: in the tube the tip may cut them.
    ignore_axis
        `None`, "x", "y", "z" or a (3,) direction along which curve and tube are infinite.
    lead_force, lead_speed
        A pull along the curve [N], towards its beginning when negative, that falls linearly to 0
        at this speed [m/s], and is 0 from ρ before the curve's end on.
    rate_hz
        Ticks a second, for that speed.

    Raises
    ------
    SettingError
        A parameter outside its range, or a radius that the curve does not allow.
    SceneError
        Points that make no curve.
    """

    def __init__(
        self,
        points: ArrayLike | Sequence[ArrayLike] | Pieces,
        radius: float,
        closed: bool | Sequence[bool] = False,
        stiffness: float = 1000.0,
        *,
        ends: Ends = "stop",
        hold: Hold = "at_once",
        cut_bends: bool = False,
        ignore_axis: str | ArrayLike | None = None,
        lead_force: float = 0.0,
        lead_speed: float = 0.02,
        rate_hz: float = 1000.0,
    ) -> None:
        native = _core.GuideParameters()
        native.radius = number("radius", radius, "m", least=1e-9, most=1e6)
        native.stiffness = number("stiffness", stiffness, "N/m", above=0.0)
        native.ends = getattr(_core.Ends, _one_of("ends", ends, ENDS))
        native.hold = getattr(_core.Hold, _one_of("hold", hold, get_args(Hold)))
        native.cut_bends = bool(cut_bends)
        native.lead_force = number("lead_force", lead_force, "N")
        native.lead_speed = number("lead_speed", lead_speed, "m/s", above=0.0)
        native.period = 1 / number("rate_hz", rate_hz, "Hz", above=0.0)
        self.ignore_axis = check_axis(ignore_axis)
        if self.ignore_axis is not None:
            native.set_ignore_axis(self.ignore_axis)
        self.radius, self.stiffness, self.ends = native.radius, native.stiffness, ends
        self.closed, curves = _curves(points, closed, self.ignore_axis)
        try:
            self._guide = _core.Guide(*curves, native)
        except ValueError as error:
            kind = SettingError if "radius" in str(error) else SceneError
            raise kind(str(error).removeprefix("vfplan: ")) from None
        if (tight := self.tight_bend) is not None:
            warnings.warn(tight, stacklevel=2)

    @classmethod
    def of(cls, fixture: Any, *, hold: Hold = "on_entry", cut_bends: bool = True) -> Guide:
        """The guide that a fixture's guidance asks for.

        Raises
        ------
        SceneError
            A fixture without guidance.
        SettingError
            A tube that runs into itself.
        """
        guidance = fixture.guidance
        if guidance is None:
            raise SceneError("the fixture has no guidance")
        drawn = np.arange(len(fixture.curve.closed))
        chosen = drawn == (drawn if guidance.stroke is None else guidance.stroke)
        if fixture.pieces is not None and fixture.ignore_axis is not None:
            curves: Any = fixture.pieces.of(chosen)
        else:
            curves = [fixture.points[fixture.curve.stroke == s] for s in drawn[chosen]]
        return cls(
            curves,
            guidance.radius,
            fixture.curve.closed[chosen].tolist(),
            guidance.stiffness,
            ends=guidance.ends,
            hold=hold,
            cut_bends=cut_bends,
            ignore_axis=fixture.ignore_axis,
            lead_force=guidance.lead_force or 0.0,
            lead_speed=guidance.lead_speed or 0.02,
        )

    @property
    def native(self) -> _core.Guide:
        """The guide behind it, which checks nothing."""
        return self._guide

    @property
    def lengths_m(self) -> list[float]:
        """Length of each curve [m]."""
        return self._guide.lengths

    @property
    def tight_bend(self) -> str | None:
        """Where a bend is tighter than the tube is wide, in words; `None`: nowhere."""
        found = self._guide.tight_bend()
        if found is None:
            return None
        stroke, arc, at = found
        place = ", ".join(f"{1e3 * v:.4g}" for v in at)
        return (
            f"guide radius {1e3 * self.radius:g} mm: stroke {stroke} bends more tightly at arc "
            f"{1e3 * arc:.4g} mm, [{place}] mm; the tip may cut that corner"
        )

    def at(self, arc_m: ArrayLike, stroke: int = 0) -> Vector:
        """The curve's points (M, 3) at arc lengths (M,) [m]; across an ignored axis."""
        return self._guide.at(stroke, np.atleast_1d(np.asarray(arc_m, float)).tolist())

    def reset(self, hip: ArrayLike) -> None:
        """The tip is at `hip` (3,) [m]: take the nearest place, and hold it as `hold` says."""
        self._guide.reset(check_hip(hip, finite=True))

    def step(self, hip: ArrayLike) -> GuideStep:
        """One servo loop for the HIP at `hip` (3,) [m]."""
        return self.run(check_hip(hip)[None]).first()

    def run(self, hips: ArrayLike) -> GuideTrace:
        """One tick for each row of `hips` (T, 3) [m], from where the guide is; no GIL held."""
        return GuideTrace(*self._guide.run(check_path(hips)))


def _curves(points: Any, closed: Any, axis: Vector | None) -> tuple[tuple[bool, ...], tuple]:
    """Which are closed, and the curves as the native guide takes them."""
    if isinstance(points, Pieces):
        if axis is None:
            raise SettingError("lines and arcs: only across an ignored axis")
        return tuple(points.closed.tolist()), check_pieces(points)
    strokes = _strokes(points)
    closing = [closed] * len(strokes) if np.isscalar(closed) else [bool(c) for c in closed]
    if len(closing) != len(strokes):
        raise SettingError(f"closed: {len(closing)} values for {len(strokes)} curves")
    return tuple(closing), (np.vstack(strokes), [len(stroke) for stroke in strokes], closing)


def _strokes(points: ArrayLike | Sequence[ArrayLike]) -> list[Vector]:
    single = isinstance(points, np.ndarray) and points.dtype != object
    if not single and (not isinstance(points, Sequence | np.ndarray) or len(points) == 0):
        raise SceneError(f"points {points!r:.60}: allowed is (N, 3), or a sequence of such")
    if single or np.ndim(np.asarray(points[0], object)) == 1:
        return [check_points(points)]
    return [check_points(stroke) for stroke in points]


def _one_of(name: str, value: str, allowed: tuple[str, ...]) -> str:
    if value not in allowed:
        raise SettingError(f"{name} {value!r}: allowed are {', '.join(allowed)}")
    return value
