"""Probes of extreme HIP paths: at rest for ever, at any speed and rate, denormal, not a number."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vfplan.engine.parameters import Status
from vfplan.study.extremes.ground import Ground, breach, walk_path


def rest(ground: Ground, ticks: int) -> float:
    """How far the proxy moves over `ticks` with the HIP at rest R/4 deep, after 1000 ticks [m]."""
    engine = ground.engine()
    R = engine.parameters.R
    hip = ground.touch - 0.25 * R * ground.out + 0.1 * R * ground.side
    settled = engine.run(np.tile(hip, (1000, 1))).proxy[-1]
    drift, block = 0.0, np.tile(hip, (100_000, 1))
    for begun in range(0, ticks, len(block)):
        proxy = engine.run(block[: ticks - begun]).proxy
        drift = max(drift, float(np.abs(proxy - settled).max()))
    return drift


def jump(ground: Ground, distance: float) -> float:
    """Breach while the HIP jumps `distance` through the cloud, and back [m]."""
    engine = ground.engine()
    near = ground.start(engine)
    far = -distance * ground.out
    trace = engine.run(np.array([near, far, near, -far, near, far, far, near]))
    return breach(engine, ground, trace)


def pierce(ground: Ground, speed: float, rate: float) -> float:
    """Breach while the HIP goes through the cloud and back, and slides [m]."""
    engine = ground.engine()
    R = engine.parameters.R
    deep = 3 * R * np.cos(np.linspace(0, 2 * np.pi, 2000))[:, None] * ground.out
    path = ground.touch + deep + 0.5 * R * np.linspace(0, 1, 2000)[:, None] * ground.side
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    ticks = max(int(length / speed * rate), 8)
    at = np.linspace(0, len(path) - 1, min(ticks, 100_000))
    hips = np.column_stack([np.interp(at, np.arange(len(path)), path[:, k]) for k in range(3)])
    engine.reset(hips[0])
    return breach(engine, ground, engine.run(hips))


def denormals(ground: Ground) -> float:
    """Breach while the HIP moves by the smallest numbers there are, around 0 and at a touch [m]."""
    moved = replace(ground, points=ground.points - ground.touch, touch=np.zeros(3))
    engine = moved.engine()
    tiny = np.arange(-500, 500)[:, None] * 5e-324 * np.ones(3)
    trace = engine.run(np.concatenate([tiny, tiny - 1e-310 * moved.out, tiny - 1e-3 * moved.out]))
    return breach(engine, moved, trace)


def on_point(ground: Ground) -> float:
    """Breach with the HIP exactly on the nearest point, and on the next ones [m]."""
    engine = ground.engine()
    nearest = np.argsort(np.linalg.norm(ground.points - ground.touch, axis=1))[:50]
    hips = np.repeat(ground.points[nearest], 3, axis=0)
    return breach(engine, ground, engine.run(hips))


def medial() -> float:
    """Largest force arm |proxy - HIP| in the centre of a ring, equally far from every point [m]."""
    angle = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    ring = 0.02 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    engine = Ground(ring, np.zeros(3), np.array([1.0, 0, 0]), {"ignore_axis": "z"}).engine()
    trace = engine.run(np.zeros((1000, 3)))
    return max(float(np.abs(trace.proxy).max()), float(np.abs(trace.force).max()))


def interrupted(ground: Ground) -> float:
    """Largest difference that NaN, Inf and 1e7 m between good ticks make [m].

    A bad tick must keep proxy and force, and say so in its status.
    """
    engine = ground.engine()
    good = walk_path(ground, engine, 300)
    plain = engine.run(good)
    bad = np.array([[np.nan] * 3, [np.inf, 0, 0], [0, -np.inf, 0], [0, 0, 1e7]])
    engine = ground.engine()
    worst = 0.0
    for k, hip in enumerate(good):
        step = engine.step(hip)
        worst = max(worst, float(np.abs(step.proxy - plain.proxy[k]).max()))
        wrong = engine.step(bad[k % 4])
        kept = np.array_equal(wrong.proxy, step.proxy) and np.array_equal(wrong.force, step.force)
        if not (kept and wrong.status & Status.BAD_HIP):
            return float("inf")
    return worst
