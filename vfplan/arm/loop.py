"""The loop of a rehearsal: a hand moves a simulated arm that renders a fixture, tick by tick.

One tick: read the tip, let the engine answer, govern, and turn the force into torques, which act
`delay_ticks` later; the hand, which is no computer, acts at once. Gravity is compensated, as the
arm does by itself; Coulomb and viscous friction are the joints' own.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.arm.mjcf import mujoco
from vfplan.arm.model import Arm
from vfplan.engine.governor import Governor
from vfplan.engine.proxy import ProxyEngine

Array = NDArray[np.float64]

CHECK_TICKS = 256
"""Number of ticks from one report of progress, and one check of the joints' speed, to the next."""

LOST_SPEED_RAD_S = 100.0
"""Largest speed of a joint [rad/s]. In a simulation that left all bounds a joint turns faster."""


@dataclass(frozen=True)
class ArmHand:
    """A hand that pulls the tip to the session's place, and the tool to how it was at the start.

    Parameters
    ----------
    stiffness
        Stiffness of the spring that pulls to the place [N/m].
    damping
        Damping against the tip's speed beside the place's [N·s/m].
    turn_stiffness
        Stiffness against turning the tool [N·m/rad].
    turn_damping
        Damping against turning the tool [N·m·s/rad].
    """

    stiffness: float = 600.0
    damping: float = 25.0
    turn_stiffness: float = 6.0
    turn_damping: float = 0.4


@dataclass(frozen=True, eq=False)
class ArmMotion:
    """What happened, one row a tick.

    Parameters
    ----------
    tip, proxy, normal
        (T, 3) the tip as the tick began and the proxy [m], the contact's normal.
    rendered, force
        (T, 3) the engine's force and the force that was commanded [N].
    pull
        (T, 3) the hand's force on the tip [N].
    q, speed
        (T, n) joint angles [rad] and their speeds [rad/s] as the tick began.
    torque
        (T, n) the torques that were commanded [N·m].
    state, status, governed
        (T,) of the engine, its status, and the governor's.
    """

    tip: Array
    proxy: Array
    normal: Array
    rendered: Array
    force: Array
    pull: Array
    q: Array
    speed: Array
    torque: Array
    state: NDArray[np.int8]
    status: NDArray[np.uint8]
    governed: NDArray[np.uint8]

    @classmethod
    def empty(cls, ticks: int, joints: int) -> ArmMotion:
        """Rows of zeros, to be filled."""
        in_space = np.zeros((6, ticks, 3))
        of_joints = np.zeros((3, ticks, joints))
        return cls(
            *in_space,
            *of_joints,
            state=np.zeros(ticks, np.int8),
            status=np.zeros(ticks, np.uint8),
            governed=np.zeros(ticks, np.uint8),
        )

    def first(self, ticks: int) -> ArmMotion:
        """The first rows."""
        rows = {name: values[:ticks] for name, values in vars(self).items()}
        return ArmMotion(**rows)


def run_loop(
    arm: Arm,
    engine: ProxyEngine,
    governor: Governor | None,
    places: Array,
    start: Array,
    hand: ArmHand,
    done: Callable[[int], None] | None = None,
) -> ArmMotion:
    """Run the loop over the places (T, 3) [m] that the hand wants, from posture `start` (n,) [rad].

    `done`, if given, is called with the number of ticks just run. The run ends early, with fewer
    rows, where the simulation leaves all bounds.
    """
    # Everything that a tick needs is bound to a name here: the loop runs a thousand times a second.
    mj = mujoco()
    model = arm.model
    data = arm.data
    ticks = len(places)
    joints = arm.joints
    rows = ArmMotion.empty(ticks, joints)
    torque_limit = None
    if arm.robot.torque_limit_nm is not None:
        torque_limit = np.asarray(arm.robot.torque_limit_nm)
    place_speed = np.gradient(places, 1 / arm.robot.rate_hz, axis=0)
    arm.hold(start)
    tip, rotation, jacobian = arm.read_tip()
    position_jacobian = jacobian[:3]
    rotation_jacobian = jacobian[3:]
    jacobian_transposed = jacobian.T
    joint_speed = data.qvel
    site = arm.site
    wrench = np.zeros(6)
    twist = np.zeros(3)
    start_quaternion = np.zeros(4)
    quaternion = np.zeros(4)
    mj.mju_mat2Quat(start_quaternion, rotation.ravel())
    engine_step = engine.native.step
    native_governor = governor.native if governor is not None else None
    delayed = deque([np.zeros(joints)] * arm.robot.delay_ticks)
    engine.reset(tip)

    for k in range(ticks):
        # The robot: position, force, torques.
        mj.mj_step1(model, data)
        mj.mj_jacSite(model, data, position_jacobian, rotation_jacobian, site)
        answer, rows.state[k], rows.status[k] = engine_step(tip)
        rows.proxy[k], rows.normal[k], rows.rendered[k] = answer
        if native_governor is None:
            rows.force[k] = rows.rendered[k]
            rows.torque[k] = position_jacobian.T @ rows.rendered[k]
        else:
            rows.force[k], _, rows.governed[k] = native_governor.step(
                rows.rendered[k], position_jacobian
            )
            rows.torque[k] = native_governor.torque(joints)
        torque = rows.torque[k]
        if torque_limit is not None:
            torque = np.minimum(np.maximum(torque, -torque_limit), torque_limit)
        delayed.append(torque)

        # The hand: a force to the place, and a torque against turning.
        mj.mju_mat2Quat(quaternion, data.site_xmat[site])
        mj.mju_subQuat(twist, start_quaternion, quaternion)
        tip_speed = jacobian @ joint_speed
        wrench[:3] = hand.stiffness * (places[k] - tip)
        wrench[:3] -= hand.damping * (tip_speed[:3] - place_speed[k])
        wrench[3:] = hand.turn_stiffness * (rotation @ twist) - hand.turn_damping * tip_speed[3:]

        rows.q[k] = data.qpos
        rows.speed[k] = joint_speed
        rows.tip[k] = tip
        rows.pull[k] = wrench[:3]
        data.qfrc_applied[:] = delayed.popleft() + jacobian_transposed @ wrench
        mj.mj_step2(model, data)

        if k % CHECK_TICKS == CHECK_TICKS - 1:
            if done is not None:
                done(CHECK_TICKS)
            # The comparison is false for a speed that is no number, too.
            if not np.abs(joint_speed).max() < LOST_SPEED_RAD_S:
                return rows.first(k + 1)
    return rows
