"""The numbers a replay reports, gathered block by block in memory that does not grow."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.parameters import ProxyParameters
from vfplan.engine.ticks import Status
from vfplan.fixture import Fixture
from vfplan.replaying.clearance import clearance_of
from vfplan.replaying.episodes import CurveRuler, Episodes
from vfplan.replaying.limits import RobotWatch
from vfplan.replaying.quantities import Steps, row_norms
from vfplan.robot import Robot

STATES = (-1, 0, 1, 2)


class Metrics:
    """Sums, maxima and episodes over a replay.

    fixture: the fixture that is replayed
    parameters: the engine's, as it runs them
    robot: whose limits to watch, or `None`
    """

    def __init__(
        self, fixture: Fixture, parameters: ProxyParameters, robot: Robot | None = None
    ) -> None:
        self._robot = None if robot is None else RobotWatch(robot)
        self._parameters = parameters
        self._ruler = CurveRuler.of(fixture)
        self._clearance = clearance_of(fixture, parameters.rule)
        drawn = parameters.rule == "exact" and fixture.pieces
        known = drawn.error if drawn else parameters.band
        self._episodes = Episodes(known)
        self._states = np.zeros(len(STATES), dtype=np.int64)
        self._state_s = np.zeros(len(STATES))
        self._sums: defaultdict[str, float] = defaultdict(float)
        self._peaks: defaultdict[str, float] = defaultdict(float)
        self._span: tuple[float, float] | None = None
        self._worst_step = 0
        self._status = dict.fromkeys(("inside", "limit", "bad_hip"), 0)

    def note_status(self, status: NDArray[np.uint8]) -> None:
        """Count what the engine said of each tick."""
        for name in self._status:
            self._status[name] += int(np.count_nonzero(status & Status[name.upper()]))

    def update(self, steps: Steps) -> None:
        """Take in the next ticks."""
        ticks = steps.ticks
        start = self._span[0] if self._span else float(ticks.time[0])
        self._span = (start, float(ticks.time[-1] + steps.dt[-1]))
        if self._clearance is not None:
            self._clearance.update(ticks.proxy)
        if self._robot is not None:
            self._robot.update(steps)
        self._episodes.update(steps)
        self._states += np.bincount(ticks.state + 1, minlength=len(STATES))
        self._state_s += np.bincount(ticks.state + 1, steps.dt, minlength=len(STATES))
        k = int(np.argmax(steps.force_step_n))
        if steps.force_step_n[k] > self._peaks["force_step_max_n"]:
            # The step from tick k to k + 1 belongs to the tick that shows it.
            self._worst_step = steps.first + k + 1
        for name, values in steps.peaks.items():
            self._peaks[name] = max(self._peaks[name], float(values.max()))
        for name, values in {
            **steps.sums,
            "contact_ticks": steps.held,
            "contact_s": steps.dt[steps.held],
            "fast": row_norms(steps.dhip) > self._parameters.r1,
            "penetration2": steps.ticks.penetration**2,
            "force2": steps.force_n**2,
            "lag2_path": steps.lag_m**2 * steps.sums["slide_m"],
        }.items():
            self._sums[name] += float(values.sum())

    def report(self) -> dict[str, Any]:
        """The contract's keys, and this project's own."""
        sums, peaks = self._sums, self._peaks
        ticks, held = int(self._states.sum()), max(1.0, sums["contact_ticks"])
        start, end = self._span or (0.0, 0.0)
        data: dict[str, Any] = {
            "ticks": ticks,
            "duration_s": end - start,
            "contact_ticks": int(sums["contact_ticks"]),
            "contact_s": sums["contact_s"],
            **self._episodes.report(self._ruler),
            "penetration_max_m": peaks["penetration_max_m"],
            "penetration_rms_m": float(np.sqrt(sums["penetration2"] / ticks)),
            "penetration_contact_rms_m": float(np.sqrt(sums["penetration2"] / held)),
            "force_max_n": peaks["force_max_n"],
            "force_rms_n": float(np.sqrt(sums["force2"] / ticks)),
            "force_contact_rms_n": float(np.sqrt(sums["force2"] / held)),
            "force_step_max_n": peaks["force_step_max_n"],
            "force_step_max_tick": self._worst_step,
            "bad_hip_ticks": self._status["bad_hip"],
            "inside_ticks": self._status["inside"],
            "too_fast_ticks": self._too_fast(),
            "energy_j": sums["energy_j"],
            "energy_hold_j": sums["energy_hold_j"],
            "states": {str(s): int(n) for s, n in zip(STATES, self._states, strict=True)},
            "states_s": {str(s): float(t) for s, t in zip(STATES, self._state_s, strict=True)},
        }
        if self._clearance is not None:
            data["overlap_max_m"] = peaks["overlap_max_m"]
            data["clearance_min_m"] = self._clearance.minimum_m
            data["entrenched_ticks"] = int(self._states[STATES.index(2)])
        if sums["press_path"] > 0:
            data["friction"] = sums["drag_work"] / sums["press_path"]
        if sums["slide_m"] > 0:
            data["slide_m"] = sums["slide_m"]
            data["lag_max_m"] = peaks["lag_max_m"]
            data["lag_rms_m"] = float(np.sqrt(sums["lag2_path"] / sums["slide_m"]))
        if self._robot is not None:
            data["robot"] = self._robot.report()
        return data

    def _too_fast(self) -> int:
        # The paper's proxy moves r1 a tick at most (eq. 5); the robust one says when it ran out.
        if self._parameters.rule == "paper":
            return int(self._sums["fast"])
        return self._status["limit"]
