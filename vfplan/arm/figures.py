"""A rehearsal in pictures, and the page about it: verdict, numbers, the arm, forces over time."""

from __future__ import annotations

from html import escape

import numpy as np
from matplotlib.figure import Figure

from vfplan.arm.rehearsal import Rehearsal, objections
from vfplan.display import MAX_DRAWN, resolved
from vfplan.figures.style import subplots
from vfplan.palette import CLOUD, FORCE, PROXY, TIP, WALL
from vfplan.replaying.metrics import row_norms
from vfplan.report.page import document, facts_table, picture, plain, section, table

# Number of postures that the arm is drawn in. More would hide each other.
DRAWN_POSTURES = 6


def draw_in_space(rehearsal: Rehearsal) -> Figure:
    """The arm in some of its postures, the fixture and the tip's path."""
    figure, axes = subplots(6.6, 5.6, subplot_kw={"projection": "3d"})
    arm = rehearsal.arm
    motion = rehearsal.motion
    drawn = np.linspace(0, len(motion.q) - 1, DRAWN_POSTURES).astype(int)
    for k, q in enumerate(motion.q[drawn]):
        arm.hold(q)
        chain = [arm.read_tip()[0].copy()]
        body = int(arm.model.site_bodyid[arm.site])
        while body:
            chain.append(arm.data.xpos[body].copy())
            body = int(arm.model.body_parentid[body])
        look = {"alpha": 0.25} if k else {"alpha": 0.85, "label": f"{arm.name}, at the start"}
        axes.plot(*np.array(chain)[::-1].T, "-o", color="#555555", lw=2.2, ms=3.5, **look)
    cloud = rehearsal.fixture.points[:: len(rehearsal.fixture.points) // MAX_DRAWN + 1]
    axes.plot(*cloud.T, ".", color=CLOUD, ms=1.5, label="fixture")
    axes.plot(*motion.tip[:: len(motion.tip) // MAX_DRAWN + 1].T, color=TIP, lw=1.0, label="tip")
    for stop in rehearsal.metrics["reflexes"][:1]:
        place = motion.tip[stop["tick"]]
        axes.plot(*place[:, None], "x", color=WALL, ms=9, mew=2, label=stop["kind"])

    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]", aspect="equal")
    axes.legend(loc="upper left")
    return figure


def draw_forces(rehearsal: Rehearsal) -> Figure:
    """Force, torques and the joints' ranges over time."""
    motion = rehearsal.motion
    arm = rehearsal.arm
    time = rehearsal.ticks.time
    figure, (force, torque, joint_range) = subplots(7.0, 5.6, 3, 1, sharex=True)

    force.plot(time, row_norms(motion.rendered), color=PROXY, lw=0.8, label="rendered")
    force.plot(time, row_norms(motion.force), color=FORCE, lw=1.0, label="commanded")
    force.plot(time, row_norms(motion.pull), color=TIP, lw=0.6, alpha=0.7, label="hand")
    force.set_ylabel("force [N]")
    force.legend(ncols=3)

    scale = arm.robot.torque_limit_nm or np.ones(arm.joints)
    torque.plot(time, np.abs(motion.torque) / scale, lw=0.8, label=range(1, arm.joints + 1))
    torque.axhline(1.0, color=WALL, lw=1.0, ls="--")
    torque.set_ylabel("torque\n/ limit")
    torque.legend(ncols=arm.joints, title="joint")

    joint_range.plot(time, np.minimum(motion.q - arm.low, arm.high - motion.q), lw=0.8)
    joint_range.axhline(0.0, color=WALL, lw=1.0, ls="--")
    joint_range.set(ylabel="to the end of the\njoint's range [rad]", xlabel="time [s]")
    for stop in rehearsal.metrics["reflexes"][:1]:
        for axes in (force, torque, joint_range):
            axes.axvline(time[stop["tick"]], color=WALL, lw=0.8)
    return figure


def page(rehearsal: Rehearsal, facts: dict[str, str]) -> str:
    """The HTML text of the page; `facts` stand at its head: the command line, files, digests."""
    metrics = rehearsal.metrics
    kind, _, words = rehearsal.verdict.partition(": ")
    verdict = f'<p class="verdict {kind}">{kind.upper()}: {escape(words)}</p>'
    title = f"Rehearsal of {escape(rehearsal.session.name)} on {escape(rehearsal.arm.name)}"
    stops = "".join(f"<li>{escape(line)}</li>" for line in objections(metrics) or ["nothing"])
    governor = metrics.get("governor", {})
    flat = metrics | {f"governor.{name}": value for name, value in governor.items()}
    rows = [
        [escape(name), resolved(value) if isinstance(value, float) else escape(plain(value))]
        for name, value in flat.items() if isinstance(value, (float, int, str))
    ]  # fmt: skip
    return document(title, "\n".join([
        f"<header><h1>{title}</h1>{verdict}</header>",
        facts_table(facts | {"session": rehearsal.session.name, "arm": rehearsal.arm.name}),
        section("What would stop the arm", f"<ul>{stops}</ul>"),
        section("In space", picture(draw_in_space(rehearsal), "arm and the tip's path", "tall")),
        section("Over time", picture(draw_forces(rehearsal), "force, torques, joints", "tall")),
        section("Numbers", table(["number", "value"], rows)),
    ]))  # fmt: skip
