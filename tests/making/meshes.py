"""Random triangle meshes, HIP paths at them, and what judges a proxy among them.

Nothing here is shared with the product: a distance is the least over a triangle's plane and its
three sides, sideness is a solid angle, a rest is judged by the places around it.
"""

from __future__ import annotations

import numpy as np
from curves import R, path_at, steepest


def distance(corners, x) -> np.ndarray:
    """(T,) distance of the positions x (T, 3) from triangles (K, 3, 3)."""
    least = np.full(len(x), np.inf)
    for a, b, c in corners:
        for p, q in ((a, b), (b, c), (c, a)):
            along = q - p
            square = along @ along
            share = np.clip((x - p) @ along / square, 0, 1) if square else np.zeros(len(x))
            least = np.minimum(least, np.linalg.norm(x - p - share[:, None] * along, axis=1))
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length < 1e-12 * max(np.ptp(np.array([a, b, c]), axis=0).max() ** 2, 1e-30):
            continue
        normal /= length
        over = np.ones(len(x), bool)
        for p, q in ((a, b), (b, c), (c, a)):
            over &= (x - p) @ np.cross(normal, q - p) >= 0
        least = np.where(over, np.minimum(least, np.abs((x - a) @ normal)), least)
    return least


def winding(corners, x) -> np.ndarray:
    """(T,) how often a closed mesh goes round x (T, 3): Van Oosterom and Strackee (1983)."""
    whole = np.zeros(len(x))
    for triangle in corners:
        a, b, c = (corner - x for corner in triangle)
        la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        above = np.einsum("ij,ij->i", a, np.cross(b, c))
        below = la * lb * lc + sum(
            np.einsum("ij,ij->i", p, q) * r for p, q, r in ((a, b, lc), (b, c, la), (c, a, lb))
        )
        whole += 2 * np.arctan2(above, below)
    return np.round(whole / (4 * np.pi))


def sphere(radius, times):
    """An octahedron halved `times` times, its corners on a sphere: points, triangles."""
    points = [np.array(p, float) for p in np.vstack([np.eye(3), -np.eye(3)])]
    faces = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)]
    for _ in range(times):
        known, finer = {}, []

        def middle(i, j, known=known):
            key = min(i, j), max(i, j)
            if key not in known:
                known[key] = len(points)
                half = points[i] + points[j]
                points.append(half / np.linalg.norm(half))
            return known[key]

        for i, j, k in faces:
            a, b, c = middle(i, j), middle(j, k), middle(k, i)
            finer += [(i, a, c), (j, b, a), (k, c, b), (a, b, c)]
        faces = finer
    return radius * np.array(points), np.array(faces, np.int32)


def box(size=(0.03, 0.02, 0.025)):
    """A box around the origin: points, triangles."""
    points = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * size / 2
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return points, np.array(faces, np.int32)


def hollow(rng):
    """A ball or a box around another one, whose side may be turned: points, triangles."""
    skins = [box(rng.uniform(1, 2, 3)), sphere(1, rng.integers(1, 4)), sphere(1, 3)]
    (points, faces), (inner, side) = (skins[k] for k in rng.integers(3, size=2))
    points = np.vstack([points, inner * rng.uniform(0.3, 0.8)]) * rng.uniform(3, 9) * R
    return points, np.vstack([faces, side[:, :: rng.choice([-1, 1])] + len(points) - len(inner)])


def sheet(rng, n, height):
    """A grid of n x n squares 4 R wide with bumps: open all around."""
    u = np.linspace(-2, 2, n + 1) * R
    x, y = (side.ravel() for side in np.meshgrid(u, u, indexing="ij"))
    points = np.column_stack([x, y, height * rng.normal(size=len(x))])
    at = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return points, faces.astype(np.int32)


def facets(rng):
    """A ball, an ellipsoid or a wavy sheet that facets stand for: as `mesh`."""
    if rng.random() < 0.5:
        points, faces = sphere(rng.uniform(0.4, 2) * R, rng.integers(2, 4))
        return points * rng.uniform(0.8, 1.2, size=3), faces, True
    points, faces = sheet(rng, 8, 0)
    waves = np.sin(points[:, :2] * rng.uniform(0, 0.8, size=2) / R + rng.uniform(0, 6, size=2))
    points[:, 2] = rng.uniform(0, 1) * R * waves.sum(axis=1)
    return points, faces, False


def mesh(rng):
    """(points, triangles, closed): of one of the kinds that break a rule."""
    kind = rng.integers(7)
    if kind == 0:
        return *box(rng.uniform(0.5, 8, size=3) * R), True
    if kind == 1:
        points, faces = sphere(rng.uniform(0.5, 4) * R, 1)
        return points * rng.uniform(0.5, 1.5, size=3), faces, True
    if kind == 2:  # coplanar, nearly, and rough: flat to the last bit, by single precision, bumps
        return *sheet(rng, 4, rng.choice([0, 1e-9, 1e-6, 1e-4, 0.2 * R, R])), False
    if kind == 3:  # a groove narrower or wider than the proxy, without a bottom edge or with
        wide, deep = rng.uniform(0.3, 6) * R, rng.uniform(1, 4) * R
        points = np.array([[-wide, y, deep] for y in (-4 * R, 4 * R)])
        points = np.vstack([points, points * [0, 1, 0], points * [-1, 1, 1]])
        return points, np.array([[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3]], np.int32), False
    if kind == 4:  # anything through anything
        points = rng.normal(size=(9, 3)) * R * 10 ** rng.uniform(-1, 0.7)
        return points, np.arange(9, dtype=np.int32).reshape(3, 3), False
    if kind == 5:  # needles, a line, a dot, one twice
        points = rng.normal(size=(6, 3)) * R * [3, 0.01, 1e-6]
        return points, np.array([[0, 1, 2], [3, 4, 4], [5, 5, 5], [0, 1, 2]], np.int32), False
    points = np.vstack([np.zeros(3), np.eye(3)]) * rng.uniform(1, 6) * R  # a corner of three walls
    return points, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]], np.int32), False


def path(rng, proxy, normal, corners) -> np.ndarray:
    """Holding, lifting off, jumping, exactly singular, trembling, or sliding: (T, 3)."""
    place = corners[rng.integers(len(corners)), rng.integers(3)]
    return path_at(rng, proxy, normal, place, place)


def way_left(rng, corners, x, hip) -> float:
    """How steeply a free place near the rest x (3,) lies nearer to the HIP (3,): a sine, 0 is rest.

    Places on two small spheres around it; half way to them nothing may be much lower.
    """
    way = rng.normal(size=(600, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    return steepest(lambda at: distance(corners, at), x, hip, way, (0.0, 1e-5), 1e-7)
