"""Rule "paper": the native engine equals the NumPy reference, one tick from any common state.

States whose answer depends on the order in which the points are added up have no answer that two
programs could agree on; they are found by permuting the points for the reference, left out, and
counted.
"""

import numpy as np
import pytest
from motion import SHEET, unit_circle

import vfplan
from vfplan.reference import PaperProxy

TOLERANCE = 1e-9  # [m]
SENSITIVE = 1e-10  # a permutation moves the reference by more: left out


class Tally:
    """Compares one state after the other, and counts."""

    def __init__(self):
        self.ticks = self.left_out = 0
        self.states = {-1: 0, 0: 0, 1: 0, 2: 0}

    def compare(self, points, proxy, hips, seed=0, **settings):
        native = vfplan.ProxyEngine(points, rule="paper", **settings)
        reference = PaperProxy(points, **settings)
        shuffled = PaperProxy(np.random.default_rng(seed).permutation(points), **settings)
        for hip in hips:
            for engine in (native, reference, shuffled):
                engine.reset(proxy)
            a, b, c = native.step(hip), reference.step(hip), shuffled.step(hip)
            self.ticks += 1
            self.states[b.state] += 1
            if np.linalg.norm(b.proxy - c.proxy) > SENSITIVE or b.state != c.state:
                self.left_out += 1
                continue
            self.same(a, b, (proxy, hip))

    def same(self, a, b, where):
        scale = max(1.0, float(np.abs(b.proxy).max()))
        assert a.state == b.state, where
        assert np.linalg.norm(a.proxy - b.proxy) <= TOLERANCE * scale, where
        assert np.linalg.norm(a.normal - b.normal) <= 1e-7, where
        pull = 1e3 * TOLERANCE * scale + 1e-12 * np.linalg.norm(b.force)
        assert np.linalg.norm(a.force - b.force) <= 10 * pull, where


def near(rng, points, reach, count):
    """Positions around points of the cloud, at all distances up to 2.5 times `reach`."""
    at, way = points[rng.integers(len(points), size=count)], rng.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    return at + way * rng.uniform(0, 2.5, (count, 1)) * reach


def touching(points, proxy, distance, rng):
    """The proxy pushed out until the nearest point stands at `distance`, where that works."""
    for _ in range(60):
        away = proxy - points
        i = np.argmin((away**2).sum(axis=1))
        r = np.linalg.norm(away[i])
        proxy = points[i] + away[i] * (distance / r) if r > 0 else proxy + rng.normal(size=3)
    return proxy


def settings(rng):
    rc = 10 ** rng.uniform(-3, -1.5)
    band = rc * 10 ** rng.uniform(-6, -0.5)
    chosen = {"contact_radius": rc, "band": band, "outer_radius": (rc + band) * rng.uniform(1.1, 3),
        "gain": rng.uniform(0.1, 1), "stiffness": rng.uniform(1, 3000, 3)}  # fmt: skip
    if rng.random() < 0.5:
        chosen["point_radius"] = rc * 10 ** rng.uniform(-2, 1)
    if rng.random() < 0.4:
        chosen["ignore_axis"] = ["x", "y", "z", rng.normal(size=3)][rng.integers(4)]
    return chosen


def test_random_states():
    """Clouds of 1 to 80 points, every parameter of Table I drawn, in all four states."""
    rng, tally = np.random.default_rng(20260101), Tally()
    for case in range(600):
        chosen = settings(rng)
        reach = chosen["contact_radius"] + chosen.get("point_radius", 0.0)
        points = rng.normal(size=(rng.integers(1, 80), 3)) * reach * 10 ** rng.uniform(-1, 1)
        points += rng.normal(size=3) * 10 ** rng.uniform(-3, 0)
        proxy = near(rng, points, reach, 1)[0]
        if case % 2:
            spread = rng.uniform(-1.2, 1.2) * chosen["band"]
            proxy = touching(points, proxy, reach + spread, rng)
        tally.compare(points, proxy, near(rng, points, reach, 10), seed=case, **chosen)
    assert tally.ticks == 6000
    assert tally.left_out <= 6, tally.left_out
    assert min(tally.states.values()) > 200, tally.states


CLOUDS = {"sheet": SHEET, "dust": np.random.default_rng(1).uniform(-0.02, 0.02, (2000, 3)),
    "duplicates": np.repeat(np.random.default_rng(1).uniform(-0.02, 0.02, (300, 3)), 3, axis=0),
    "far away": SHEET + np.array([900.0, -400.0, 5.0])}  # fmt: skip


@pytest.mark.parametrize("name", CLOUDS)
@pytest.mark.parametrize("more",
    [{}, {"ignore_axis": "z"}, {"ignore_axis": (1, 2, 3)}, {"point_radius": 2e-3}, {"gain": 0.5}],
    ids=str)  # fmt: skip
def test_states_among_many_points(name, more):
    """Around the cloud and on contact with it, where a grid finds the points."""
    points, rng, tally = CLOUDS[name], np.random.default_rng(7), Tally()
    for case in range(60):
        proxy = points.mean(axis=0) + rng.uniform(-0.02, 0.02, 3)
        if case % 2:  # touching a point
            away = rng.normal(size=3)
            proxy = points[rng.integers(len(points))] + away / np.linalg.norm(away) * 5e-3
        hip = proxy + rng.normal(0, 0.004, 3)
        tally.compare(points, proxy, [hip], seed=case, stiffness=(900, 1000, 1100), **more)
    assert tally.left_out <= 3


def degenerate():
    """Clouds and states in which something is equal, zero, or cancels."""
    rc, point, turn = 5e-3, np.zeros((1, 3)), np.arange(12) * (np.pi / 6)
    ring = unit_circle(turn)
    line = np.arange(-20, 21)[:, None] * 1e-3 * np.array([[1.0, 0, 0]])
    pair, origin, (x, y, z) = np.array([[rc, 0, 0], [-rc, 0, 0]]), np.zeros(3), rc * np.eye(3)
    yield "on the only point", point, origin
    yield "at exactly r_c", point, x
    yield "at exactly r3", point, 2 * x
    yield "at exactly r_c of many", np.vstack([point] * 7), y
    yield "in the middle of a ring of contacts", ring * rc, origin
    yield "in the middle of a small ring", ring * 0.6 * rc, origin
    yield "in the middle of a free ring", ring * 1.4 * rc, origin
    yield "above a ring", ring * 3e-3, np.array([0, 0, 4e-3])
    yield "between two points", pair, origin
    yield "on a line of points", line, np.array([0.2e-3, 0, 0])
    yield "beside a line of points", line, y
    yield "duplicates", np.repeat(line, 3, axis=0), z
    yield "nearly duplicates", np.vstack([line, line + 1e-16]), z
    yield "far from everything", point, np.array([1.0, 1, 1])
    yield "a kilometre from the origin", line + 1e3, np.array([1e3, 1e3 + 4e-3, 1e3])


def hips_of(points, proxy):
    """HIPs on the proxy, on points, along the axes, tiny and huge steps away."""
    steps = np.vstack([np.eye(3), -np.eye(3), np.ones((1, 3))])
    sizes = [0.0, 1e-300, 1e-15, 1e-9, 1e-5, 1e-3, 5e-3, 1e-2, 1.0, 1e3]
    return [*(proxy + size * step for size in sizes for step in steps), *points[:3]]


def test_degenerate_states():
    tally, rings = Tally(), 0
    for name, points, proxy in degenerate():
        before = tally.left_out
        for axis in (None, "z", [1.0, 2.0, 2.0]):
            tally.compare(points, proxy, hips_of(points, proxy), ignore_axis=axis)
        if "ring" in name or "between" in name or "on a line" in name:
            rings += tally.left_out - before
    assert tally.left_out == rings, "only sums that cancel may depend on the order"
    assert tally.left_out <= 0.2 * tally.ticks, (tally.left_out, tally.ticks)
