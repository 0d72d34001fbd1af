"""A fixture that moves: its frame, from a tracker's poses, and an engine that steps in it.

The C++ class of `vfplan/moving.hpp` does the work. Both give the same bits.
"""

from __future__ import annotations

import sys
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vfplan import _core
from vfplan.engine.guide import Guide, GuideTrace
from vfplan.engine.parameters import MAX_COORDINATE, Vector, core_settings, real_array, real_number
from vfplan.engine.proxy import Trace, check_hip, check_path
from vfplan.errors import SceneError

# How far an entry of RᵀR may be from that of the unit matrix. A tracker's file has six digits.
RIGID_TOLERANCE = 1e-6

# Largest absolute time [s]. Differences of such times do not overflow.
MAX_TIME_S = sys.float_info.max / 2


class MovingFrame:
    """Where a tracked fixture is at each tick, from poses that come late, noisy, or not at all.

    The frame goes evenly from each pose to the next, one sample late, and never faster than it is
    allowed to. There is no predictor. An engine steps in the fixture's frame, so that K and an
    ignored axis turn with the fixture.

    Parameters
    ----------
    max_age_s
        From this age of the youngest pose on the frame is `stale`, and its last place stands [s].
    max_speed_m_s, max_turn_rad_s
        Largest speed of the pivot, and of the frame's turning about it.
    pivot
        (3,) a place in the fixture's frame near where the tool works [m]. A place away from it also
        moves by its distance times `max_turn_rad_s`.

    Raises
    ------
    SettingError
        A limit out of range.
    SceneError
        A pivot that is no finite position.
    """

    def __init__(
        self,
        max_age_s: float = 0.1,
        max_speed_m_s: float = 0.25,
        max_turn_rad_s: float = 1.0,
        *,
        pivot: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        with core_settings(max_age="s", max_speed="m_s", max_turn="rad_s"):
            self.max_speed_m_s = real_number("max_speed_m_s", max_speed_m_s)
            self.max_turn_rad_s = real_number("max_turn_rad_s", max_turn_rad_s)
            # The native frame, which checks nothing.
            self.native = _core.MovingFrame(
                real_number("max_age_s", max_age_s),
                self.max_speed_m_s,
                self.max_turn_rad_s,
                check_hip(pivot, "pivot", finite=True),
            )

    def pose(self, t: float, base_from_fixture: ArrayLike) -> bool:
        """Take the fixture's pose (4, 4) [m] at time `t` [s] of the loop's clock.

        Returns False, and counts it in `refused`, for a pose that is further than 100 m from the
        base, that is not younger than the last one, or that finds 64 others waiting. After one
        stray time, the third of poses in order is taken.

        Raises
        ------
        SceneError
            No rigid transform, or one beyond 1e6 m.
        """
        return self.native.pose(check_time(t), check_rigid(base_from_fixture))

    def reset(self) -> None:
        """Forget all poses and ticks, while no other thread uses the frame."""
        self.native.reset()

    def at(self, t: float) -> Vector:
        """The frame (4, 4) at `t` [s]; the identity before any pose.

        If `t` goes back, the frame stays where it is and is `stale`.
        """
        return matrices(self.native.at(check_time(t)).reshape(1, 7))[0]

    def step(self, engine: Any, t: float, hip: ArrayLike) -> Any:
        """One tick, at `t` [s], of an engine or a `Guide` that is in the fixture's frame.

        HIP and answer, a `Step` or a `GuideStep`, are in the base. Before the first pose nothing is
        rendered. Unless `t` is later than in the step before, the fixture stands still and the
        status has `STALE`; so a second engine needs a frame of its own.
        """
        return self.traced(engine, [t], check_hip(hip)[None])[0].first()

    def traced(
        self, engine: Any, times: ArrayLike, hips: ArrayLike
    ) -> tuple[Any, Vector, Vector, Vector | None]:
        """One tick a row, at `times` (T,) [s] for `hips` (T, 3) [m], and what the frame did.

        Returns
        -------
        trace
            A `Trace` or a `GuideTrace`.
        poses
            (T, 7) the frames: position [m] and unit quaternion w x y z.
        ages
            (T,) age of the youngest pose [s].
        micros
            (T,) time that the engine's tick took [µs]; `None` for a guide, which is not timed.
        """
        t = real_array(times, "times")
        path = check_path(hips)
        if t.shape != (len(path),):
            raise SceneError(
                f"times has shape {t.shape}. Give one time for each of the {len(path)} positions."
            )
        if not np.isfinite(t).all() or (np.diff(t) < 0).any():
            raise SceneError(
                "times are not finite, or go back. Give finite times in the order of the ticks."
            )
        answers, poses, ages = self.native.run(engine.native, t, path)
        poses = poses.reshape(-1, 7)
        if isinstance(engine, Guide):
            return GuideTrace(*answers), poses, ages, None
        return Trace(*answers[:5]), poses, ages, 1e6 * answers[5]

    @property
    def stale(self) -> bool:
        """Whether there is no pose yet, or the youngest is older than `max_age_s`.

        It is also true for a pose from a clock that is ahead by more than that, and after a time of
        the loop that was not later than the one before.
        """
        return self.native.stale

    def lag_m(self, place: ArrayLike) -> float:
        """How far the fixture still has to go at `place`, to where its youngest pose puts it [m].

        It exceeds the motion of one sample when the poses move faster than the frame may. It is
        infinite before the first pose, and where `place` is not finite.

        place
            (3,) in the base [m], e.g. the HIP.
        """
        return self.native.lag(check_hip(place, "place"))

    @property
    def refused(self) -> int:
        """Number of poses that were not taken."""
        return self.native.refused


def matrices(poses: Vector) -> Vector:
    """(T, 4, 4) the matrices of poses (T, 7): position [m] and unit quaternion w x y z."""
    from scipy.spatial.transform import Rotation

    out = np.tile(np.eye(4), (len(poses), 1, 1))
    out[:, :3, :3] = Rotation.from_quat(np.roll(poses[:, 3:], -1, axis=1)).as_matrix()
    out[:, :3, 3] = poses[:, :3]
    return out


def check_time(t: float) -> float:
    """One time [s] as a float; raises `SceneError` for anything that is no finite number."""
    if not isinstance(t, Real) or not -MAX_TIME_S < t < MAX_TIME_S:
        raise SceneError(f"time is {t!r} s. Give a finite number.")
    return float(t)


def check_rigid(pose: ArrayLike) -> Vector:
    """A rigid transform as (4, 4) float64; raises `SceneError` for anything else."""
    matrix = real_array(pose, "pose")
    if matrix.shape != (4, 4):
        raise SceneError(f"pose has shape {matrix.shape}. Give a matrix of shape (4, 4).")
    if not is_rigid(matrix):
        raise SceneError(
            f"pose {matrix.tolist()} is no rigid transform within {MAX_COORDINATE:g} m. Give a "
            "rotation and a position in metres."
        )
    return matrix


def is_rigid(matrix: Vector) -> bool:
    """Whether a matrix (4, 4) is a rotation and a translation within 1e6 m."""
    rotation = matrix[:3, :3]
    return bool(
        np.abs(matrix).max() <= MAX_COORDINATE  # NaN is refused too.
        and np.abs(rotation.T @ rotation - np.eye(3)).max() < RIGID_TOLERANCE
        and np.linalg.det(rotation) > 0
        and np.array_equal(matrix[3], [0, 0, 0, 1])
    )
