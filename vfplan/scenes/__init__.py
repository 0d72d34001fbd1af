"""Scenes whose exact proxy is known, and the paper's own six.

>>> scene = Sheet()                                # Experiment 1, 40 401 points
>>> hips = scene.path("front", speed=0.1)          # (T, 3) HIP positions at 1 kHz
>>> proxy = scene.truth(hips, radius=5e-3)         # (T, 3) exact proxy
>>> force = scene.force(hips, proxy, 1000.0)       # (T, 3) exact force

The truth is that of the exact geometry, not of its samples: what an engine gets wrong against it
is the error a user sees.
"""

from __future__ import annotations

from vfplan.scenes.scenes import (
    Bend,
    Channel,
    Circle,
    Corner,
    Cylinder,
    DoubleSheet,
    Drawn,
    Omega,
    Point,
    Scene,
    Segment,
    Sheet,
    Sphere,
    Teapot,
    ThreeWalls,
    Wedge,
    travel,
)  # fmt: skip

# Every scene by its name.
SCENES: dict[str, type[Scene]] = {
    scene.name: scene
    for scene in (
        Point, Segment, Sheet, DoubleSheet, Circle, Sphere, Cylinder, Wedge, Corner, ThreeWalls,
        Channel, Omega, Teapot,
    )
}  # fmt: skip

__all__ = [
    "SCENES", "Bend", "Channel", "Circle", "Corner", "Cylinder", "DoubleSheet", "Drawn", "Omega",
    "Point", "Scene", "Segment", "Sheet", "Sphere", "Teapot", "ThreeWalls", "Wedge", "travel",
]  # fmt: skip
