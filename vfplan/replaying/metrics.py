"""The numbers a replay reports, gathered block by block in memory that does not grow."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.parameters import ProxyParameters, Status
from vfplan.fixture import Fixture
from vfplan.replaying.checks import RobotWatch
from vfplan.replaying.clearance import clearance_of
from vfplan.replaying.episodes import JOIN_S, CurveRuler, Episodes
from vfplan.replaying.quantities import Steps, row_norms
from vfplan.robot import Robot

STATES = (-1, 0, 1, 2)


class Metrics:
    """Sums, maxima and episodes over a replay.

    fixture: the fixture that is replayed
    parameters: the engine's, as it runs them
    robot: whose limits to watch, or `None`
    join_s: runs of contact closer than this [s] are one episode
    """

    def __init__(
        self,
        fixture: Fixture,
        parameters: ProxyParameters,
        robot: Robot | None = None,
        join_s: float = JOIN_S,
    ) -> None:
        self._robot = None if robot is None else RobotWatch(robot)
        self._parameters = parameters
        self._ruler = CurveRuler.of(fixture)
        self._clearance = clearance_of(fixture, parameters.rule)
        drawn = parameters.rule == "exact" and fixture.pieces
        known = drawn.error if drawn else parameters.band
        self._episodes = Episodes(known, join_s)
        self._states = np.zeros(len(STATES), dtype=np.int64)
        self._state_s = np.zeros(len(STATES))
        self._sums: dict[str, float] = {}
        self._peaks: dict[str, float] = {}
        self._span: tuple[float, float] | None = None
        self._worst_step: tuple[float, int] = (0.0, 0)
        self._status = dict.fromkeys(("inside", "limit", "bad_hip"), 0)

    def note_status(self, status: NDArray[np.uint8]) -> None:
        """Count what the engine said of each tick."""
        for name, flag in (
            ("inside", Status.INSIDE),
            ("limit", Status.LIMIT),
            ("bad_hip", Status.BAD_HIP),
        ):
            self._status[name] += int(np.count_nonzero(status & flag))

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
        for i, state in enumerate(STATES):
            there = ticks.state == state
            self._states[i] += np.count_nonzero(there)
            self._state_s[i] += steps.dt[there].sum()
        self._add(steps)
        self._raise(steps)

    def _add(self, steps: Steps) -> None:
        press, drag, path = steps.sliding
        for name, values in {
            "ticks": len(steps),
            "fast": np.count_nonzero(row_norms(steps.dhip) > self._parameters.r1),
            "contact_ticks": np.count_nonzero(steps.held),
            "contact_s": steps.dt[steps.held].sum(),
            "penetration2": (steps.ticks.penetration**2).sum(),
            "force2": (steps.force_n**2).sum(),
            "energy": steps.work_j.sum(),
            "hold": steps.hold_j.sum(),
            "drag_work": (drag * path).sum(),
            "press_path": (press * path).sum(),
            "slide": path.sum(),
            "lag2_path": (steps.lag_m**2 * path).sum(),
        }.items():
            self._sums[name] = self._sums.get(name, 0) + float(values)

    def _raise(self, steps: Steps) -> None:
        for name, values in {
            "penetration": steps.ticks.penetration,
            "overlap": steps.ticks.overlap,
            "force": steps.force_n,
            "lag": np.abs(steps.lag_m),
        }.items():
            self._peaks[name] = max(self._peaks.get(name, 0.0), float(values.max()))
        k = int(np.argmax(steps.force_step_n))
        if steps.force_step_n[k] > self._worst_step[0]:
            # The step from tick k to k + 1 belongs to the tick that shows it.
            self._worst_step = (float(steps.force_step_n[k]), steps.first + k + 1)

    def report(self) -> dict[str, Any]:
        """The contract's keys, and this project's own."""
        sums, peaks = self._sums, self._peaks
        ticks, held = sums["ticks"], max(1.0, sums["contact_ticks"])
        start, end = self._span or (0.0, 0.0)
        data: dict[str, Any] = {
            "ticks": int(sums["ticks"]),
            "duration_s": end - start,
            "contact_ticks": int(sums["contact_ticks"]),
            "contact_s": sums["contact_s"],
            **self._episodes.report(self._ruler),
            "penetration_max_m": peaks["penetration"],
            "penetration_rms_m": float(np.sqrt(sums["penetration2"] / ticks)),
            "penetration_contact_rms_m": float(np.sqrt(sums["penetration2"] / held)),
            "force_max_n": peaks["force"],
            "force_rms_n": float(np.sqrt(sums["force2"] / ticks)),
            "force_contact_rms_n": float(np.sqrt(sums["force2"] / held)),
            "force_step_max_n": self._worst_step[0],
            "force_step_max_tick": self._worst_step[1],
            "bad_hip_ticks": self._status["bad_hip"],
            "inside_ticks": self._status["inside"],
            "too_fast_ticks": self._too_fast(),
            "energy_j": sums["energy"],
            "energy_hold_j": sums["hold"],
            "states": {str(s): int(n) for s, n in zip(STATES, self._states, strict=True)},
            "states_s": {str(s): float(t) for s, t in zip(STATES, self._state_s, strict=True)},
        }
        if self._clearance is not None:
            data["overlap_max_m"] = peaks["overlap"]
            data["clearance_min_m"] = self._clearance.minimum_m
            data["entrenched_ticks"] = int(self._states[STATES.index(2)])
        if sums["press_path"] > 0:
            data["friction"] = sums["drag_work"] / sums["press_path"]
        if sums["slide"] > 0:
            data["slide_m"] = sums["slide"]
            data["lag_max_m"] = peaks["lag"]
            data["lag_rms_m"] = float(np.sqrt(sums["lag2_path"] / sums["slide"]))
        if self._robot is not None:
            data["robot"] = self._robot.report()
        return data

    def _too_fast(self) -> int:
        # The paper's proxy moves r1 a tick at most (eq. 5); the robust one says when it ran out.
        if self._parameters.rule == "paper":
            return int(self._sums["fast"])
        return self._status["limit"]
