"""Random curves of lines and arcs, HIP paths at them, and what judges a proxy among them.

Nothing here is shared with the product: a distance is found from centre and angles, a rest by
looking at the places around it.
"""

from __future__ import annotations

import numpy as np

from vfplan.fixture import Pieces
from vfplan.scenes.outline import in_space, unit_vectors

R = 5e-3
TICKS = 60  # between two looks at where the proxy is


def pieces(strokes, offset=0.0) -> Pieces:
    """Strokes of (vertices (K, 2), bulges (K,), closed) as the product has them."""
    return Pieces.joined([(in_space(v + offset), bulges, closed) for v, bulges, closed in strokes])


def links(curve: Pieces) -> list:
    """(a, b, bulge) of each line or arc; a dot is a line of no length."""
    out = []
    for s, closed in enumerate(curve.closed):
        mine = np.flatnonzero(curve.stroke == s)
        v, bulge = curve.vertices[mine, :2], curve.bulges[mine]
        count = len(mine) if closed and len(mine) > 1 else len(mine) - 1
        out += [(v[i], v[(i + 1) % len(mine)], bulge[i]) for i in range(count)]
        out += [(v[0], v[0], 0.0)] * (count == 0)
    return out


def distance(parts, x) -> np.ndarray:
    """(T,) distance of the positions x (T, 2) from lines and arcs."""
    least = np.full(len(x), np.inf)
    for a, b, bulge in parts:
        along = b - a
        chord = np.hypot(*along)
        if chord == 0 or bulge == 0:
            share = (x - a) @ along / (chord * chord) if chord else np.zeros(len(x))
            off = x - a - np.clip(share, 0, 1)[:, None] * along
            least = np.minimum(least, np.hypot(*off.T))
            continue
        across = np.array([-along[1], along[0]]) / chord
        top = (a + b) / 2 - bulge * chord / 2 * across
        radius = chord * (1 + bulge * bulge) / (4 * abs(bulge))
        centre = top + np.sign(bulge) * radius * across
        away, middle = x - centre, top - centre
        angle = np.arctan2(away[:, 1], away[:, 0]) - np.arctan2(middle[1], middle[0])
        beside = np.abs((angle + np.pi) % (2 * np.pi) - np.pi) <= 2 * np.arctan(abs(bulge))
        ends = np.minimum(np.hypot(*(x - a).T), np.hypot(*(x - b).T))
        least = np.minimum(least, np.where(beside, np.abs(np.hypot(*away.T) - radius), ends))
    return least


def samples(curve: Pieces, spacing: float) -> np.ndarray:
    """(N, 2) points along the curve, `spacing` apart at most."""
    return np.vstack([on_link(*link, spacing) for link in links(curve)])


def on_link(a, b, bulge, spacing) -> np.ndarray:
    """(N, 2) points from a to b along a line or an arc, `spacing` apart at most."""
    n = 2 + int(np.hypot(*(b - a)) * (1 + 2 * abs(bulge)) / spacing)
    if abs(bulge) < 1e-6:
        return a + np.linspace(0, 1, n)[:, None] * (b - a)
    across = np.array([a[1] - b[1], b[0] - a[0]])
    turn = np.linspace(-1, 1, n) * 2 * np.arctan(bulge)
    share = (1 + np.sin(turn) / np.sin(2 * np.arctan(bulge))) / 2
    rise = -(np.cos(turn) - np.cos(2 * np.arctan(bulge))) * (1 + bulge**2) / (4 * bulge)
    return a + share[:, None] * (b - a) + rise[:, None] * across


def stroke(rng, size):
    """Smooth arcs, zigzags, arcs with corners, slight kinks, or cusps."""
    kind, n = rng.integers(5), rng.integers(1, 9)
    at, angle = rng.uniform(-1, 1, 2) * size, rng.uniform(0, 2 * np.pi)
    vertices, bulges = [at], []
    for _ in range(n):
        length, bulge = R * 10 ** rng.uniform(-1.5, 0.8), 0.0
        if kind == 0:
            turn = rng.uniform(-1, 1) * rng.choice([0.05, 0.3, 0.9]) * np.pi / 2
            bulge = 0.0 if rng.random() < 0.2 else float(np.tan(turn / 2))
            angle += 2 * np.arctan(bulge)
        elif kind == 1:
            angle += rng.uniform(-np.pi, np.pi)
        elif kind == 2:
            angle, bulge = rng.uniform(0, 2 * np.pi), rng.uniform(-1, 1)
        elif kind == 3:
            angle += rng.choice([-1, 1]) * 10 ** rng.uniform(-9, -1)
            bulge = rng.choice([0.0, rng.uniform(-0.2, 0.2)])
        else:
            angle += rng.choice([0, np.pi]) + rng.choice([0, 1e-3, 1e-7])
            bulge = rng.choice([0, 0.3, -0.3])
        at = at + length * unit_vectors(angle)
        angle += 2 * np.arctan(bulge) * (kind == 0)
        vertices.append(at)
        bulges.append(bulge)
    closed = n >= 2 and rng.random() < 0.3
    return np.array(vertices), np.array([*bulges, rng.uniform(-1, 1) * closed]), closed


def singular(rng):
    """Rings, channels and cups about as wide as the proxy, a T, a crossing, two dots."""
    g = R * (1 + rng.choice([-1e-3, -1e-9, 0, 1e-12, 1e-9, 1e-6, 1e-3, 0.1]))
    line = np.array([[-4 * R, 0], [4 * R, 0]]), np.zeros(2), False
    up = np.array([[0, 0], [0, 3 * R]]), np.zeros(2), False
    slant = np.array([[-R, -3 * R], [R, 3 * R]]), np.array([rng.choice([0, 0.5]), 0]), False
    cup = np.array([[-g, 4 * R], [-g, 0], [g, 0], [g, 4 * R]]), np.array([0, 1.0, 0, 0]), False
    return [
        [(np.array([[g, 0], [-g, 0]]), np.ones(2), True)],
        [(line[0] + [0, g], line[1], False), (line[0] - [0, g], line[1], False)],
        [cup],
        [line, up],
        [line, slant, (line[0] / 2, line[1], False)],
        [(np.zeros((1, 2)), np.zeros(1), False), (np.array([[2 * g, 0.0]]), np.zeros(1), False)],
    ][rng.integers(6)]


def curve(rng) -> Pieces:
    """One of all that, also far from the origin."""
    if rng.random() < 0.25:
        strokes = singular(rng)
    else:
        size = R * 10 ** rng.uniform(-0.5, 0.9)
        strokes = [stroke(rng, size) for _ in range(rng.integers(1, 5))]
    return pieces(strokes, rng.choice([0, 0, 0.3, -2]))


def path(rng, proxy, normal, vertices) -> np.ndarray:
    """Holding, lifting off, jumping, exactly singular, trembling, or sliding: (T, 2)."""
    return path_at(rng, proxy, normal, vertices[rng.integers(len(vertices))], vertices.mean(axis=0))


def path_at(rng, proxy, normal, place, middle) -> np.ndarray:
    """A path of one of these kinds at a place of the fixture, which jumps around its middle."""
    k = len(proxy)
    target = place + rng.normal(size=k) * R * rng.choice([0, 0.1, 1])
    kind = rng.integers(8)
    if kind == 0:
        return np.tile(target + rng.normal(size=k) * R, (TICKS, 1))
    if kind == 1:
        way = normal + rng.normal(size=k) * rng.choice([0, 0, 0.3, 1.0])
        return proxy + np.outer(np.linspace(-0.3, 1, TICKS), way) * 3 * R
    if kind == 2:
        return middle + rng.normal(size=(TICKS, k)) * R * 10 ** rng.uniform(-1, 3)
    if kind == 3:
        return target + rng.choice([0, 0.5, 1, 2, 1 - 1e-12], size=(TICKS, 1)) * (proxy - target)
    if kind == 4:
        return target + rng.normal(size=(TICKS, k)) * R * 10 ** rng.uniform(-6, -1)
    speed = R * 10 ** rng.uniform(-4, 0)
    goals = np.vstack([proxy, target + rng.normal(size=(5, k)) * R * rng.uniform(0, 1.5)])
    edges = np.append(0, np.cumsum(np.linalg.norm(np.diff(goals, axis=0), axis=1)))
    s = np.arange(0, edges[-1], speed)
    if len(s) > TICKS:
        first = rng.integers(len(s) - TICKS)
        s = s[first : first + TICKS]
    return np.column_stack([np.interp(s, edges, axis) for axis in goals.T])


def way_left(parts, x, hip) -> float:
    """How steeply a free place near the rest x (2,) lies nearer to the HIP (2,): a sine, 0 is rest.

    Places on two small circles around it; between them and x nothing may be much lower.
    """
    turn = np.linspace(0, 2 * np.pi, 1440, endpoint=False)
    parts = [part for part in parts if distance([part], x[None])[0] < 1.1 * R]  # others: no part
    way = unit_vectors(turn)
    return steepest(lambda at: distance(parts, at), x, hip, way, (1e-9, 1e-7), 1e-9)


def steepest(away, x, hip, way, slack, least) -> float:
    """The same along given ways; `slack` of R at a place and half-way to it; `least`: the pull."""
    pull, most = np.linalg.norm(hip - x), 0.0
    for r in (1e-3 * R, 1e-2 * R):
        y = x + r * way
        free = away(y) >= R * (1 - slack[0])
        free &= away((x + y) / 2) >= R * (1 - slack[1]) - r * r / R
        gain = np.where(free, pull - np.linalg.norm(hip - y, axis=1), 0.0)
        most = max(most, float(gain.max(initial=0.0)) / r)
    return most if pull > least else 0.0
