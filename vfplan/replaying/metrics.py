"""The numbers a replay reports, gathered block by block in memory that does not grow."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.answers import Status
from vfplan.engine.parameters import ProxyParameters
from vfplan.fixture import Fixture
from vfplan.replaying.clearance import clearance_of
from vfplan.replaying.episodes import CurveRuler, Episodes
from vfplan.replaying.limits import RobotLimitCounts
from vfplan.replaying.quantities import Steps, row_norms
from vfplan.robot import Robot
from vfplan.session.result import STATES


class Metrics:
    """Sums, maxima and episodes over a replay.

    fixture: the fixture that is replayed
    parameters: the engine's, as it runs them
    robot: whose limits to watch, or `None`
    """

    def __init__(
        self, fixture: Fixture, parameters: ProxyParameters, robot: Robot | None = None
    ) -> None:
        self._robot = None
        if robot is not None:
            self._robot = RobotLimitCounts(robot)
        self._parameters = parameters
        self._ruler = CurveRuler.of(fixture)
        self._clearance = clearance_of(fixture, parameters.rule)
        # A passive episode moves the proxy by no more than what the rule leaves open: the band, or
        # how far lines and arcs are from the curve.
        slack_m = parameters.band
        if parameters.rule == "exact" and fixture.pieces:
            slack_m = fixture.pieces.error
        self._episodes = Episodes(slack_m)
        self._states = np.zeros(len(STATES), dtype=np.int64)
        self._state_s = np.zeros(len(STATES))
        self._sums: defaultdict[str, float] = defaultdict(float)
        self._peaks: defaultdict[str, float] = defaultdict(float)
        self._start_s: float | None = None
        self._end_s = 0.0
        self._force_step_max_tick = 0
        self._status = dict.fromkeys(("inside", "limit", "bad_hip"), 0)

    def note_status(self, status: NDArray[np.uint8]) -> None:
        """Count what the engine said of each tick."""
        for name in self._status:
            self._status[name] += int(np.count_nonzero(status & Status[name.upper()]))

    def update(self, steps: Steps) -> None:
        """Take in the next ticks."""
        ticks = steps.ticks
        if self._start_s is None:
            self._start_s = float(ticks.time[0])
        self._end_s = float(ticks.time[-1] + steps.dt[-1])
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
            self._force_step_max_tick = steps.first + k + 1
        for name, values in steps.peaks.items():
            self._peaks[name] = max(self._peaks[name], float(values.max()))
        summands = dict(steps.sums)
        summands["contact_ticks"] = steps.held
        summands["contact_s"] = steps.dt[steps.held]
        summands["fast"] = row_norms(steps.dhip) > self._parameters.r1
        summands["penetration2"] = steps.ticks.penetration**2
        summands["force2"] = steps.force_n**2
        summands["lag2_path"] = steps.lag_m**2 * steps.sums["slide_m"]
        for name, values in summands.items():
            self._sums[name] += float(values.sum())

    def report(self) -> dict[str, Any]:
        """The contract's keys, and this project's own."""
        sums = self._sums
        peaks = self._peaks
        ticks = int(self._states.sum())
        contact_ticks = max(1.0, sums["contact_ticks"])
        # The paper's proxy moves at most r1 a tick (eq. 5); the robust rule says when its
        # iterations ran out.
        too_fast_ticks = self._status["limit"]
        if self._parameters.rule == "paper":
            too_fast_ticks = int(sums["fast"])
        data: dict[str, Any] = {
            "ticks": ticks,
            "duration_s": self._end_s - (self._start_s or 0.0),
            "contact_ticks": int(sums["contact_ticks"]),
            "contact_s": sums["contact_s"],
            **self._episodes.report(self._ruler),
            "penetration_max_m": peaks["penetration_max_m"],
            "penetration_rms_m": float(np.sqrt(sums["penetration2"] / ticks)),
            "penetration_contact_rms_m": float(np.sqrt(sums["penetration2"] / contact_ticks)),
            "force_max_n": peaks["force_max_n"],
            "force_rms_n": float(np.sqrt(sums["force2"] / ticks)),
            "force_contact_rms_n": float(np.sqrt(sums["force2"] / contact_ticks)),
            "force_step_max_n": peaks["force_step_max_n"],
            "force_step_max_tick": self._force_step_max_tick,
            "bad_hip_ticks": self._status["bad_hip"],
            "inside_ticks": self._status["inside"],
            "too_fast_ticks": too_fast_ticks,
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
