"""The long run: the proxy stays outside, and neither time nor memory grows."""

from __future__ import annotations

import resource
import time
from functools import lru_cache

import numpy as np

from vfplan.stability.extremes.ground import breach, patch

BLOCK = 100_000


@lru_cache(1)
def _run(ticks: int) -> tuple[float, float, float]:
    """Breach [m], time of the last tenth over the first less 1, growth of memory [bytes]."""
    ground = patch()
    engine = ground.engine()
    rng = np.random.default_rng(11)
    hip, worst = ground.start(engine), 0.0
    times, memory = [], []
    for _ in range(max(ticks // BLOCK, 10)):
        steps = rng.normal(scale=1e-4, size=(BLOCK, 3))
        hips = hip + np.cumsum(steps, axis=0)
        # Folded into a box around the patch: a random walk between mirrors.
        hips = ground.touch + 8e-3 * (2 / np.pi) * np.arcsin(np.sin((hips - ground.touch) / 8e-3))
        started = time.perf_counter()
        trace = engine.run(hips)
        times.append(time.perf_counter() - started)
        worst = max(worst, breach(engine, ground.points, trace))
        memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
        hip = hips[-1]
    tenth = len(times) // 10
    slower = float(np.median(times[-tenth:]) / np.median(times[:tenth]) - 1)
    return worst, slower, float(memory[-1] - memory[tenth])


def wander(ticks: int) -> float:
    """The breach [m]."""
    return _run(ticks)[0]


def slowing(ticks: int) -> float:
    """How much longer the last tenth takes than the first, relative."""
    return _run(ticks)[1]


def growth(ticks: int) -> float:
    """Growth of the process's peak memory after the first tenth [bytes]."""
    return _run(ticks)[2]
