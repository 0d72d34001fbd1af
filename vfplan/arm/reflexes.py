"""What would have made the arm stop: each kind, each joint, the first tick of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.arm.loop import Motion
from vfplan.arm.model import Arm
from vfplan.replaying.quantities import row_norms

Array = NDArray[np.float64]
Reflex = dict[str, Any]


def reflexes(arm: Arm, motion: Motion) -> list[Reflex]:
    """The limits of the arm that the motion crossed, in the order in which it would have stopped.

    Each has `tick`, `kind`, `joint` (from 1; absent where no joint is meant), `value` at that tick
    and `limit`. Kinds, named after the arm's own errors where it has them:

    - `controller_torque_discontinuity`: a commanded torque changed too much in a tick [N·m];
    - `joint_torque`, `joint_velocity`, `joint_position` [N·m], [rad/s], [rad];
    - `cartesian_reflex`: the force between hand and tip [N]; `cartesian_velocity` [m/s];
    - `lost`: the simulation left all bounds.
    """
    robot, found = arm.robot, []
    steps = np.abs(np.diff(motion.torque, axis=0, prepend=0 * motion.torque[:1]))
    for kind, values, limits in (
        ("controller_torque_discontinuity", steps, robot.torque_step_limit_nm),
        ("joint_torque", np.abs(motion.torque), robot.torque_limit_nm),
        ("joint_velocity", np.abs(motion.speed), robot.joint_speed_limit_rad_s),
    ):
        for j, limit in enumerate(limits or ()):
            found += _first(kind, values[:, j], limit, j)
    for j in range(arm.joints):
        found += _first("joint_position", motion.q[:, j], float(arm.high[j]), j)
        found += _first("joint_position", motion.q[:, j], float(arm.low[j]), j, below=True)
    velocity = row_norms(np.diff(motion.tip, axis=0, append=motion.tip[-1:])) * robot.rate_hz
    found += _first("cartesian_reflex", row_norms(motion.pull), robot.force_limit_n)
    found += _first("cartesian_velocity", velocity, robot.speed_limit_m_s)
    last = len(motion.q) - 1
    if not np.abs(motion.speed[last]).max() < 100.0:
        found.append({"tick": last, "kind": "lost"})
    return sorted(found, key=lambda reflex: (reflex["tick"], reflex["kind"]))


def _first(
    kind: str, values: Array, limit: float | None, joint: int | None = None, *, below: bool = False
) -> list[Reflex]:
    if limit is None:
        return []
    over = np.flatnonzero(values < limit if below else values > limit)
    if not len(over):
        return []
    k = int(over[0])
    named = {} if joint is None else {"joint": joint + 1}
    return [
        {"tick": k, "kind": kind, **named, "value": float(values[k]), "limit": limit}
        | {"ticks": len(over)}
    ]
