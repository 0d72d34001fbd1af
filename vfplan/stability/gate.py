"""The gate: is a fixture's K safe with a robot?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vfplan.engine.choosing import best_rule, check_renderable
from vfplan.errors import CheckFailed, SceneError
from vfplan.fixture import Fixture, StabilityVerdict
from vfplan.robot import Robot
from vfplan.stability.case_result import CaseResult
from vfplan.stability.closed_loop import closed_loop_case

SAFETY_FACTOR = 1.25
"""Factor by which K may grow and the loop stays stable, unless the user gives another."""

ROBOT_KEYS = ("mass_kg", "damping_n_s_per_m", "rate_hz", "delay_ticks")
"""What a verdict holds of the robot."""


def gate(fixture: Fixture, robot: Robot, safety_factor: float = SAFETY_FACTOR) -> StabilityVerdict:
    """Run the loop on the fixture as its engine renders it, and judge its K.

    Raises
    ------
    CheckFailed
        K times the safety factor is not stable. The message has the largest K that passes.
    SceneError
        As `largest_rendered_stiffness`.
    """
    stiffness = largest_rendered_stiffness(fixture)
    results = closed_loop_case(fixture, best_rule(fixture), robot, stiffness)
    verdict = judge(robot, stiffness, results, safety_factor)
    if not verdict.stable:
        raise CheckFailed(
            f"{verdict_text(verdict)}. Plan with a smaller stiffness, or judge it with the "
            "robot's true mass and damping."
        )
    return verdict


def with_verdict(fixture: Fixture, robot: Robot, safety_factor: float = SAFETY_FACTOR) -> Fixture:
    """The fixture with the gate's verdict in it; raises as `gate` does."""
    return replace(fixture, stability=gate(fixture, robot, safety_factor))


def largest_rendered_stiffness(fixture: Fixture) -> float:
    """The largest stiffness that the fixture renders in any direction [N/m].

    It is the largest eigenvalue of P K P, where P projects across the ignored axis. A guide's
    stiffness is added to it where a forbidden region may press at the same time.

    Raises
    ------
    SceneError
        A curve that is no fixture yet, or a rendering that no engine takes.
    """
    if fixture.frame != "robot_base":
        raise SceneError(
            f"frame {fixture.frame!r}: only a fixture in 'robot_base' has a stiffness to judge. "
            "Make one of it with `vfplan register`."
        )
    if fixture.rendering is None:
        raise SceneError(
            "the bundle has no rendering parameters, so that there is no stiffness to judge. Make "
            "a fixture with `vfplan plan`."
        )
    check_renderable(fixture)
    axis = fixture.ignore_axis
    across = np.eye(3)
    if axis is not None:
        across = np.eye(3) - np.outer(axis, axis)
    region = float(np.linalg.eigvalsh(across @ np.diag(fixture.stiffness) @ across).max())
    if fixture.guidance is None:
        return region
    if len(fixture.forbidden) == 0:
        return fixture.guidance.stiffness
    return fixture.guidance.stiffness + region


def judge(
    robot: Robot, stiffness: float, results: list[CaseResult], safety_factor: float
) -> StabilityVerdict:
    """The verdict on K [N/m] from closed-loop results: the least of them decides."""
    measured = [result.measured for result in results if result.measured is not None]
    return StabilityVerdict(
        robot=robot.name,
        mass_kg=robot.mass_kg,
        damping_n_s_per_m=robot.damping_n_s_per_m,
        rate_hz=robot.rate_hz,
        delay_ticks=robot.delay_ticks,
        k_n_per_m=stiffness,
        k_max_n_per_m=min(measured, default=0.0),
        margin=safety_factor,
    )


def verdict_text(verdict: StabilityVerdict) -> str:
    """The verdict on one line: what was judged, and up to which K the loop is stable."""
    return (
        f"K = {verdict.k_n_per_m:g} N/m with robot {verdict.robot!r} (m = {verdict.mass_kg:g} kg,"
        f" b = {verdict.damping_n_s_per_m:g} N·s/m, {verdict.rate_hz:g} Hz, delay "
        f"{verdict.delay_ticks} ticks): the loop is stable up to {verdict.k_max_n_per_m:.0f} N/m; "
        f"allowed with a margin of {verdict.margin:g} is {verdict.k_pass_n_per_m:.0f} N/m"
    )
