"""The leak certificate's searches against slow, obvious ones; quick whatever the points are."""

from __future__ import annotations

import time
from dataclasses import replace

import bundles
import damage
import numpy as np
import pytest

import vfplan
from vfplan import _core
from vfplan.bundle import leak
from vfplan.bundle.validation import validate

CLOUDS = {
    "at random": lambda draw, n: draw.uniform(size=(n, 3)),
    "on a lattice": lambda draw, n: np.round(draw.uniform(size=(n, 3)) * 4) / 4,
    "many at one place": lambda draw, n: np.vstack([np.zeros((200, 3)), draw.uniform(size=(n, 3))]),
    "of all sizes": lambda draw, n: draw.normal(size=(n, 3)) * 10.0 ** draw.uniform(-8, 1, (n, 1)),
}


def strokes_at_random(draw, points, strokes):
    more = draw.integers(0, strokes, points - strokes)
    return np.sort(np.append(np.arange(strokes), more)).astype(np.int32)


def distances(points):
    """(N, N) distances, infinite from each point to itself."""
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    return apart


def clouds(make, seed, count, fewest, monkeypatch):
    """So many clouds, each searched in blocks of another size, and the draw."""
    draw = np.random.default_rng(seed)
    for _ in range(count):
        monkeypatch.setattr(leak, "BLOCK", int(draw.integers(3, 300)))
        yield make(draw, int(draw.integers(fewest, 250))), draw


@pytest.mark.parametrize("make", CLOUDS.values(), ids=CLOUDS)
def test_the_loneliest_point_is_that_of_a_full_search(make, monkeypatch):
    for points, _ in clouds(make, 11, 40, 2, monkeypatch):
        distance, row = leak.loneliest(points)
        nearest = distances(points).min(axis=1)
        assert distance == pytest.approx(nearest.max(), rel=1e-14)
        assert nearest[row] == pytest.approx(nearest.max(), rel=1e-14)


@pytest.mark.parametrize("make", CLOUDS.values(), ids=CLOUDS)
def test_the_way_to_another_stroke_is_that_of_a_full_search(make, monkeypatch):
    for points, draw in clouds(make, 12, 20, 40, monkeypatch):
        stroke = strokes_at_random(draw, len(points), int(draw.integers(2, 40)))
        ends = np.column_stack(leak.stroke_ends(stroke)).ravel()
        found = leak.distance_to_other_strokes(points, stroke, ends)
        apart = distances(points)[ends]
        apart[stroke[ends][:, None] == stroke[None]] = np.inf
        assert found == pytest.approx(apart.min(axis=1), rel=1e-14)


def gap_of_a_plain_loop(points, stroke, closed):
    """The widest gap, as a loop over neighbours in Python finds it."""
    gaps = [0.0]
    for number, is_closed in enumerate(closed):
        row = points[stroke == number]
        gaps += np.linalg.norm(np.diff(row, axis=0), axis=1).tolist()
        if is_closed:
            gaps.append(np.linalg.norm(row[-1] - row[0]))
    return max(gaps)


def cover_of_a_fine_search(triangle):
    """Largest distance to the nearest corner among 20,000 places of one triangle."""
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, 141), np.linspace(0, 1, 141)))
    inside = np.column_stack([1 - u, u * (1 - v), u * v]) @ triangle
    return np.linalg.norm(inside[:, None] - triangle, axis=2).min(axis=1).max()


@pytest.mark.parametrize("axis", [None, (0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (2 / 3, -2 / 3, 1 / 3)])
def test_the_certificate_is_that_of_plain_loops(axis):
    draw = np.random.default_rng(14)
    if axis is not None:
        axis = np.array(axis)
    for _ in range(20):
        points = draw.uniform(size=(int(draw.integers(6, 60)), 3))
        seen = points if axis is None else points - np.outer(points @ axis, axis)
        stroke = strokes_at_random(draw, len(points), 5)
        closed = draw.integers(0, 2, 5).astype(np.uint8)
        widest = gap_of_a_plain_loop(seen, stroke, closed)
        kind, gap, limit, holds, rows = _core.certificate(
            points, axis, 0.3, stroke=stroke, closed=closed
        )
        assert (kind, limit, holds) == ("curve", 0.6, gap <= 0.6)
        assert gap == pytest.approx(widest, rel=1e-12)
        assert np.linalg.norm(seen[rows[0]] - seen[rows[1]]) == pytest.approx(gap, rel=1e-12)

        triangles = draw.integers(0, len(points), (3, 3)).astype(np.int32)
        covers = [cover_of_a_fine_search(seen[triangle]) for triangle in triangles]
        kind, cover, limit, holds, rows = _core.certificate(points, axis, 0.3, triangles=triangles)
        assert (kind, limit, holds) == ("mesh", 0.3, cover <= 0.3)
        assert max(covers) <= cover * (1 + 1e-9)
        assert cover == pytest.approx(max(covers), rel=0.03)
        assert cover_of_a_fine_search(seen[rows]) == pytest.approx(max(covers), rel=0.03)
        few = _core.certificate(points, axis, 0.3, triangles=triangles, sample_radius=0.1)
        assert few[1] == min(cover, 0.1)


@pytest.mark.parametrize("shape", [
    {"triangles": np.array([[0, 1, 3]], np.int32)},
    {"triangles": np.array([[0, -1, 2]], np.int32)},
    {"stroke": np.array([0, 0, 1], np.int32), "closed": np.array([0], np.uint8)},
    {"stroke": np.array([0, 0], np.int32), "closed": np.array([0], np.uint8)},
    {"stroke": np.array([0, 0, 0], np.int32)},
])  # fmt: skip
def test_a_shape_that_names_what_is_not_there_has_no_certificate(shape):
    with pytest.raises(ValueError, match="vfplan"):
        _core.certificate(np.zeros((3, 3)), None, 0.3, **shape)


def test_points_of_one_place_cost_no_more_than_others(tmp_path):
    """A tree cannot part them: a plain search among them takes minutes."""
    count = 200_000
    points = np.vstack([np.zeros((count, 3)), [[0.1, 0, 0]]])
    curve = bundles.Curve(np.arange(count, dtype=np.int32) // 4, np.zeros(count // 4, bool))
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
