"""The gate: is a fixture's K safe with a robot?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vfplan.engine.renderable import best_rule, check_renderable
from vfplan.errors import CheckFailed, SceneError
from vfplan.fixture import Fixture, StabilityVerdict
from vfplan.robot import Robot
from vfplan.stability.closedloop import closed_loop
from vfplan.stability.rows import Row

MARGIN = 1.25  # K may be at most k_max / MARGIN
ROBOT_KEYS = ("mass_kg", "damping_n_s_per_m", "rate_hz", "delay_ticks")  # of the verdict


def felt_stiffness(fixture: Fixture) -> float:
    """The largest stiffness in any direction that the fixture renders [N/m]: of P K P.

    Raises SceneError: a curve that is no fixture yet, or a rendering that no engine takes
    """
    if fixture.frame != "robot_base" or fixture.rendering is None:
        raise SceneError(
            f"frame {fixture.frame!r}"
            f"{'' if fixture.rendering else ' without rendering parameters'}: a fixture in"
            " 'robot_base' that a robot can render is wanted"
        )
    check_renderable(fixture)
    axis = fixture.ignore_axis
    across = np.eye(3) if axis is None else np.eye(3) - np.outer(axis, axis)
    region = float(np.linalg.eigvalsh(across @ np.diag(fixture.stiffness) @ across).max())
    if fixture.guidance is None:
        return region
    # A guide is a spring as well; beside a region both may press at once.
    return fixture.guidance.stiffness + (region if len(fixture.forbidden) else 0.0)


def judge(robot: Robot, stiffness: float, rows: list[Row], margin: float) -> StabilityVerdict:
    """The verdict on K [N/m] from closed-loop rows."""
    measured = [row.measured for row in rows if row.measured is not None]
    known = {name: getattr(robot, name) for name in ROBOT_KEYS}
    most = min(measured, default=0.0)
    return StabilityVerdict(
        robot.name, **known, k_n_per_m=stiffness, k_max_n_per_m=most, margin=margin
    )


def gate(fixture: Fixture, robot: Robot, margin: float = MARGIN) -> StabilityVerdict:
    """Run the loop on the fixture as its engine renders it, and judge its K.

    Raises
    ------
    CheckFailed
        K times the margin exceeds the largest stable stiffness; the message has the largest K
        that passes.
    """
    stiffness = felt_stiffness(fixture)
    rows = closed_loop(fixture, best_rule(fixture), robot, stiffness)
    found = judge(robot, stiffness, rows, margin)
    if not found.stable:
        raise CheckFailed(refusal(found))
    return found


def approved(fixture: Fixture, robot: Robot, margin: float = MARGIN) -> Fixture:
    """The fixture with the gate's verdict in it; raises as `gate` does."""
    return replace(fixture, stability=gate(fixture, robot, margin))


def refusal(found: StabilityVerdict) -> str:
    """Why a verdict is no, in one line."""
    return (
        f"K = {found.k_n_per_m:g} N/m with robot {found.robot!r} (m = {found.mass_kg:g} kg,"
        f" b = {found.damping_n_s_per_m:g} N·s/m, {found.rate_hz:g} Hz, delay {found.delay_ticks}"
        f" ticks): the loop is stable up to {found.k_max_n_per_m:.0f} N/m; allowed with a margin of"
        f" {found.margin:g} is {found.k_pass_n_per_m:.0f} N/m"
    )
