"""Time per tick, in memory that does not grow."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.ticks import Trace
from vfplan.replaying.quantities import stacked

_PER_OCTAVE = 64  # bins of 1.1 %
_LOWEST_S = 1e-9
_BINS = 40 * _PER_OCTAVE  # to 1000 s
_GROUP = 32  # ticks timed together where the engine does not time each


class StepTimes:
    """A histogram of the engine's time per tick, each bin 1.1 % wide.

    The native engine times each tick itself. Of another engine, ticks are timed in groups of 32,
    and a group's mean stands for each of them.
    """

    def __init__(self) -> None:
        self._bins = np.zeros(_BINS, dtype=np.int64)
        self._max_s = 0.0
        self.ticks = 0

    def run(self, engine: Any, hip: NDArray[np.float64]) -> Trace:
        """`engine.run(hip)`, timed."""
        self.ticks += len(hip)
        if not len(hip):
            return engine.run(hip)
        trace, seconds = timed(engine, hip)
        bins = np.log2(np.maximum(seconds, _LOWEST_S) / _LOWEST_S) * _PER_OCTAVE
        bins = np.minimum(bins.astype(np.int64), _BINS - 1)
        self._bins += np.bincount(bins, minlength=_BINS)
        self._max_s = max(self._max_s, float(seconds.max()))
        return trace

    def report(self) -> dict[str, float]:
        """Median, 99th and 99.9th percentile, and maximum [µs]."""
        total = np.cumsum(self._bins)
        top = self._max_s * 1e6
        report = {}
        for name, q in {"median": 0.5, "p99": 0.99, "p999": 0.999}.items():
            k = int(np.searchsorted(total, q * total[-1]))
            report[name] = min(top, float(_LOWEST_S * 2 ** ((k + 0.5) / _PER_OCTAVE) * 1e6))
        return {**report, "max": top}


def timed(engine: Any, hip: NDArray[np.float64]) -> tuple[Trace, NDArray[np.float64]]:
    """`engine.run(hip)`, and the time of each tick (n,) [s]; in groups where it does not time."""
    if hasattr(engine, "run_timed"):
        trace, micros = engine.run_timed(hip)
        return trace, 1e-6 * micros
    parts, seconds = [], np.empty(len(hip))
    for start in range(0, len(hip), _GROUP):
        group = slice(start, start + _GROUP)
        began = time.perf_counter()
        parts.append(engine.run(hip[group]))
        seconds[group] = (time.perf_counter() - began) / len(hip[group])
    return stacked(parts), seconds
