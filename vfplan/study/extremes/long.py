"""The long run: the proxy stays outside, and neither time nor memory grows."""

from __future__ import annotations

import resource
import time
from functools import lru_cache

import numpy as np

from vfplan.study.extremes.ground import Ground, breach

BLOCK = 100_000


@lru_cache(1)
def _run(ground: Ground, ticks: int) -> tuple[float, float, float]:
    """Breach [m], processor time of the last tenth over the first less 1, growth of memory [B]."""
    engine = ground.engine()
    rng = np.random.default_rng(11)
    hip, worst = ground.start(engine), 0.0
    times, memory = [], []
    block = min(BLOCK, ticks // 10)
    for _ in range(ticks // block):
        steps = rng.normal(scale=1e-4, size=(block, 3))
        hips = hip + np.cumsum(steps, axis=0)
        # Folded into a box around the patch: a random walk between mirrors.
        hips = ground.touch + 8e-3 * (2 / np.pi) * np.arcsin(np.sin((hips - ground.touch) / 8e-3))
        started = time.thread_time()
        trace = engine.run(hips)
        times.append(time.thread_time() - started)
        worst = max(worst, breach(engine, ground, trace))
        memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
        hip = hips[-1]
    tenth = len(times) // 10
    slower = float(np.median(times[-tenth:]) / np.median(times[:tenth]) - 1)
    return worst, slower, float(memory[-1] - memory[tenth])


def wander(ground: Ground, ticks: int) -> float:
    """The breach [m]."""
    return _run(ground, ticks)[0]


def slowing(ground: Ground, ticks: int) -> float:
    """How much longer the last tenth takes than the first, relative."""
    return _run(ground, ticks)[1]


def growth(ground: Ground, ticks: int) -> float:
    """Growth of the process's peak memory after the first tenth [bytes]."""
    return _run(ground, ticks)[2]
