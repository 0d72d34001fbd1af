"""What a user would build on a library for meshes: a penalty force from the nearest place.

    python mesh_peer.py igl|coal|open3d FOLDER

A peer for `vfplan bench --peer`: reads corners.csv, triangles.csv, path.csv and settings.csv in
FOLDER, writes proxies.csv. The "proxy" of a penalty force is where that force would be zero.

libigl and Open3D answer many positions in one call, so their times are means over BLOCK ticks. coal
answers one position in a call, and its time holds Python's call.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

BLOCK = 50
"""Number of ticks whose nearest places are asked for in one call."""


def with_igl(corners: np.ndarray, triangles: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Nearest places by libigl's tree of boxes."""
    import igl

    tree = igl.AABB()
    tree.init(corners, triangles)
    return lambda hips: tree.squared_distance(corners, triangles, hips)[2]


def with_coal(corners: np.ndarray, triangles: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Nearest places by coal: the distance of a dot from a tree of turned boxes."""
    import coal

    model = coal.BVHModelOBBRSS()
    model.beginModel(len(triangles), len(corners))
    model.addVertices(corners)
    model.addTriangles(triangles)
    model.endModel()
    dot, here, there = coal.Sphere(1e-12), coal.Transform3s(), coal.Transform3s()
    request, result = coal.DistanceRequest(), coal.DistanceResult()

    def nearest(hips: np.ndarray) -> np.ndarray:
        there.setTranslation(hips[0])
        result.clear()
        coal.distance(dot, there, model, here, request, result)
        return np.array([result.getNearestPoint2()])

    return nearest


def with_open3d(corners: np.ndarray, triangles: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Nearest places by Open3D's ray casting scene, in float32."""
    import open3d

    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(corners.astype(np.float32), triangles.astype(np.uint32))

    def nearest(hips: np.ndarray) -> np.ndarray:
        found = scene.compute_closest_points(hips.astype(np.float32), nthreads=1)
        return found["points"].numpy().astype(float)

    return nearest


def main(library: str, folder: Path) -> None:
    """Push each position out of the ball around its nearest place."""
    makers = {"igl": with_igl, "coal": with_coal, "open3d": with_open3d}
    corners = np.loadtxt(folder / "corners.csv", delimiter=",", skiprows=1)
    triangles = np.loadtxt(folder / "triangles.csv", int, delimiter=",", skiprows=1)
    hips = np.loadtxt(folder / "path.csv", delimiter=",", skiprows=1, ndmin=2)
    names, values = np.loadtxt(folder / "settings.csv", str, delimiter=",", skiprows=1).T
    settings = dict(zip(names, values.astype(float), strict=True))
    radius = settings["contact_radius"] + settings["point_radius"]
    nearest = makers[library](corners, triangles)
    block = 1 if library == "coal" else BLOCK
    nearest(hips[:block])  # The first call loads the library.
    rows = []
    for first in range(0, len(hips), block):
        x = hips[first : first + block]
        began = time.perf_counter_ns()
        away = x - nearest(x)
        distance = np.linalg.norm(away, axis=1)[:, None]
        push = np.maximum(radius - distance, 0.0) * away / np.maximum(distance, 1e-300)
        us = (time.perf_counter_ns() - began) / 1e3 / len(x)
        rows.append(np.column_stack([x + push, np.full(len(x), us)]))
    np.savetxt(
        folder / "proxies.csv", np.vstack(rows), "%.17g", ",", header="x,y,z,us", comments=""
    )


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
