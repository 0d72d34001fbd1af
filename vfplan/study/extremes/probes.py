"""Probes of extremes: clouds far, tiny, huge, dense or degenerate; settings at the ends of their
ranges; HIPs at rest for ever, at any speed and rate, denormal, no number; the long run."""

from __future__ import annotations

import resource
import time
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from vfplan.engine.checks import Vector
from vfplan.engine.parameters import Status
from vfplan.study.extremes.ground import Ground, breach, moved, patch, walk_path, walked

R = 5e-3
UP = np.array([0.0, 1.0, 0.0])


def press(offset: float = 0.0, scale: float = 1.0) -> float:
    """Largest error of the proxy's height over a patch that the HIP presses and slides on [m]."""
    ground = moved(patch(), offset * np.ones(3), scale)
    radius = R * scale
    engine = ground.engine(contact_radius=radius, band=12.6e-6 * scale)
    s = np.linspace(0.0, 1.0, 400)[:, None]
    down = ground.start(engine) - 0.4 * radius * s * UP
    slide = down[-1] + 0.4 * radius * s * [1.0, 0.0, 0.3]
    engine.run(down)
    trace = engine.run(slide)
    height = (trace.proxy - offset) @ UP
    return float(np.abs(height - radius).max())


def speck(extent: float) -> float:
    """A hundred points within `extent` [m]."""
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (100, 3)) * extent
    return walked(Ground(points, (R + extent) * UP, UP))


def line(count: int, spacing: float) -> float:
    """A straight row of points, met in its middle."""
    x = (np.arange(count) - count // 2) * spacing
    points = np.column_stack([x, 0 * x, 0 * x])
    return walked(Ground(points, R * UP, UP, {"ignore_axis": "z"}))


def sheet(side_points: int, spacing: float = 5e-4) -> float:
    """A square sheet, met in its middle."""
    x = (np.arange(side_points) - side_points // 2) * spacing
    points = np.zeros((side_points * side_points, 3))
    points[:, 0], points[:, 2] = np.repeat(x, side_points), np.tile(x, side_points)
    return walked(Ground(points, R * UP, UP))


def blob(kind: str) -> float:
    """Small clouds of a certain kind."""
    rng = np.random.default_rng(1)
    x = np.linspace(-0.01, 0.01, 41)
    grid = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    tilted = np.column_stack([grid[:, 0], 0.3 * grid[:, 0] - 0.2 * grid[:, 1], grid[:, 1]])
    clouds = {
        "none": np.zeros((0, 3)),
        "nan": np.array([[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0]]),
        "one": np.zeros((1, 3)),
        "two": np.array([[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0]]),
        "equal": np.zeros((1000, 3)),
        "repeated": np.repeat(tilted, 3, axis=0),
        "collinear": np.linspace([-0.01, 0, -0.003], [0.01, 0, 0.003], 200),
        "coplanar": tilted,
        "dust": rng.uniform(-5e-3, 5e-3, (100_000, 3)),
    }
    points = clouds[kind]
    top = {"dust": 5e-3, "coplanar": 5e-3, "repeated": 5e-3}.get(kind, 0.0)
    return walked(Ground(points, (R + top) * UP, UP), 1000 if kind == "dust" else 3000)


def curve(kind: str) -> float:
    """Planar curves with every trap, met along the whole curve and across it."""
    points = _curve(kind)
    ground = Ground(points, points.min(axis=0) - 2 * R, -UP, {"ignore_axis": "z"})
    engine = ground.engine()
    way = [ground.start(engine)]
    for p in points[:: max(1, len(points) // 60)]:
        way += [p + np.array([2e-3, 1e-3, 0]), p - np.array([1e-3, 3e-3, 0])]
    edges = np.arange(len(way))
    at = np.linspace(0, len(way) - 1, 40 * len(way))
    hips = np.column_stack([np.interp(at, edges, np.array(way)[:, k]) for k in range(3)])
    return breach(engine, ground, engine.run(hips))


def _curve(kind: str) -> Vector:
    t = np.linspace(-1, 1, 801)
    if kind == "cusp":  # semicubical: both branches leave the tip along one tangent
        x, y = 0.04 * t * t, 0.02 * t**3
    elif kind == "spiral":  # 11 mm from turn to turn
        a = np.linspace(2 * np.pi, 8 * np.pi, 2001)
        r = 11e-3 * a / (2 * np.pi)
        x, y = r * np.cos(a), r * np.sin(a)
    elif kind == "near":  # a hairpin, its legs 1 mm apart
        s = np.linspace(0, 0.04, 401)
        x, y = np.concatenate([s, s[::-1]]), np.repeat([0.0, 1e-3], 401)
    else:  # a channel that the proxy does not fit
        s = np.linspace(-0.03, 0.03, 301)
        x, y = np.tile(s, 2), np.repeat([-4.95e-3, 4.95e-3], 301)
    return np.column_stack([x, y, 0 * x])


def certified(spacing: float) -> float:
    """Whether a bundle of a straight curve with this spacing is certified not to leak."""
    from vfplan.bundle.content import to_content
    from vfplan.bundle.leak import certificate
    from vfplan.fixture import Curve, Fixture, Provenance, Rendering

    points = np.arange(10)[:, None] * np.array([spacing, 0.0, 0.0])
    fixture = Fixture(
        "robot_base",
        points,
        Provenance("2026-01-01T00:00:00Z", "vfplan"),
        curve=Curve(np.zeros(10, np.int32), np.array([False])),
        rendering=Rendering(np.full(3, 1e3), R, 1e-5, ignore_axis=np.array([0.0, 0.0, 1.0])),
    )
    return float(certificate(to_content(fixture))["/leak@certified"])


def leaking(spacing: float) -> float:
    """The opposite of `certified`."""
    return 1.0 - certified(spacing)


RC = 5e-3


def walk(outer_over_r2: float | None = None, point_radius: float = 0.0, **settings: Any) -> float:
    """The breach over a random walk on the patch with these settings [m]."""
    ground: Ground = patch()
    if outer_over_r2 is not None:
        settings |= {"band": 1e-5, "outer_radius": outer_over_r2 * (RC + 1e-5)}
    lifted = replace(ground, touch=ground.touch + max(point_radius, 0.0) * ground.out)
    return walked(lifted, point_radius=point_radius, **settings)


def force(stiffness: float | tuple[float, ...]) -> float:
    """Largest relative error of F against K (proxy - HIP), component by component."""
    ground = patch()
    engine = ground.engine(stiffness=stiffness)
    hips = walk_path(ground, engine, 2000)
    trace = engine.run(hips)
    expected = np.broadcast_to(stiffness, 3) * (trace.proxy - hips)
    error = np.abs(trace.force - expected)
    return float(np.max(error / np.maximum(np.abs(expected), np.finfo(float).tiny)))


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
