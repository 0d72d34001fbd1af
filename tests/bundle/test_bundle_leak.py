"""The leak certificate's searches against slow, obvious ones; quick whatever the points are."""

from __future__ import annotations

import time
from dataclasses import replace

import bundles
import damage
import numpy as np
import pytest

import vfplan
from vfplan.bundle import leak, validate

CLOUDS = {
    "at random": lambda draw, n: draw.uniform(size=(n, 3)),
    "on a lattice": lambda draw, n: np.round(draw.uniform(size=(n, 3)) * 4) / 4,
    "many at one place": lambda draw, n: np.vstack([np.zeros((200, 3)), draw.uniform(size=(n, 3))]),
    "of all sizes": lambda draw, n: draw.normal(size=(n, 3)) * 10.0 ** draw.uniform(-8, 1, (n, 1)),
}


def across(points):
    return leak.Across({"/points": np.ascontiguousarray(points)})


def distances(points):
    """(N, N) distances, infinite from each point to itself."""
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    return apart


@pytest.mark.parametrize("make", CLOUDS.values(), ids=CLOUDS)
def test_the_loneliest_point_is_that_of_a_full_search(make, monkeypatch):
    draw = np.random.default_rng(11)
    for _ in range(40):
        monkeypatch.setattr(leak, "BLOCK", int(draw.integers(3, 300)))
        points = make(draw, int(draw.integers(2, 250)))
        distance, row = leak.loneliest(across(points))
        nearest = distances(points).min(axis=1)
        assert distance == pytest.approx(nearest.max(), rel=1e-14)
        assert nearest[row] == pytest.approx(nearest.max(), rel=1e-14)


@pytest.mark.parametrize("make", CLOUDS.values(), ids=CLOUDS)
def test_the_way_to_another_stroke_is_that_of_a_full_search(make, monkeypatch):
    draw = np.random.default_rng(12)
    for _ in range(20):
        monkeypatch.setattr(leak, "BLOCK", int(draw.integers(3, 300)))
        points = make(draw, int(draw.integers(40, 250)))
        strokes = int(draw.integers(2, 40))
        more = draw.integers(0, strokes, len(points) - strokes)
        stroke = np.sort(np.append(np.arange(strokes), more)).astype(np.int32)
        ends = np.column_stack(leak.stroke_ends(stroke)).ravel()
        found = leak.distance_to_other_strokes(across(points), stroke, ends)
        apart = distances(points)[ends]
        apart[stroke[ends][:, None] == stroke[None]] = np.inf
        assert found == pytest.approx(apart.min(axis=1), rel=1e-14)


def test_open_edges_are_those_counted_one_by_one():
    draw = np.random.default_rng(13)
    for _ in range(100):
        triangles = draw.integers(0, 9, (draw.integers(1, 40), 3)).astype(np.int32)
        edges = [tuple(sorted((t[i], t[i - 1]))) for t in triangles.tolist() for i in range(3)]
        assert leak.open_edges(triangles) == sum(edges.count(e) == 1 for e in set(edges))


def test_points_of_one_place_cost_no_more_than_others(tmp_path):
    """A tree cannot part them: a plain search among them takes minutes."""
    count = 200_000
    points = np.vstack([np.zeros((count, 3)), [[0.1, 0, 0]]])
    strokes = np.arange(count, dtype=np.int32) // 4
    curve = bundles.Curve(strokes, np.zeros(count // 4, bool))
    cloud = replace(bundles.small(), points=points, sigma=None, curve=None)
    fixtures = {"cloud": cloud, "curve": replace(cloud, points=points[:count], curve=curve)}
    for name, fixture in fixtures.items():
        started = time.process_time()
        vfplan.write_fixture(fixture, tmp_path / name)
        assert not [i for i in validate(tmp_path / name) if i.severity == "error"]
        assert time.process_time() - started < 10


def test_the_edges_of_the_largest_mesh_fit_into_memory():
    """4e6 triangles: 200 MiB on top of the file's own 250."""

    def work():
        triangles = np.random.default_rng(1).integers(0, 4_000_000, (4_000_000, 3), dtype=np.int32)
        return str(leak.open_edges(triangles))

    count, added = damage.in_child(work)
    assert int(count) > 11_000_000
    assert added < 200 + 46 + 30  # and the triangles themselves
