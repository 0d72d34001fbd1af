"""A rehearsal in two pictures: the arm over the fixture, and what it was asked for over time."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vfplan.arm import Rehearsal
from vfplan.figures.style import subplots
from vfplan.palette import CLOUD, CONTACT, FORCE, HIP, PROXY
from vfplan.replaying.quantities import row_norms

Array = NDArray[np.float64]

MOST_POINTS = 4000
MOST_TICKS = 4000
POSTURES = 6


def depth(rehearsal: Rehearsal) -> Figure:
    """The commanded force against the depth, apart for the faces that were felt.

    Faces are told apart by the normal: along the axis on which normals differ most, and against it.
    """
    ticks, held = rehearsal.ticks, rehearsal.ticks.penetration > 1e-5
    figure, axes = subplots(5.2, 3.6)
    normals, force = ticks.normal[held], row_norms(rehearsal.motion.force)[held]
    deep = 1e3 * ticks.penetration[held]
    axis = int(np.ptp(normals, axis=0).argmax()) if len(normals) else 0
    for sign, colour in ((1, CLOUD), (-1, PROXY)):
        there = sign * normals[:, axis] > 0
        name = f"normal along {'+' if sign > 0 else '-'}{'xyz'[axis]}"
        axes.plot(sign * deep[there], force[there], ".", ms=2, color=colour, label=name)
    most = deep.max(initial=0.1)
    k = rehearsal.metrics["k_n_per_m"]
    axes.plot([-most, 0, most], [k * most / 1e3, 0, k * most / 1e3], color=FORCE, lw=0.8, ls="--",
              label=f"K = {k:.0f} N/m")  # fmt: skip
    axes.set_xlabel("depth [mm], one face to the right, the other to the left")
    axes.set_ylabel("commanded force [N]")
    axes.legend()
    return figure


def draw_in_space(rehearsal: Rehearsal) -> Figure:
    """The arm in some of its postures, the fixture and the tip's path."""
    figure, axes = subplots(6.6, 5.6, subplot_kw={"projection": "3d"})
    arm, motion = rehearsal.arm, rehearsal.motion
    shown = np.linspace(0, len(motion.q) - 1, POSTURES).astype(int)
    outlines = [_outline(rehearsal, motion.q[k]) for k in shown]
    for k, line in enumerate(outlines):
        axes.plot(*line.T, "-o", color="#555555", lw=2.2, ms=3.5, alpha=0.25 + 0.6 * (k == 0),
                  label=f"{arm.name}, at the start" if k == 0 else None)  # fmt: skip
    cloud = rehearsal.fixture.points[:: len(rehearsal.fixture.points) // MOST_POINTS + 1]
    axes.plot(*cloud.T, ".", color=CLOUD, ms=1.5, label="fixture")
    path = motion.tip[:: len(motion.tip) // MOST_TICKS + 1]
    axes.plot(*path.T, color=HIP, lw=1.0, label="tip")
    for reflex in rehearsal.metrics["reflexes"][:1]:
        at = motion.tip[reflex["tick"]]
        axes.plot(*at[:, None], "x", color=CONTACT, ms=9, mew=2, label=f"{reflex['kind']}")
    every = np.concatenate([*outlines, cloud, path])
    middle, half = (every.max(0) + every.min(0)) / 2, np.ptp(every, axis=0).max() / 2
    for name, at in zip("xyz", middle, strict=True):
        getattr(axes, f"set_{name}lim")(at - half, at + half)
        getattr(axes, f"set_{name}label")(f"{name} [m]")
    axes.set_box_aspect((1, 1, 1))
    axes.legend(loc="upper left")
    return figure


def _outline(rehearsal: Rehearsal, q: Array) -> Array:
    """(m, 3) from the base over the links to the tip [m]."""
    arm = rehearsal.arm
    arm.hold(q)
    chain, body = [arm.look()[0].copy()], int(arm.model.site_bodyid[arm.site])
    while body:
        chain.append(arm.data.xpos[body].copy())
        last, body = body, int(arm.model.body_parentid[body])
    first = arm.model.body_pos[last]
    return np.array([*chain, first * [1, 1, 0]])[::-1]


def efforts(rehearsal: Rehearsal) -> Figure:
    """Force, torques, their steps and the joints' ranges over time."""
    motion, arm = rehearsal.motion, rehearsal.arm
    robot, time = arm.robot, rehearsal.ticks.time
    figure, (force, torque, step, margin) = subplots(7.0, 7.2, 4, 1, sharex=True)
    force.plot(time, row_norms(motion.rendered), color=PROXY, lw=0.8, label="rendered")
    force.plot(time, row_norms(motion.force), color=FORCE, lw=1.0, label="commanded")
    force.plot(time, row_norms(motion.pull), color=HIP, lw=0.6, alpha=0.7, label="hand")
    force.set_ylabel("force [N]")
    force.legend(ncols=3)
    steps = np.abs(np.diff(motion.torque, axis=0, prepend=0 * motion.torque[:1]))
    for axes, values, limits, name in (
        (torque, np.abs(motion.torque), robot.torque_limit_nm, "torque"),
        (step, steps, robot.torque_step_limit_nm, "torque step"),
    ):
        limits = np.ones(arm.joints) if limits is None else np.asarray(limits)
        for j in range(arm.joints):
            axes.plot(time, values[:, j] / limits[j], lw=0.8, label=f"{j + 1}")
        axes.axhline(1.0, color=CONTACT, lw=1.0, ls="--")
        axes.set_ylabel(f"{name}\n/ limit")
    step.set_yscale("log")
    step.set_ylim(1e-5, None)
    torque.legend(ncols=arm.joints, title="joint")
    margins = np.minimum(motion.q - arm.low, arm.high - motion.q)
    for j in range(arm.joints):
        margin.plot(time, margins[:, j], lw=0.8)
    margin.axhline(0.0, color=CONTACT, lw=1.0, ls="--")
    margin.set_ylabel("left of the\njoint's range [rad]")
    margin.set_xlabel("time [s]")
    for reflex in rehearsal.metrics["reflexes"][:1]:
        for axes in (force, torque, step, margin):
            axes.axvline(time[reflex["tick"]], color=CONTACT, lw=0.8)
    return figure
