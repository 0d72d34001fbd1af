"""Probes of settings at and beyond the ends of their ranges."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from vfplan.study.extremes.ground import Ground, patch, walk_path, walked

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
