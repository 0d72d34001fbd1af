"""How a session was sampled: its rate, gaps, jitter, repeats and speed."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.replaying.quantities import WithPrevious

Array = NDArray[np.float64]

GAP = 1.5  # an interval longer than this many nominal ones misses samples
LISTED = 20  # gaps reported one by one
# Faster than this no hand moves a tool [m/s]: the position jumped.
JUMP_M_S = 20.0


class SamplingReport:
    """Gather what a session's time stamps and positions say of its recording.

    The nominal interval is the median over the first block. Jitter is the RMS deviation from it
    of the intervals that are no gaps.
    """

    def __init__(self) -> None:
        self._carry = WithPrevious()
        self._nominal = self._jitter2 = self._dt_max = 0.0
        self._count = self._even = self._missing = self._gap_count = self._jump_count = 0
        self._repeats = self._run = self._longest = 0
        self._gaps: list[dict[str, float]] = []
        self._jumps: list[int] = []
        self._speed = (0.0, 0)

    def update(self, time: Array, hip: Array) -> None:
        """Take in the next samples."""
        first, self._count = max(0, self._count - 1), self._count + len(time)
        time, hip = self._carry(time, hip)
        if len(time) < 2:
            return
        dt = np.diff(time)
        if not self._nominal:
            ordered = np.sort(dt)  # np.median would load numpy.ma, a fifth of a second
            self._nominal = float(ordered[(len(dt) - 1) // 2] + ordered[len(dt) // 2]) / 2
        self._watch_time(dt, time)
        self._watch_place(dt, np.diff(hip, axis=0), first)

    def _watch_time(self, dt: Array, time: Array) -> None:
        gap = dt > GAP * self._nominal
        self._even += int(np.count_nonzero(~gap))
        self._jitter2 += float(((dt[~gap] - self._nominal) ** 2).sum())
        self._dt_max = max(self._dt_max, float(dt.max()))
        for k in np.flatnonzero(gap):
            lost = round(dt[k] / self._nominal) - 1
            self._missing += lost
            self._gap_count += 1
            if len(self._gaps) < LISTED:
                self._gaps.append(
                    {"t_s": float(time[k]), "length_s": float(dt[k]), "missing": int(lost)}
                )

    def _watch_place(self, dt: Array, step: Array, first: int) -> None:
        still = (step == 0).all(axis=1)
        self._repeats += int(np.count_nonzero(still))
        for same, length in _runs(still):
            self._run = self._run + length if same else 0
            self._longest = max(self._longest, self._run)
        speed = np.linalg.norm(step, axis=1) / dt
        k = int(np.argmax(speed))
        if speed[k] > self._speed[0]:
            self._speed = float(speed[k]), first + k + 1
        jumps = first + 1 + np.flatnonzero(speed > JUMP_M_S)
        self._jump_count += len(jumps)
        self._jumps += [int(j) for j in jumps[: LISTED - len(self._jumps)]]

    def report(self) -> dict[str, Any]:
        """The `session` part of a replay's report."""
        data: dict[str, Any] = {
            "samples": self._count,
            "rate_hz": 1.0 / self._nominal,
            "dt_nominal_s": self._nominal,
            "dt_max_s": self._dt_max,
            "jitter_rms_s": float(np.sqrt(self._jitter2 / max(1, self._even))),
            "gaps": self._gap_count,
            "missing_samples": self._missing,
            "repeats": self._repeats,
            "repeats_longest": self._longest,
            "speed_max_m_s": self._speed[0],
            "speed_max_tick": self._speed[1],
        }
        if self._gaps:
            data["gap_list"] = self._gaps
        if self._jump_count:
            data["jumps"] = self._jump_count
            data["jump_ticks"] = self._jumps
        return data


def _runs(flags: NDArray[np.bool_]) -> list[tuple[bool, int]]:
    """Runs of equal flags: (flag, length)."""
    cuts = np.flatnonzero(np.diff(flags)) + 1
    edges = np.concatenate(([0], cuts, [len(flags)]))
    return [(bool(flags[a]), b - a) for a, b in pairwise(edges.tolist())]
