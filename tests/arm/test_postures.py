"""Stability on the arm itself: the bound that theory gives for a posture's mass, and beyond it."""

from __future__ import annotations

import numpy as np
import pytest

import vfplan
from vfplan.arm.model import Arm
from vfplan.robot import Robot
from vfplan.stability.loop import exact_bound

POSTURES = {
    "ready": [0, -0.785, 0, -2.356, 0, 1.571, 0.785],
    "low": [0.3, 0.5, -0.2, -1.9, 0.1, 2.3, 0.5],
    "aside": [1.1, -0.2, 0.4, -2.0, -0.5, 1.8, 0.2],
    "folded": [-0.5, -1.0, 0.2, -2.8, 0.3, 2.0, 1.0],
}
DAMPING, HOLDS = 5.0, 10  # [N s/m]; physics steps in a tick, over which the force is held
PUSH, R, UP = 2.0, 5e-3, np.array([0.0, 0.0, 1.0])


def swings(arm, stiffness):
    """(T,) height [m] of the tip on a level wall under a constant push, after a light blow.

    The engine renders the wall, a tick late. The damping acts along its normal in every physics
    step, as theory has it; the arm is free to move otherwise as its masses want.
    """
    mj, model, data = arm._mj, arm.model, arm.data
    tip, depth = arm.read_tip()[0].copy(), PUSH / stiffness
    side = np.linspace(-0.02, 0.02, 41)
    wall = np.array([[a, b, 0.0] for a in side for b in side]) + tip + (depth - R) * UP
    engine = vfplan.ProxyEngine(wall, stiffness=stiffness, band=1e-4)
    engine.reset(tip + 5 * depth * UP)
    inverse = np.linalg.solve(arm.inertia(), arm.read_tip()[2][:3].T)
    mass = 1 / (UP @ arm.read_tip()[2][:3] @ inverse @ UP)
    data.qvel[:] = inverse @ UP * mass * 2e-3  # 2 mm/s along the normal
    held, heights = PUSH, []
    for _ in range(3000):
        mj.mj_step1(model, data)
        at = arm.read_tip()[0].copy()
        heights.append(at[2])
        after = engine.step(at).force[2]
        for hold in range(HOLDS):
            if hold:
                mj.mj_step1(model, data)
            J = arm.read_tip()[2][:3]
            speed = float(UP @ (J @ data.qvel))
            data.qfrc_applied[:] = J.T @ ((held - PUSH - DAMPING * speed) * UP)
            mj.mj_step2(model, data)
        held = after
    return np.array(heights)


@pytest.mark.full
@pytest.mark.parametrize("name", POSTURES)
def test_the_exact_bound_holds_at_the_postures_mass(name):
    """At 0.8 of the bound a blow dies down, at 1.5 times the bound it grows."""

    def grown(share):
        arm = Arm("panda")
        arm.model.dof_frictionloss[:] = 0
        arm.model.dof_damping[:] = 0
        arm.model.opt.timestep = 1e-3 / HOLDS
        arm.hold(POSTURES[name])
        J = arm.read_tip()[2][:3]
        mass = 1 / (UP @ J @ np.linalg.solve(arm.inertia(), J.T) @ UP)
        bound = exact_bound(Robot("arm", mass, DAMPING, 1000.0, delay_ticks=1))
        heights = swings(arm, share * bound)
        size = np.abs(heights - np.median(heights))
        return size[-300:].max() / size[:300].max()

    assert grown(0.8) < 0.95
    assert grown(1.5) > 1.5
