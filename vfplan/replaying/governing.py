"""A governor behind the engine of a replay: what the hand then feels, and what was held back."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from vfplan.engine.governor import Governor, GovernorStatus
from vfplan.engine.parameters import Vector
from vfplan.engine.ticks import Trace
from vfplan.replaying.quantities import WithPrevious, dots, row_norms
from vfplan.robot import Robot


class GovernedForces:
    """Pass an engine's forces through the governor of a robot's limits, block by block.

    Raises SettingError: limits that are missing, or not passive with this stiffness
    """

    def __init__(self, robot: Robot, stiffness: Vector) -> None:
        self._robot = robot
        self._governor = Governor.of(robot, float(stiffness.max()))
        self._carry = WithPrevious()
        self._engine_max = self._engine_step = self._held_max = self._work = 0.0
        self._held_tick, self._ticks, self._held, self._overdrawn = 0, 0, 0, 0

    def run(self, hip: Vector, trace: Trace) -> Trace:
        """The trace with the forces that are commanded; `hip` (T, 3) [m]."""
        if not len(hip):
            return trace
        asked = trace.force
        done = self._governor.trace(asked)
        self._engine_max = max(self._engine_max, float(row_norms(asked).max()))
        k = int(done.held_back.argmax())
        if done.held_back[k] > self._held_max:
            self._held_max, self._held_tick = float(done.held_back[k]), self._ticks + k
        self._ticks += len(hip)
        self._held += int(np.count_nonzero(done.held_back))
        self._overdrawn += int(np.count_nonzero(done.status & GovernorStatus.OVERDRAWN))
        hips, engine, commanded = self._carry(hip, asked, done.force)
        if len(hips) > 1:
            self._engine_step = max(
                self._engine_step, float(row_norms(np.diff(engine, axis=0)).max())
            )
            self._work += float(dots((commanded - engine)[:-1], np.diff(hips, axis=0)).sum())
        return replace(trace, force=done.force)

    def report(self) -> dict[str, Any]:
        """The `governor` part of a replay's report."""
        governor, robot = self._governor, self._robot
        report = {
            "force_step_n": robot.force_step_limit_n,
            "force_max_n": robot.force_limit_n,
            "mass_kg": robot.mass_kg,
            "least_passive_step_n": governor.least_passive_step_n,
            "engine_force_max_n": self._engine_max,
            "engine_force_step_max_n": self._engine_step,
            "held_ticks": self._held,
            "held_back_max_n": self._held_max,
            "energy_given_j": governor.energy_given_j,
            "energy_stored_j": governor.energy_stored_j,
            "overdrawn_ticks": self._overdrawn,
            "work_j": self._work,
        }
        if self._held:
            report["held_back_max_tick"] = self._held_tick
        return report
