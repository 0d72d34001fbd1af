"""A fixture that moves: its frame, from a tracker's poses, and an engine that steps in it.

A thin Python face over `vfplan/moving.hpp`, which has the same words; the same bits come out.
"""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vfplan import _core
from vfplan.engine.guide import Guide, GuideTrace
from vfplan.engine.parameters import Vector, number, real_array
from vfplan.engine.ticks import Status, Step, Trace, check_hip, check_path
from vfplan.errors import SceneError

RIGID = 1e-6  # how far RᵀR may be from 1


class MovingFrame:
    """Where a tracked fixture is, tick by tick, from poses that come late, noisy, or not at all.

    From each pose to the next the frame goes evenly, one sample late, and never faster than it is
    told. There is no predictor. An engine steps in the fixture's frame: K and an ignored axis turn
    with the fixture.

    Parameters
    ----------
    max_age_s
        Age of the youngest pose from which on it is told as `stale`: the last frame then stands.
    max_speed_m_s, max_turn_rad_s
        Largest speed of the pivot, and of the frame's turning about it.
    pivot
        (3,) in the fixture's frame [m], near where the tool works: what is further off moves by its
        distance times `max_turn_rad_s` besides.

    Raises
    ------
    SettingError, SceneError
        A limit or a pivot out of range.
    """

    def __init__(
        self,
        max_age_s: float = 0.1,
        max_speed_m_s: float = 0.25,
        max_turn_rad_s: float = 1.0,
        *,
        pivot: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        self._frame = _core.MovingFrame(
            number("max_age_s", max_age_s, "s", above=0.0, most=10.0),
            number("max_speed_m_s", max_speed_m_s, "m/s", above=0.0, most=10.0),
            number("max_turn_rad_s", max_turn_rad_s, "rad/s", above=0.0, most=100.0),
            check_hip(pivot, "pivot", finite=True),
        )

    def pose(self, t: float, base_from_fixture: ArrayLike) -> bool:
        """The fixture's pose (4, 4) [m] at time `t` [s], on the loop's clock.

        False, and counted in `refused`, for one that is not younger than the last, or of which 64
        wait already.

        Raises
        ------
        SceneError
            No rigid transform, or one beyond 1e6 m.
        """
        return self._frame.pose(_time(t), _rigid(base_from_fixture))

    def at(self, t: float) -> Vector:
        """The frame (4, 4) at `t` [s], which does not go back; the identity before any pose."""
        return matrices(self._frame.at(_time(t)).reshape(1, 7))[0]

    def step(self, engine: Any, t: float, hip: ArrayLike) -> Any:
        """One servo loop at `t` [s] of an engine, or a `Guide`, that is in the fixture's frame.

        HIP and answer, a `Step` or a `GuideStep`, are in the base. Before the first pose nothing is
        rendered.
        """
        trace = self.run(engine, [t], check_hip(hip)[None])
        if isinstance(trace, GuideTrace):
            return trace.first()
        return Step(
            *(rows[0] for rows in (trace.proxy, trace.normal, trace.force)),
            int(trace.state[0]),
            Status(int(trace.status[0])),
        )

    def run(self, engine: Any, times: ArrayLike, hips: ArrayLike) -> Any:
        """One tick a row, at `times` (T,) [s] for `hips` (T, 3) [m]."""
        return self.traced(engine, times, hips)[0]

    def traced(
        self, engine: Any, times: ArrayLike, hips: ArrayLike
    ) -> tuple[Any, Vector, Vector, Vector | None]:
        """As `run`, with the frames (T, 7), place and quaternion w x y z, their ages, and µs.

        Of a guide no times are taken.
        """
        t, path = real_array(times, "times"), check_path(hips)
        if t.shape != (len(path),):
            raise SceneError(f"times of shape {t.shape}: allowed is ({len(path)},)")
        if not np.isfinite(t).all() or (np.diff(t) < 0).any():
            raise SceneError("times: allowed are finite numbers that do not go back")
        answers, poses, ages = self._frame.run(engine.native, t, path)
        if isinstance(engine, Guide):
            return GuideTrace(*answers), poses.reshape(-1, 7), ages, None
        return Trace(*answers[:5]), poses.reshape(-1, 7), ages, 1e6 * answers[5]

    @property
    def native(self) -> _core.MovingFrame:
        """The frame behind it, which checks nothing."""
        return self._frame

    @property
    def stale(self) -> bool:
        """No pose yet, one older than `max_age_s`, or one from a clock that is that much ahead."""
        return self._frame.stale

    @property
    def age_s(self) -> float:
        """Age of the youngest pose at the last tick [s]; infinite before the first."""
        return self._frame.age

    @property
    def refused(self) -> int:
        """Poses that were not taken."""
        return self._frame.refused


def matrices(poses: Vector) -> Vector:
    """(T, 4, 4) of (T, 7), position and unit quaternion w x y z."""
    w, x, y, z = poses[:, 3:].T
    out = np.zeros((len(poses), 4, 4))
    out[:, 0, :3] = np.stack((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)), 1)
    out[:, 1, :3] = np.stack((2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)), 1)
    out[:, 2, :3] = np.stack((2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)), 1)
    out[:, :3, 3] = poses[:, :3]
    out[:, 3, 3] = 1
    return out


def _time(t: float) -> float:
    if not isinstance(t, Real) or not -1e300 < t < 1e300:
        raise SceneError(f"time {t!r} s: allowed is a finite number")
    return float(t)


def _rigid(pose: ArrayLike) -> Vector:
    matrix = real_array(pose, "pose")
    if matrix.shape != (4, 4):
        raise SceneError(f"pose of shape {matrix.shape}: allowed is (4, 4)")
    turn = matrix[:3, :3]
    if not (
        np.abs(matrix).max() <= 1e6
        and np.abs(turn.T @ turn - np.eye(3)).max() < RIGID
        and np.linalg.det(turn) > 0
        and np.array_equal(matrix[3], [0, 0, 0, 1])
    ):
        raise SceneError(f"pose {matrix.tolist()}: allowed is a rigid transform within 1e6 m")
    return matrix
