"""What would have made the arm stop: each kind, each joint, the first tick of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.arm.loop import LOST_SPEED_RAD_S, ArmMotion
from vfplan.arm.model import Arm
from vfplan.replaying.quantities import row_norms

Array = NDArray[np.float64]
SafetyStop = dict[str, Any]


def safety_stops(arm: Arm, motion: ArmMotion) -> list[SafetyStop]:
    """The limits of the arm that the motion crossed, in the order in which it would have stopped.

    Each has `tick`, `kind`, `joint` (from 1; absent where no joint is meant), `value` at that tick
    and `limit`. Kinds, named after the arm's own errors where it has them:

    - `controller_torque_discontinuity`: a commanded torque changed too much in a tick [N·m];
    - `joint_torque`, `joint_velocity`, `joint_position` [N·m], [rad/s], [rad];
    - `cartesian_reflex`: the force between hand and tip [N]; `cartesian_velocity` [m/s];
    - `lost`: the simulation left all bounds.
    """
    robot = arm.robot
    stops: list[SafetyStop] = []
    torque_steps = np.abs(np.diff(motion.torque, axis=0, prepend=0 * motion.torque[:1]))
    for kind, values, limits in (
        ("controller_torque_discontinuity", torque_steps, robot.torque_step_limit_nm),
        ("joint_torque", np.abs(motion.torque), robot.torque_limit_nm),
        ("joint_velocity", np.abs(motion.speed), robot.joint_speed_limit_rad_s),
    ):
        for j, limit in enumerate(limits or ()):
            over = values[:, j] > limit
            note_first(stops, kind, over, values[:, j], limit, joint=j + 1)
    for j in range(arm.joints):
        angles = motion.q[:, j]
        high = float(arm.high[j])
        low = float(arm.low[j])
        note_first(stops, "joint_position", angles > high, angles, high, joint=j + 1)
        note_first(stops, "joint_position", angles < low, angles, low, joint=j + 1)
    tip_speed = row_norms(np.diff(motion.tip, axis=0, append=motion.tip[-1:])) * robot.rate_hz
    for kind, values, limit in (
        ("cartesian_reflex", row_norms(motion.pull), robot.force_limit_n),
        ("cartesian_velocity", tip_speed, robot.speed_limit_m_s),
    ):
        if limit is not None:
            note_first(stops, kind, values > limit, values, limit)
    last = len(motion.q) - 1
    if not np.abs(motion.speed[last]).max() < LOST_SPEED_RAD_S:
        stops.append({"tick": last, "kind": "lost"})
    return sorted(stops, key=lambda stop: (stop["tick"], stop["kind"]))


def note_first(
    stops: list[SafetyStop],
    kind: str,
    is_over: NDArray[np.bool_],
    values: Array,
    limit: float,
    joint: int | None = None,
) -> None:
    """Append the first tick at which a limit is crossed, if there is one."""
    ticks = np.flatnonzero(is_over)
    if not len(ticks):
        return
    tick = int(ticks[0])
    stop: SafetyStop = {"tick": tick, "kind": kind}
    if joint is not None:
        stop["joint"] = joint
    stop |= {"value": float(values[tick]), "limit": limit, "ticks": len(ticks)}
    stops.append(stop)
