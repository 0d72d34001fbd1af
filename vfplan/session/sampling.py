"""How a session was sampled: its rate, gaps, jitter, repeats and speed."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.display import MAX_LISTED
from vfplan.session.blocks import WithPrevious

Array = NDArray[np.float64]

GAP = 1.5
"""An interval longer than this many nominal ones misses samples: half a sample beyond one."""

JUMP_M_S = 20.0
"""No hand moves a tool faster than this [m/s]: the position jumped."""


class SamplingReport:
    """Measure how a session was recorded, from its time stamps and positions.

    The nominal interval is the median over the first block. Jitter is the RMS deviation from it
    of the intervals that are no gaps.
    """

    def __init__(self) -> None:
        self._with_previous = WithPrevious()
        self._count = 0
        self._nominal_s = 0.0
        self._longest_s = 0.0
        self._jitter_squares = 0.0
        self._intervals_without_gap = 0
        self._missing = 0
        self._gap_count = 0
        self._gap_s = 0.0
        self._gaps: list[dict[str, float]] = []
        self._repeats = 0
        # Repeats in a row: at the end of the last block, and the longest run.
        self._repeating = 0
        self._repeats_longest = 0
        self._speed_max = 0.0
        self._speed_max_tick = 0
        self._jump_count = 0
        self._jumps: list[int] = []

    def update(self, time: Array, hip: Array) -> None:
        """Add the next samples."""
        first = max(0, self._count - 1)
        self._count += len(time)
        time, hip = self._with_previous(time, hip)
        if len(time) < 2:
            return
        dt = np.diff(time)
        if not self._nominal_s:
            # The median. NumPy's own would load numpy.ma, a fifth of a second.
            ordered = np.sort(dt)
            self._nominal_s = float(ordered[(len(dt) - 1) // 2] + ordered[len(dt) // 2]) / 2

        # Intervals: gaps and jitter.
        is_gap = dt > GAP * self._nominal_s
        self._intervals_without_gap += int(np.count_nonzero(~is_gap))
        self._jitter_squares += float(((dt[~is_gap] - self._nominal_s) ** 2).sum())
        self._longest_s = max(self._longest_s, float(dt.max()))
        for k in np.flatnonzero(is_gap):
            missing = int(round(dt[k] / self._nominal_s) - 1)
            self._missing += missing
            self._gap_count += 1
            self._gap_s += float(dt[k])
            if len(self._gaps) < MAX_LISTED:
                gap = {"t_s": float(time[k]), "length_s": float(dt[k]), "missing": missing}
                self._gaps.append(gap)

        # Positions: repeats and jumps.
        step = np.diff(hip, axis=0)
        is_repeat = (step == 0).all(axis=1)
        self._repeats += int(np.count_nonzero(is_repeat))
        # Repeats in a row lie between moves; a run may go on from the last block.
        moves = np.flatnonzero(~is_repeat)
        edges = np.concatenate(([-1 - self._repeating], moves, [len(is_repeat)]))
        runs = np.diff(edges) - 1
        self._repeats_longest = max(self._repeats_longest, int(runs.max()))
        self._repeating = int(runs[-1])
        speed = np.linalg.norm(step, axis=1) / dt
        k = int(np.argmax(speed))
        if speed[k] > self._speed_max:
            self._speed_max = float(speed[k])
            self._speed_max_tick = first + k + 1
        jumps = first + 1 + np.flatnonzero(speed > JUMP_M_S)
        self._jump_count += len(jumps)
        self._jumps.extend(jumps[: MAX_LISTED - len(self._jumps)].tolist())

    def report(self) -> dict[str, Any]:
        """The `session` part of a replay's report."""
        jitter_squares = self._jitter_squares / max(1, self._intervals_without_gap)
        data: dict[str, Any] = {
            "samples": self._count,
            "rate_hz": 1.0 / self._nominal_s,
            "dt_nominal_s": self._nominal_s,
            "dt_max_s": self._longest_s,
            "jitter_rms_s": float(np.sqrt(jitter_squares)),
            "gaps": self._gap_count,
            "gap_s": self._gap_s,
            "missing_samples": self._missing,
            "repeats": self._repeats,
            "repeats_longest": self._repeats_longest,
            "speed_max_m_s": self._speed_max,
            "speed_max_tick": self._speed_max_tick,
        }
        if self._gaps:
            data["gap_list"] = self._gaps
        if self._jump_count:
            data["jumps"] = self._jump_count
            data["jump_ticks"] = self._jumps
        return data
