"""The loop of a rehearsal: a hand moves a simulated arm that renders a fixture, tick by tick.

One tick: read the tip, let the engine answer, govern, and turn the force into torques, which act
`delay_ticks` later; the hand, which is no computer, acts at once. Gravity is compensated, as the
arm does by itself; Coulomb and viscous friction are the joints' own.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.arm.mjcf import mujoco
from vfplan.arm.model import Arm
from vfplan.engine.governor import Governor
from vfplan.engine.proxy import ProxyEngine

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Hand:
    """A hand that wants the tip where the session is, and the tool as it held it at the start.

    Parameters
    ----------
    stiffness, damping
        Of its spring to the place [N/m], and of its damper against the place's speed [N·s/m].
    turn_stiffness, turn_damping
        The same against turning the tool [N·m/rad], [N·m·s/rad].
    """

    stiffness: float = 600.0
    damping: float = 25.0
    turn_stiffness: float = 6.0
    turn_damping: float = 0.4


@dataclass(frozen=True, eq=False)
class Motion:
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


def move(
    arm: Arm,
    engine: ProxyEngine,
    governor: Governor | None,
    wanted: Array,
    start: Array,
    hand: Hand,
    done: Any = None,
) -> Motion:
    """Run the loop over the places `wanted` (T, 3) [m] from posture `start` (n,) [rad].

    `done`, if given, is called with the number of ticks just run. The run ends early, with fewer
    rows, where the simulation leaves all bounds.
    """
    mj, model, data = mujoco(), arm.model, arm.data
    ticks, n = len(wanted), arm.joints
    rows3, rows_n = np.zeros((6, ticks, 3)), np.zeros((3, ticks, n))
    tips, proxies, normals, rendereds, forces, pulls = rows3
    qs, torques, speeds = rows_n
    state = np.zeros(ticks, np.int8)
    status, governed = np.zeros(ticks, np.uint8), np.zeros(ticks, np.uint8)
    limits = arm.robot.torque_limit_nm
    most = None if limits is None else np.asarray(limits)
    speed = np.gradient(wanted, 1 / arm.robot.rate_hz, axis=0)
    arm.hold(start)
    tip, turn, J = arm.look()
    site, qvel, qpos, applied = arm.site, data.qvel, data.qpos, data.qfrc_applied
    jp, jr, JT, wrench, twist = J[:3], J[3:], J.T, np.zeros(6), np.zeros(3)
    held, now = np.zeros(4), np.zeros(4)
    mj.mju_mat2Quat(held, turn.ravel())
    render = engine.native.step
    hold = None if governor is None else governor.native
    waiting = deque([np.zeros(n)] * arm.robot.delay_ticks)
    engine.reset(tip)
    for k in range(ticks):
        mj.mj_step1(model, data)
        mj.mj_jacSite(model, data, jp, jr, site)
        (proxies[k], normals[k], rendereds[k]), state[k], status[k] = render(tip)
        if hold is None:
            forces[k], torques[k] = rendereds[k], jp.T @ rendereds[k]
        else:
            forces[k], _, governed[k] = hold.step(rendereds[k], jp)
            torques[k] = hold.torque(n)
        waiting.append(
            torques[k] if most is None else np.minimum(np.maximum(torques[k], -most), most)
        )
        mj.mju_mat2Quat(now, data.site_xmat[site])
        mj.mju_subQuat(twist, held, now)
        v = J @ qvel
        wrench[:3] = hand.stiffness * (wanted[k] - tip) - hand.damping * (v[:3] - speed[k])
        wrench[3:] = hand.turn_stiffness * (turn @ twist) - hand.turn_damping * v[3:]
        qs[k], speeds[k], tips[k], pulls[k] = qpos, qvel, tip, wrench[:3]
        applied[:] = waiting.popleft() + JT @ wrench
        mj.mj_step2(model, data)
        if k % 256 == 255:
            if done is not None:
                done(256)
            if not np.abs(qvel).max() < 100.0:  # also where it is no number
                ticks = k + 1
                break
    rows = (tips, proxies, normals, rendereds, forces, pulls, qs, speeds, torques)
    return Motion(*(row[:ticks] for row in (*rows, state, status, governed)))
