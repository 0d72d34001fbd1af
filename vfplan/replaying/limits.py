"""Limits that a replay is held against: a robot's own, and those that the caller gives."""

from __future__ import annotations

import difflib
from typing import Any

import numpy as np

from vfplan.errors import SettingError
from vfplan.replaying.quantities import Steps
from vfplan.robot import Robot

# Name -> (the robot's limit, the number of the report that it bounds)
LIMITS = {
    "force": ("force_limit_n", "force_max_n"),
    "force_step": ("force_step_limit_n", "force_step_max_n"),
    "speed": ("speed_limit_m_s", "session.speed_max_m_s"),
}
Limits = tuple[tuple[str, str, float], ...]
"""Of each limit the number's name in the report, "at_most" or "at_least", and the bound."""


class RobotLimitCounts:
    """Count the ticks in which a robot would have objected.

    A Franka arm refuses a change of torque above 1 N·m from one tick to the next (about 1.2 N at
    the tip at a reach of 0.85 m) and stops at its reflex threshold.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._over: dict[str, int] = {}
        self._first: dict[str, int] = {}

    def update(self, steps: Steps) -> None:
        """Take in the next ticks."""
        self._count("force", steps.force_n, steps.first)
        # The step from tick k to k + 1 is the robot's at k + 1.
        self._count("force_step", steps.force_step_n, steps.first + 1)
        self._count("speed", steps.speed, steps.first + 1)

    def _count(self, name: str, values: Any, first_tick: int) -> None:
        """Count the values above the robot's limit of this name; a robot may have none."""
        limit = getattr(self._robot, LIMITS[name][0])
        if limit is None:
            return
        over = np.flatnonzero(values > limit)
        self._over[name] = self._over.get(name, 0) + len(over)
        if len(over):
            self._first.setdefault(name, first_tick + int(over[0]))

    def report(self) -> dict[str, Any]:
        """The `robot` part of a replay's report; a limit the robot does not have is absent."""
        robot = self._robot
        data: dict[str, Any] = {"name": robot.name, "rate_hz": robot.rate_hz}
        for name, (key, _) in LIMITS.items():
            if getattr(robot, key) is None:
                continue
            data[key] = getattr(robot, key)
            data[f"{name}_over_ticks"] = self._over.get(name, 0)
            if name in self._first:
                data[f"{name}_over_first_tick"] = self._first[name]
        return data


def robot_limits(robot: Robot) -> Limits:
    """The robot's limits as checks of a replay's report."""
    limits = []
    for key, number in LIMITS.values():
        limit = getattr(robot, key)
        if limit is not None:
            limits.append((number, "at_most", limit))
    return tuple(limits)


def check_limits(report: dict[str, Any], limits: Limits) -> list[dict[str, Any]]:
    """Each limit against the report.

    report: as a replay gives it; `a.b` names b within a
    Raises SettingError: a name that is no number of the report
    """
    checks = []
    for name, sense, limit in limits:
        value: Any = report
        for part in name.split("."):
            if not isinstance(value, dict):
                value = None
                break
            value = value.get(part)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            numbers = [k for k, v in report.items() if isinstance(v, (int, float))]
            # The number that was probably meant comes first.
            similar = difflib.get_close_matches(name, numbers, 1)
            others = [number for number in numbers if number not in similar]
            raise SettingError(
                f"the report has no number {name!r} to hold against {limit:g}. Give one of "
                f"{', '.join(similar + others)}",
                code="no-such-number",
            )
        holds = value <= limit if sense == "at_most" else value >= limit
        checks.append({"name": name, "value": value, sense: limit, "pass": bool(holds)})
    return checks
