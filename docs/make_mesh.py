"""Print how far rules `exact` and `robust` are from the truth on triangle meshes, and how fast.

    python docs/make_mesh.py [BONE.stl]        (the table of docs/engine.md; a minute)

Balls and tori meshed ever more finely, corners on them, and a box, all of known offset: a HIP turns
around them up to 3 mm deep. A bone's mesh: along it, 2 mm deep, against a slow god-object on the
triangles that shares no code with the engine. `robust` has the points of the mesh refined to
0.5 mm, as `vfplan import` makes them; a star marks the rule that a bundle of it is rendered by.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import vfplan
from vfplan import _core
from vfplan.bundle import mesh_band
from vfplan.bundle.clouds import refined
from vfplan.engine.parameters import ProxyParameters

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "making"))
from triangle_scenes import Bone

R = 5e-3
HEAD = "RMS um", "worst um", "us a tick"


def grid(n, m, place):
    """Points (n m, 3) of two angles [rad], and triangles; closed both ways."""
    u, v = np.meshgrid(np.arange(n) / n, np.arange(m) / m, indexing="ij")
    at = np.arange(n * m).reshape(n, m)
    right, up = np.roll(at, -1, 0), np.roll(at, -1, 1)
    both = np.roll(right, -1, 1)
    faces = np.vstack([
        np.column_stack([at.ravel(), right.ravel(), both.ravel()]),
        np.column_stack([at.ravel(), both.ravel(), up.ravel()]),
    ])  # fmt: skip
    return place(2 * np.pi * u.ravel(), 2 * np.pi * v.ravel()), faces.astype(np.int32)


def tube(u, v, far=0.0):
    """A torus of radii 30 and 12 mm, or what lies `far` [m] outside of it."""
    wide = 0.03 + (0.012 + far) * np.cos(v)
    return np.column_stack([wide * np.cos(u), wide * np.sin(u), (0.012 + far) * np.sin(v)])


def ball(n):
    """A ball of 30 mm, each face of an octahedron cut into n² triangles: points, triangles."""
    octants = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    places, faces = [], []
    for octant in octants:
        at = {}
        for i in range(n + 1):
            for j in range(n + 1 - i):
                at[i, j] = len(places)
                places.append(octant * (i, j, n - i - j))
        faces += [(at[i, j], at[i + 1, j], at[i, j + 1]) for i, j in at if i + j < n]
        faces += [(at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]) for i, j in at if i + j < n - 1]
    points, row = np.unique(np.array(places, float), axis=0, return_inverse=True)
    points *= 0.03 / np.linalg.norm(points, axis=1)[:, None]
    return points, row.ravel()[np.array(faces)].astype(np.int32)


def bone(path):
    """As `scenes` gives it: a bone's surface around the HIP's path."""
    scene = Bone(source=path)
    hips = scene.path("press and slide", 0.1)
    points, row = np.unique(scene.corners.reshape(-1, 3), axis=0, return_inverse=True)
    return path.stem, points, row.reshape(-1, 3).astype(np.int32), hips, scene.truth(hips, R)


def box():
    """A box around the origin: points, triangles, half its sides."""
    half = np.array([0.03, 0.02, 0.025])
    points = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return points, np.array(faces, np.int32), half


def scenes():
    """Name, points, triangles, HIPs and true proxies (T, 3)."""
    s = np.linspace(0, 1, 12000)
    depth = 1.5e-3 * (1 - np.cos(40 * s))
    for n in (48, 96, 192, 384):
        points, faces = grid(n, n // 2, tube)
        u, v = 5 * s, 11 * s
        truth = tube(u, v, R)
        out = truth - tube(u, v)
        yield f"torus, {94 / n:.2g} mm", points, faces, truth - depth[:, None] * out / R, truth
    for n in (8, 32, 72):
        points, faces = ball(n)
        out = np.column_stack([np.cos(9 * s), np.sin(7 * s), np.sin(4 * s)])
        out /= np.linalg.norm(out, axis=1)[:, None]
        hips = (0.03 + R - depth[:, None]) * out
        yield f"ball, {45 / n:.2g} mm", points, faces, hips, (0.03 + R) * out
    points, faces, half = box()
    way = np.column_stack([np.cos(9 * s), np.sin(7 * s), np.sin(4 * s)])
    way *= 0.06 / np.linalg.norm(way, axis=1)[:, None]
    nearest = np.clip(way, -half, half)
    out = way - nearest
    out /= np.linalg.norm(out, axis=1)[:, None]
    yield "box", points, faces, nearest + (R - depth[:, None]) * out, nearest + R * out


def judge(engine, hips, truth):
    """RMS and largest error [um] and median tick [us], once in contact."""
    engine.reset(2 * truth[0] - hips[0] + 1e-3 * (truth[0] - hips[0]))
    trace, took = engine.run_timed(hips)
    held = np.linalg.norm(truth - hips, axis=1) > 1e-4
    held[:20] = False
    error = 1e6 * np.linalg.norm(trace.proxy - truth, axis=1)[held]
    return np.sqrt((error**2).mean()), error.max(), np.median(took[held])


def main(*bones: str) -> None:
    """The table."""
    print(f"{'':<36}{'exact':<29}robust")
    print(
        ("{:<16}" + "{:>10}" * 5 + "{:>11}" + "{:>10}" * 2).format(
            "", "triangles", "points", *HEAD, *HEAD
        )
    )
    for name, points, faces, hips, truth in (*scenes(), *(bone(Path(path)) for path in bones)):
        finer, many = refined(points, faces, R / 10)
        native = ProxyParameters.make(finer, contact_radius=R).native(None)
        exact = judge(vfplan.ProxyEngine.on(points, faces, R), hips, truth)
        robust = judge(vfplan.ProxyEngine(finer, R, mesh_band(finer, many, R)), hips, truth)
        marks = "* " if _core.by_triangles(finer, many, native) else " *"
        rows = (f"{a:>10.2f}{b:>10.1f}{c:>10.2f}" for a, b, c in (exact, robust))
        numbers = "".join(row + mark for row, mark in zip(rows, marks, strict=True))
        print(f"{name:<16}{len(faces):>10}{len(finer):>10}{numbers}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
