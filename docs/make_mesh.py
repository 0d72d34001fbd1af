"""Print how far rules `exact` and `robust` are from the truth on triangle meshes, and how fast.

    python docs/make_mesh.py [BONE.stl]        (the table of docs/engine.md; a minute)

Balls and tori meshed ever more finely, corners on them, and a box, all of known offset: a HIP turns
around them up to 3 mm deep. A bone's mesh: along it, 2 mm deep, against a slow god-object on the
triangles that shares no code with the engine. `robust` has the points of the mesh refined to
0.5 mm, as `vfplan import` makes them; a star marks the rule that a bundle of it is rendered by.
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

import numpy as np

import vfplan
from vfplan import _core
from vfplan.bundle.importing import mesh_band, refined
from vfplan.engine.parameters import ProxyParameters

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "making"))
from triangle_scenes import Bone

R = 5e-3
HEAD = ["RMS um", "worst um", "us a tick"]
BALL_M = 0.03
"""Radius of the ball, and of the torus around its axis [m]."""
TUBE_M = 0.012
"""Radius of the torus's tube [m]."""


OCTANTS = np.array(list(itertools.product((-1, 1), repeat=3)))
"""(8, 3) the signs of the three coordinates in each octant."""


def grid(n, m, place):
    """Points (n m, 3) of two angles [rad], and triangles; closed both ways."""
    u, v = np.meshgrid(np.arange(n) / n, np.arange(m) / m, indexing="ij")
    corner = np.arange(n * m).reshape(n, m)
    right = np.roll(corner, -1, 0)
    up = np.roll(corner, -1, 1)
    opposite = np.roll(right, -1, 1)
    lower = np.column_stack([corner.ravel(), right.ravel(), opposite.ravel()])
    upper = np.column_stack([corner.ravel(), opposite.ravel(), up.ravel()])
    faces = np.vstack([lower, upper])
    return place(2 * np.pi * u.ravel(), 2 * np.pi * v.ravel()), faces.astype(np.int32)


def torus(u, v, offset=0.0):
    """A torus of radii 30 and 12 mm, or what lies `offset` [m] outside of it."""
    width = BALL_M + (TUBE_M + offset) * np.cos(v)
    return np.column_stack([width * np.cos(u), width * np.sin(u), (TUBE_M + offset) * np.sin(v)])


def ball(n):
    """A ball of 30 mm, each face of an octahedron cut into n² triangles: points, triangles."""
    places = []
    faces = []
    for octant in OCTANTS:
        number = {}
        for i in range(n + 1):
            for j in range(n + 1 - i):
                number[i, j] = len(places)
                places.append(octant * (i, j, n - i - j))
        for i, j in number:
            if i + j < n:
                faces.append((number[i, j], number[i + 1, j], number[i, j + 1]))
        for i, j in number:
            if i + j < n - 1:
                faces.append((number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]))
    points, row = np.unique(np.array(places, float), axis=0, return_inverse=True)
    points *= BALL_M / np.linalg.norm(points, axis=1)[:, None]
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
    points = OCTANTS * half
    faces = []
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    for a, b, c, d in quads:
        faces.append((a, b, c))
        faces.append((a, c, d))
    return points, np.array(faces, np.int32), half


def scenes():
    """Name, points, triangles, HIPs and true proxies (T, 3)."""
    s = np.linspace(0, 1, 12000)
    depth = 1.5e-3 * (1 - np.cos(40 * s))
    for n in (48, 96, 192, 384):
        points, faces = grid(n, n // 2, torus)
        u = 5 * s
        v = 11 * s
        truth = torus(u, v, R)
        out = truth - torus(u, v)
        yield f"torus, {94 / n:.2g} mm", points, faces, truth - depth[:, None] * out / R, truth
    for n in (8, 32, 72):
        points, faces = ball(n)
        out = np.column_stack([np.cos(9 * s), np.sin(7 * s), np.sin(4 * s)])
        out /= np.linalg.norm(out, axis=1)[:, None]
        hips = (BALL_M + R - depth[:, None]) * out
        yield f"ball, {45 / n:.2g} mm", points, faces, hips, (BALL_M + R) * out
    points, faces, half = box()
    outside = np.column_stack([np.cos(9 * s), np.sin(7 * s), np.sin(4 * s)])
    outside *= 0.06 / np.linalg.norm(outside, axis=1)[:, None]
    nearest = np.clip(outside, -half, half)
    out = outside - nearest
    out /= np.linalg.norm(out, axis=1)[:, None]
    yield "box", points, faces, nearest + (R - depth[:, None]) * out, nearest + R * out


def judge(engine, hips, truth):
    """RMS and largest error [um] and median tick [us], once in contact."""
    engine.reset(2 * truth[0] - hips[0] + 1e-3 * (truth[0] - hips[0]))
    trace, tick_us = engine.run_timed(hips)
    is_in_contact = np.linalg.norm(truth - hips, axis=1) > 1e-4
    is_in_contact[:20] = False
    error = 1e6 * np.linalg.norm(trace.proxy - truth, axis=1)[is_in_contact]
    return np.sqrt((error**2).mean()), error.max(), np.median(tick_us[is_in_contact])


def rows(*bones: str):
    """The lines of the table, two of them its head."""
    yield f"{'':<36}{'exact':<29}robust"
    heads = "{:<16}" + "{:>10}" * 5 + "{:>11}" + "{:>10}" * 2
    yield heads.format("", "triangles", "points", *HEAD, *HEAD)
    for name, points, faces, hips, truth in (*scenes(), *(bone(Path(path)) for path in bones)):
        finer, finer_faces = refined(points, faces, R / 10)
        native = ProxyParameters.make(points, contact_radius=R)
        exact = judge(vfplan.ProxyEngine.on(points, faces, R), hips, truth)
        band = mesh_band(finer, finer_faces, R)
        robust = judge(vfplan.ProxyEngine(finer, R, band), hips, truth)
        exact_mark = " "
        robust_mark = "*"
        if _core.tick_time_bound(points, faces, native) <= _core.max_tick_time:
            exact_mark = "*"
            robust_mark = " "
        counts = f"{name:<16}{len(faces):>10}{len(finer):>10}"
        yield f"{counts}{cells(exact)}{exact_mark}{cells(robust)}{robust_mark}".rstrip()


def cells(result):
    """RMS error, largest error and tick of a rule."""
    rms_um, worst_um, tick_us = result
    return f"{rms_um:>10.2f}{worst_um:>10.1f}{tick_us:>10.2f}"


if __name__ == "__main__":
    for line in rows(*sys.argv[1:]):
        print(line, flush=True)
