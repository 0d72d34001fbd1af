"""The worst tick of a robot's loop, over valid bundles of every kind."""

import re
import subprocess
from contextlib import suppress
from dataclasses import replace

import bundles
import numpy as np
import pytest
from conftest import ROOT, need_program

import vfplan
from vfplan.errors import SceneError
from vfplan.fixture import Curve, Pieces, Rendering

pytestmark = pytest.mark.slow

MOST_US = 300


def strewn(draw):
    """Points in a ball, on a wavy sheet or along a rough line: from lonely to crowded."""
    count, size = round(10 ** draw.uniform(1.5, 4.8)), 10 ** draw.uniform(-2.5, -0.7)
    points = size * draw.uniform(-1, 1, (count, 3))
    kind = draw.integers(3)
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
    along = np.arange(0, count, max(count / 5000, 0.05))
    points = np.column_stack([np.interp(along, np.arange(count + 1), c) for c in corners.T])
    curve = Curve(np.zeros(len(points), np.int32), strokes[1], pieces=pieces)
    return replace(bundles.small(), points=points, curve=curve)


def meshed(draw):
    """A sheet, smooth, wavy or rough, or triangles anyhow: from a few to a crowd."""
    n, size = round(10 ** draw.uniform(0.5, 2.3)), 10 ** draw.uniform(-2.5, -0.7)
    u = np.linspace(0, 1, n + 1)
    x, y = (side.ravel() for side in np.meshgrid(u, u, indexing="ij"))
    waves = draw.uniform(0, 0.3) * np.sin(9 * x) * np.cos(7 * y)
    rough = draw.choice([0, 1e-3, 0.3]) / n * draw.normal(size=len(x))
    at = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    mesh = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])]).astype(np.int32)
    points = size * np.column_stack([x, y, waves + rough])
    if draw.random() < 0.2:
        points = size * draw.normal(size=points.shape) * draw.choice([1.0, 0.1])
    return replace(bundles.small(), points=points, mesh=mesh)


def rendered(fixture, draw):
    """With a tool, a band and iterations of its own."""
    radius = 10 ** draw.uniform(-3, -1.7)
    planar = fixture.pieces is not None or (fixture.mesh is None and draw.random() < 0.3)
    return replace(fixture, rendering=Rendering(
        np.full(3, 10 ** draw.uniform(2, 3.7)), radius, radius * 10 ** draw.uniform(-4, -2),
        point_radius=draw.choice([0.0, 1e-3]), max_iterations=draw.choice([None, 10, 400]),
        ignore_axis=np.array([0.0, 0, 1]) if planar else None,
    ))  # fmt: skip


@pytest.mark.full
def test_no_tick_of_a_valid_bundle_takes_a_third_of_the_loop(tmp_path):
    compiler = need_program("g++", "g++")
    words = [compiler, "-std=c++20", "-O2", "-ffp-contract=off",
             f"-I{ROOT / 'vfplan' / 'native' / 'include'}", f"-I{ROOT / 'tests' / 'native'}",
             ROOT / "tests" / "native" / "worst_tick.cpp", "-o", tmp_path / "worst"]  # fmt: skip
    subprocess.run([*map(str, words)], check=True)
    draw = np.random.default_rng(24)
    for k in range(150):
        fixture = rendered((strewn, meshed, drawn)[k % 3](draw), draw)
        with suppress(SceneError):  # a mesh that leaks between samples
            vfplan.write_fixture(fixture, tmp_path / f"{k:03}.h5")
    done = subprocess.run(
        [tmp_path / "worst", "4000", "4", *sorted(tmp_path.glob("*.h5"))],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    found = re.findall(r"(\d+)\.h5 rule (\d) bound (\S+) worst (\S+)", done.stdout)
    rows = np.array(found, dtype=float)
    refused = done.stdout.count("a tick may take")
    worst = rows[rows[:, 3].argmax()]
    print(f"{len(rows)} loops, {refused} refused; the worst tick {worst[3]:.1f} us (bound "
          f"{worst[2]:.0f}), bundle {worst[0]:.0f}, rule {worst[1]:.0f}")  # fmt: skip
    assert len(rows) > 200
    assert refused > 10
    assert worst[3] < MOST_US
