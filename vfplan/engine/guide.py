"""Guidance: the drawn curve as a ruler.

The tip is kept within a tube around the curve, or led along it. docs/guidance.md says how. The
native guide does the work.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from vfplan import _core
from vfplan.engine.parameters import (
    Vector,
    check_axis,
    check_pieces,
    check_points,
    core_settings,
    number,
    one_of,
    real_number,
)
from vfplan.engine.proxy import Status, check_hip, check_path
from vfplan.errors import SceneError, SettingError
from vfplan.fixture import Fixture, Pieces

Ends = Literal["stop", "open"]
Hold = Literal["at_once", "on_entry"]

ENDS = get_args(Ends)
HOLDS = get_args(Hold)


@dataclass(frozen=True, eq=False)
class GuideStep:
    """The answer of one tick.

    Parameters
    ----------
    proxy, force
        (3,) nearest place of the tube [m], the HIP's own where it is free; force on the hand [N].
    arc_m
        The place on the curve as arc length from its first point [m].
    lateral_m
        The HIP's distance from that place [m].
    remaining_m
        What remains of the curve from that place on [m].
    stroke
        The curve that is followed.
    held
        Whether the guide holds the tip.
    status
        A `Status`: `BAD_HIP`, or `LIMIT` where the place moves on in the next tick, as the force
        may change no faster.
    """

    proxy: Vector
    force: Vector
    arc_m: float
    lateral_m: float
    remaining_m: float
    stroke: int
    held: bool
    status: Status


class GuideTrace(GuideStep):
    """The answer to a path: the fields of `GuideStep`, with one row a tick.

    `stroke` is (T,) int32, `held` (T,) bool and `status` (T,) uint8.
    """

    def __len__(self) -> int:
        return len(self.arc_m)

    def first(self) -> GuideStep:
        """The answer of the first tick."""
        figures = [getattr(self, name)[0].item()
                   for name in ("arc_m", "lateral_m", "remaining_m", "stroke", "held")]  # fmt: skip
        return GuideStep(self.proxy[0], self.force[0], *figures, Status(int(self.status[0])))


class Guide:
    """Keeps the tip within a tube around a curve: no force inside, K times the way back beyond.

    The guide keeps its place on the curve and moves it only along the curve. The force therefore
    has no part along the curve, and strands that run close by or cross change nothing. In a tick
    the force changes by at most K (|Δx| + 2e-5 m).

    Parameters
    ----------
    points
        (N, 3) the curve's points in order [m], or several such curves. The guide follows the one
        that is nearest at the start, and never changes it. Or lines and arcs across an ignored
        axis, which say themselves whether they are closed.
    radius
        ρ of the tube [m]. A tube that runs into itself is refused, because the curve turns round or
        another strand runs beside it. So is a bend that is tighter than the tube is wide.
    closed
        Whether the last point joins the first: one bool, or one a curve.
    stiffness
        K beyond the tube [N/m].
    ends
        What the ends of an open curve do. "stop": a cap closes the tube. "open": the tip goes free,
        and what remains of the force dies down without giving energy.
    hold
        "at_once": from the first tick on, with whatever force that takes. "on_entry": once the tip
        is within the tube.
    cut_bends
        Whether to take bends that are tighter than the tube, with a warning. The tip may then cut
        them.
    ignore_axis
        `None`, "x", "y", "z" or a (3,) direction along which curve and tube are infinite.
    lead_force, lead_speed
        A pull along the curve [N], towards its beginning when negative. It falls linearly to 0 at
        this speed [m/s], and is 0 from ρ before the curve's end on.
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
        self.radius = real_number("radius", radius)
        self.stiffness = real_number("stiffness", stiffness)
        self.ends = one_of("ends", ends, ENDS)
        self.hold = one_of("hold", hold, HOLDS)
        self.cut_bends = bool(cut_bends)
        self.ignore_axis = check_axis(ignore_axis)
        self.lead_force = real_number("lead_force", lead_force)
        self.lead_speed = real_number("lead_speed", lead_speed)
        self.period = 1 / number("rate_hz", rate_hz, "Hz", above=0.0)
        # So far the guide holds its parameters alone, by the names that the core has for them.
        parameters = _core.GuideParameters(**vars(self))
        if isinstance(points, Pieces):
            if self.ignore_axis is None:
                raise SettingError(
                    "ignore_axis is None, and lines and arcs guide only across an ignored axis. "
                    "Name the axis, or give points."
                )
            self.closed = tuple(points.closed.tolist())
            self.curves = check_pieces(points)
        else:
            strokes = check_strokes(points)
            closings = check_closed(closed, len(strokes))
            self.closed = tuple(closings)
            self.curves = np.vstack(strokes), [len(stroke) for stroke in strokes], closings
        with core_settings():
            try:
                # The native guide, which checks nothing.
                self.native = _core.Guide(*self.curves, parameters)
            except _core.OutOfRange:
                raise
            except ValueError as error:
                # The core names the radius where the tube does not fit the curve.
                kind = SettingError if "radius" in str(error) else SceneError
                raise kind(str(error).removeprefix("vfplan: ")) from None
        # Length of each curve [m].
        self.lengths_m = self.native.lengths
        if self.tight_bend is not None:
            warnings.warn(self.tight_bend, stacklevel=2)

    @classmethod
    def of(cls, fixture: Fixture, *, hold: Hold = "on_entry", cut_bends: bool = True) -> Guide:
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
            raise SceneError(
                "the fixture has no guidance. Plan one with a guide, or render this one with "
                "vfplan.ProxyEngine.of."
            )
        numbers = np.arange(len(fixture.curve.closed))
        is_guide = numbers >= 0 if guidance.stroke is None else numbers == guidance.stroke
        if fixture.pieces is not None and fixture.ignore_axis is not None:
            curves = fixture.pieces.of(is_guide)
        else:
            curves = [fixture.strokes[number].points for number in np.flatnonzero(is_guide)]
        return cls(
            curves,
            guidance.radius,
            fixture.curve.closed[is_guide].tolist(),
            guidance.stiffness,
            ends=guidance.ends,
            hold=hold,
            cut_bends=cut_bends,
            ignore_axis=fixture.ignore_axis,
            lead_force=guidance.lead_force or 0.0,
            lead_speed=guidance.lead_speed or 0.02,
        )

    @property
    def tight_bend(self) -> str | None:
        """Where a bend is tighter than the tube is wide, in words; `None` where none is."""
        bend = self.native.tight_bend()
        if bend is None:
            return None
        stroke, arc, place = bend
        listed = ", ".join(f"{1e3 * coordinate:.4g}" for coordinate in place)
        return (
            f"guide radius {1e3 * self.radius:g} mm: stroke {stroke} bends more tightly at arc "
            f"{1e3 * arc:.4g} mm, [{listed}] mm, and the tip may cut that corner. Take a smaller "
            "radius if it must not."
        )

    def at(self, arc_m: ArrayLike, stroke: int = 0) -> Vector:
        """(M, 3) the curve's places at arc lengths (M,) [m]."""
        return self.native.at(stroke, np.atleast_1d(np.asarray(arc_m, float)).tolist())

    def reset(self, hip: ArrayLike) -> None:
        """Take the curve's place nearest to `hip` (3,) [m], and hold the tip as `hold` says."""
        self.native.reset(check_hip(hip, finite=True))

    def step(self, hip: ArrayLike) -> GuideStep:
        """One tick for the HIP at `hip` (3,) [m]."""
        return self.run(check_hip(hip)[None]).first()

    def run(self, hips: ArrayLike) -> GuideTrace:
        """One tick for each row of `hips` (T, 3) [m], from the guide's present place on.

        Other threads of Python run meanwhile.
        """
        return GuideTrace(*self.native.run(check_path(hips)))


def check_strokes(points: ArrayLike | Sequence[ArrayLike]) -> list[Vector]:
    """One curve (N, 3), or a sequence of such, as a list of curves [m].

    Raises `SceneError` for anything else.
    """
    if isinstance(points, np.ndarray) and points.dtype != object:
        return [check_points(points)]
    if not isinstance(points, Sequence | np.ndarray) or len(points) == 0:
        raise SceneError(f"points is {points!r:.60}. Give (N, 3), or a sequence of such curves.")
    strokes = points if np.ndim(np.asarray(points[0], object)) > 1 else [points]
    return [check_points(stroke) for stroke in strokes]


def check_closed(closed: bool | Sequence[bool], count: int) -> list[bool]:
    """Whether each of `count` curves is closed; raises `SettingError` for another number."""
    if np.isscalar(closed):
        return [closed] * count
    if len(closed) != count:
        raise SettingError(
            f"closed has {len(closed)} values for {count} curves. Give one for each curve, or one "
            "for all."
        )
    return [bool(value) for value in closed]
