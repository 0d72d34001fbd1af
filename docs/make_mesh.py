"""Print how far rules `exact` and `robust` are from the truth on triangle meshes, and how fast.

python docs/make_mesh.py        (the table of docs/engine.md; a minute)

A torus meshed ever more finely, corners on it, and a box, both of known offset; a HIP that turns
around them up to 3 mm deep. `robust` has the points of the mesh refined to 0.5 mm, as
`vfplan import` makes them.
"""

from __future__ import annotations

import numpy as np

import vfplan
from vfplan.bundle import mesh_band
from vfplan.bundle.clouds import refined

R = 5e-3
HEAD = "triangles", "points", "exact um", "robust um", "exact us", "robust us"


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
    points, faces, half = box()
    way = np.column_stack([np.cos(9 * s), np.sin(7 * s), np.sin(4 * s)])
    way *= 0.06 / np.linalg.norm(way, axis=1)[:, None]
    nearest = np.clip(way, -half, half)
    out = way - nearest
    out /= np.linalg.norm(out, axis=1)[:, None]
    yield "box", points, faces, nearest + (R - depth[:, None]) * out, nearest + R * out


def judge(engine, hips, truth):
    """RMS error [um] and median tick [us], once in contact."""
    engine.reset(2 * truth[0] - hips[0] + 1e-3 * (truth[0] - hips[0]))
    trace, took = engine.run_timed(hips)
    error = np.linalg.norm(trace.proxy - truth, axis=1)[20:]
    return 1e6 * np.sqrt((error**2).mean()), np.median(took)


def main() -> None:
    """The table."""
    print(("{:<16}" + "{:>10}" * 6).format("", *HEAD))
    for name, points, faces, hips, truth in scenes():
        finer, many = refined(points, faces, R / 10)
        exact = judge(vfplan.ProxyEngine.on(points, faces, R), hips, truth)
        band = mesh_band(finer, many, R)
        robust = judge(vfplan.ProxyEngine(finer, R, band), hips, truth)
        numbers = f"{exact[0]:>10.2f}{robust[0]:>10.2f}{exact[1]:>10.2f}{robust[1]:>10.2f}"
        print(f"{name:<16}{len(faces):>10}{len(finer):>10}{numbers}")


if __name__ == "__main__":
    main()
