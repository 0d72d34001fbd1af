"""The worst tick of a robot's loop, over valid bundles of every kind."""

import re
from contextlib import suppress
from dataclasses import replace

import bundles
import curves
import meshes
import numpy as np
import pytest
from motion import NATIVE, compiled, grid, output, sizes

import vfplan
from vfplan.errors import SceneError, SettingError
from vfplan.fixture import Curve, Pieces, Rendering

pytestmark = pytest.mark.slow

MOST_US = 300


def strewn(draw):
    """Points in a ball, on a wavy sheet or along a rough line: from lonely to crowded."""
    count, size = round(10 ** draw.uniform(1.5, 4.8)), 10 ** draw.uniform(-2.5, -0.7)
    points, kind = size * draw.uniform(-1, 1, (count, 3)), draw.integers(3)
    if kind == 1:
        points[:, 2] = 0.1 * size * np.sin(5 * points[:, 0] / size)
    elif kind == 2:
        points = np.sort(points[:, :1], axis=0) * [1, 0, 0] + draw.normal(0, 1e-4, (count, 3))
    return replace(bundles.small(), points=points)


def drawn(draw):
    """A zigzag of lines and arcs: from long sides to a comb."""
    count, side = round(10 ** draw.uniform(0.5, 3.3)), 10 ** draw.uniform(-5, -2)
    corners = np.column_stack([
        side * np.arange(count + 1), draw.uniform(0, 10 * side, count + 1), np.zeros(count + 1),
    ])  # fmt: skip
    strokes = np.zeros(count + 1, np.int32), np.array([False])
    pieces = Pieces(corners, np.append(draw.choice([0.0, 0.3, -0.5], count), 0.0), *strokes)
    length = sizes(corners).sum()
    points = curves.samples(pieces, max(length / 5000, side / 20))
    points = np.column_stack([points, np.zeros(len(points))])
    curve = Curve(np.zeros(len(points), np.int32), strokes[1], pieces=pieces)
    return replace(bundles.small(), points=points, curve=curve)


def meshed(draw):
    """A sheet, smooth, wavy or rough, or triangles anyhow: from a few to a crowd."""
    n, size = round(10 ** draw.uniform(0.5, 2.3)), 10 ** draw.uniform(-2.5, -0.7)
    u = np.linspace(0, 1, n + 1)
    y, x, _ = grid(u, u).T
    waves = draw.uniform(0, 0.3) * np.sin(9 * x) * np.cos(7 * y)
    rough = draw.choice([0, 1e-3, 0.3]) / n * draw.normal(size=len(x))
    _, mesh = meshes.sheet(np.random.default_rng(0), n, 0.0)
    points = size * np.column_stack([x, y, waves + rough])
    if draw.random() < 0.2:
        points = size * draw.normal(size=points.shape) * draw.choice([1.0, 0.1])
    return replace(bundles.small(), points=points, mesh=mesh)


def rendered(fixture, draw):
    """With a tool, a band and iterations of its own."""
    radius = 10 ** draw.uniform(-3, -1.7)
    planar = fixture.pieces is not None or (fixture.mesh is None and draw.random() < 0.3)
    return replace(fixture, rendering=Rendering(np.full(3, 10 ** draw.uniform(2, 3.7)), radius,
        radius * 10 ** draw.uniform(-4, -2), point_radius=draw.choice([0.0, 1e-3]),
        max_iterations=draw.choice([None, 10, 400]),
        ignore_axis=np.array([0.0, 0, 1]) if planar else None))  # fmt: skip


def measured(folder, ticks):
    """(L, 5): a bundle, its rule, the bound of a tick, the worst, and after exchanges [us]."""
    program, files = compiled(folder, NATIVE / "worst_tick.cpp", "-O2"), sorted(folder.glob("*.h5"))
    printed = output(program, ticks, 4, *files, timeout=None)
    number = r"(\d+)\.h5 rule (\d) bound (\S+) worst (\S+) exchanged (\S+)"
    return np.array(re.findall(number, printed), dtype=float)


@pytest.mark.full
def test_no_tick_of_a_valid_bundle_takes_longer_than_its_bound(tmp_path):
    draw = np.random.default_rng(24)
    for k in range(150):
        fixture = rendered((strewn, meshed, drawn)[k % 3](draw), draw)
        with suppress(SceneError, SettingError):  # one that leaks, or whose samples are too coarse
            vfplan.write_fixture(fixture, tmp_path / f"{k:03}.h5")
    rows = measured(tmp_path, 4000)
    bound, worst = rows[:, 2], rows[:, 3]
    taken, ratio = bound <= MOST_US, bound / worst
    print(f"{len(rows)} loops, {(~taken).sum()} refused, worst {worst[taken].max():.0f} us; bound "
          f"over worst tick: least {ratio.min():.2f}, median {np.median(ratio):.2f}")  # fmt: skip
    assert len(rows) > 200
    assert (~taken).sum() > 10
    assert rows[taken, 3:].max() < MOST_US
    assert ratio.min() >= 1
