"""Time an engine tick by tick."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from vfplan.study.bench.record import Array


def timed_ticks(engine: Any, hips: Array) -> tuple[Any, Array]:
    """Run a path from its first HIP on: the trace, and the time of each tick (T,) [µs].

    The native engine times itself around each step; any other is stepped from Python.
    """
    engine.reset(hips[0])
    if hasattr(engine, "run_timed"):
        return engine.run_timed(hips)
    steps, times = [], np.empty(len(hips))
    for i, hip in enumerate(hips):
        began = time.perf_counter_ns()
        steps.append(engine.step(hip))
        times[i] = (time.perf_counter_ns() - began) / 1e3
    return stack(steps), times


def stack(steps: list[Any]) -> Any:
    """Steps as a `Trace`."""
    from vfplan.engine.parameters import Trace

    return Trace(
        proxy=np.array([s.proxy for s in steps]),
        normal=np.array([s.normal for s in steps]),
        force=np.array([s.force for s in steps]),
        state=np.array([s.state for s in steps], np.int8),
        status=np.array([s.status for s in steps], np.uint8),
    )
