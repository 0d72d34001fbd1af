"""Probes of extreme clouds: far, tiny, huge, empty, dense, sparse, degenerate."""

from __future__ import annotations

import numpy as np

from vfplan.engine.checks import Vector
from vfplan.study.extremes.ground import Ground, breach, moved, patch, walked

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
