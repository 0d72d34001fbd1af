"""Time per tick, in memory that does not grow."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

_PER_OCTAVE = 64  # bins of 1.1 %
_LOWEST_S = 1e-9
_BINS = 40 * _PER_OCTAVE  # to 1000 s
_GROUP = 32  # ticks timed together: the clock's own cost is then below 1 %


class StepTimes:
    """A histogram of the engine's time per tick, each bin 1.1 % wide.

    Ticks are timed in groups of 32; a group's mean stands for each of its ticks.
    """

    def __init__(self) -> None:
        self._bins = np.zeros(_BINS, dtype=np.int64)
        self._max_s = 0.0

    def run(self, engine: Any, hip: NDArray[np.float64]) -> Any:
        """`engine.run(hip)`, timed."""
        from vfplan.rendering import Trace

        parts, seconds = [], []
        for start in range(0, len(hip), _GROUP):
            group = hip[start : start + _GROUP]
            began = time.perf_counter()
            parts.append(engine.run(group))
            seconds.append((time.perf_counter() - began) / len(group))
        self._count(np.array(seconds), np.diff([*range(0, len(hip), _GROUP), len(hip)]))
        return Trace(
            *(
                np.concatenate([getattr(part, name) for part in parts])
                for name in ("proxy", "normal", "force", "state", "status")
            )
        )

    def _count(self, seconds: NDArray[np.float64], ticks: NDArray[np.int64]) -> None:
        bins = np.log2(np.maximum(seconds, _LOWEST_S) / _LOWEST_S) * _PER_OCTAVE
        np.add.at(self._bins, np.minimum(bins.astype(np.int64), _BINS - 1), ticks)
        self._max_s = max(self._max_s, float(seconds.max()))

    def report(self) -> dict[str, float]:
        """Median, 99th and 99.9th percentile, and maximum [µs]."""
        total = np.cumsum(self._bins)
        quantiles = {"median": 0.5, "p99": 0.99, "p999": 0.999}
        report = {}
        for name, q in quantiles.items():
            k = int(np.searchsorted(total, q * total[-1]))
            report[name] = float(_LOWEST_S * 2 ** ((k + 0.5) / _PER_OCTAVE) * 1e6)
        top = self._max_s * 1e6
        return {**{name: min(value, top) for name, value in report.items()}, "max": top}
