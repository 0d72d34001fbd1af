"""Time per tick, in memory that does not grow."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.engine.answers import Trace

BINS_PER_OCTAVE = 64
"""Each bin of the histogram is 1.1 % wide; a clock is no more exact."""

SHORTEST_S = 1e-9
"""Beginning of the first bin [s]."""

BINS = 40 * BINS_PER_OCTAVE
"""The histogram ends at 1000 s."""


class StepTimes:
    """A histogram of the engine's time per tick, each bin 1.1 % wide.

    The native engine times each tick itself; any other is stepped and timed from Python.
    """

    def __init__(self) -> None:
        self._bins = np.zeros(BINS, dtype=np.int64)
        self._max_s = 0.0
        self.ticks = 0

    def run(self, engine: Any, hip: NDArray[np.float64]) -> Trace:
        """`engine.run(hip)`, timed."""
        self.ticks += len(hip)
        trace, micros = timed(engine, hip)
        seconds = 1e-6 * micros
        bins = np.log2(np.maximum(seconds, SHORTEST_S) / SHORTEST_S) * BINS_PER_OCTAVE
        bins = np.minimum(bins.astype(np.int64), BINS - 1)
        self._bins += np.bincount(bins, minlength=BINS)
        self._max_s = max(self._max_s, float(seconds.max(initial=0.0)))
        return trace

    def report(self) -> dict[str, float]:
        """Median, 99th and 99.9th percentile, and maximum [µs]."""
        total = np.cumsum(self._bins)
        top = self._max_s * 1e6
        report = {}
        for name, q in {"median": 0.5, "p99": 0.99, "p999": 0.999}.items():
            k = int(np.searchsorted(total, q * total[-1]))
            report[name] = min(top, float(SHORTEST_S * 2 ** ((k + 0.5) / BINS_PER_OCTAVE) * 1e6))
        return {**report, "max": top}


def timed(engine: Any, hip: NDArray[np.float64]) -> tuple[Trace, NDArray[np.float64]]:
    """`engine.run(hip)`, and the time of each tick (n,) [µs].

    The native engine times itself around each step; any other is stepped from Python.
    """
    if hasattr(engine, "run_timed"):
        return engine.run_timed(hip)
    steps = []
    times = np.empty(len(hip))
    for i, place in enumerate(hip):
        began = time.perf_counter_ns()
        steps.append(engine.step(place))
        times[i] = (time.perf_counter_ns() - began) / 1e3
    return Trace.of(steps), times
