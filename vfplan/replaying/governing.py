"""A governor behind the engine of a replay: what the hand then feels, and what was held back."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from vfplan.engine.answers import Trace
from vfplan.engine.governor import Governor, GovernorStatus
from vfplan.engine.parameters import Vector
from vfplan.replaying.quantities import dots, row_norms
from vfplan.robot import Robot
from vfplan.session.blocks import WithPrevious


class GovernedForces:
    """Pass an engine's forces through the governor of a robot's limits, block by block.

    Raises SettingError: limits that are missing, or not passive with this stiffness
    """

    def __init__(self, robot: Robot, stiffness: Vector) -> None:
        self._robot = robot
        self._governor = Governor.of(robot, float(stiffness.max()))
        self._with_previous = WithPrevious()
        self._ticks = 0
        # Largest force, and change of force in a tick, that the engine wanted [N].
        self._engine_force_max = 0.0
        self._engine_step_max = 0.0
        # Ticks whose force was held back, the most that was held back [N], and its tick.
        self._held_ticks = 0
        self._held_back_max = 0.0
        self._held_back_max_tick = 0
        self._overdrawn_ticks = 0
        # Energy that the hand got through what was held back [J].
        self._work = 0.0

    def run(self, hip: Vector, trace: Trace) -> Trace:
        """The trace with the forces that are commanded; `hip` (T, 3) [m]."""
        if not len(hip):
            return trace
        governed = self._governor.trace(trace.force)
        force_max = float(row_norms(trace.force).max())
        self._engine_force_max = max(self._engine_force_max, force_max)
        k = int(governed.held_back.argmax())
        if governed.held_back[k] > self._held_back_max:
            self._held_back_max = float(governed.held_back[k])
            self._held_back_max_tick = self._ticks + k
        self._ticks += len(hip)
        self._held_ticks += int(np.count_nonzero(governed.held_back))
        overdrawn = governed.status & GovernorStatus.OVERDRAWN
        self._overdrawn_ticks += int(np.count_nonzero(overdrawn))

        hips, wanted, commanded = self._with_previous(hip, trace.force, governed.force)
        if len(hips) > 1:
            step_max = float(row_norms(np.diff(wanted, axis=0)).max())
            self._engine_step_max = max(self._engine_step_max, step_max)
            self._work += float(dots((commanded - wanted)[:-1], np.diff(hips, axis=0)).sum())
        return replace(trace, force=governed.force)

    def report(self) -> dict[str, Any]:
        """The `governor` part of a replay's report."""
        governor = self._governor
        robot = self._robot
        report = {
            "force_step_n": robot.force_step_limit_n,
            "force_max_n": robot.force_limit_n,
            "mass_kg": robot.mass_kg,
            "least_passive_step_n": governor.least_passive_step_n,
            "engine_force_max_n": self._engine_force_max,
            "engine_force_step_max_n": self._engine_step_max,
            "held_ticks": self._held_ticks,
            "held_back_max_n": self._held_back_max,
            "energy_given_j": governor.energy_given_j,
            "energy_stored_j": governor.energy_stored_j,
            "overdrawn_ticks": self._overdrawn_ticks,
            "work_j": self._work,
        }
        if self._held_ticks:
            report["held_back_max_tick"] = self._held_back_max_tick
        return report
