"""Rule "exact" among triangles: the guarantees against the mesh itself, its truth in closed form.

`meshes.py` draws the cases and judges them.
"""

from collections import Counter
from dataclasses import replace
from functools import partial

import meshes
import numpy as np
import pytest
from meshes import R
from motion import NATIVE, compiled, drag, hold, output, play, unbroken
from replays import meshed
from scipy.spatial import cKDTree
from triangle_scenes import Triangles

from vfplan import ProxyEngine, _core
from vfplan.bundle.importing import refined
from vfplan.bundle.leak import largest_cover
from vfplan.engine.proxy import MAX_TICK_TIME, Status, sampled
from vfplan.errors import SceneError
from vfplan.geometry.lines import row_lengths, step_lengths
from vfplan.scenes import god_object

BROKEN = "inside", "grown", "through", "restless", "stuck"


def case(seed, tally, mesh=meshes.mesh):
    """One mesh, twelve paths: guarantees 1 to 3 in every tick, the last one held."""
    rng = np.random.default_rng(seed)
    points, triangles, closed = mesh(rng)
    points = points + rng.choice([0, 0, 1.0]) * rng.normal(size=3)
    corners = points[triangles]
    share = rng.choice([1.0, 1.0, 0.6])
    engine = ProxyEngine.on(points, triangles, share * R, R - share * R)
    proxy = points.mean(axis=0) + np.array([1, 0.3, 0.2]) * (np.ptp(points) + 6 * R)
    if rng.random() < 0.15:
        proxy = points[rng.integers(len(points))] + rng.normal(size=3) * R / 2
    draw, away = (partial(meshes.path, rng, corners=corners), partial(meshes.distance, corners))
    for trace, hips, before, out in drag(engine, tally, draw, proxy, 3, away, late=True):
        x = trace.proxy
        if closed:
            side = meshes.winding(corners, np.vstack([before[:1], x]))
            tally["through"] += int((out & (side[1:] != side[:-1])).sum())
        if out[-4:].all() and not (trace.status[-1] & Status.LIMIT):
            tally["rests"] += 1
            settled = trace.status[-2] == 0
            tally["restless"] += int(settled and not np.array_equal(x[-1], x[-2]))
            # On a smooth body, for which the band is wider, facets have a way left.
            if mesh is meshes.mesh and engine.parameters.band < 2e-5 * R:
                tally["stuck"] += int(meshes.way_left(rng, corners, x[-1], hips[-1]) > 0.05)


@pytest.mark.parametrize("seeds, mesh, ticks", [
    (range(12), meshes.mesh, 2e3 / 0.3), (range(4), meshes.facets, 0),
    pytest.param(range(60), meshes.facets, 0, marks=pytest.mark.full),
    pytest.param(range(100, 1800), meshes.mesh, 1e6, marks=pytest.mark.full)])  # fmt: skip
def test_never_inside_never_grows_and_rests(seeds, mesh, ticks):
    tally = Counter()
    for seed in seeds:
        case(seed, tally, mesh)
    unbroken(tally, BROKEN)
    assert tally["contact"] > 0.3 * tally["ticks"], tally
    assert tally["ticks"] > ticks, tally


def test_two_walls_that_meet_under_the_hip_both_hold_the_proxy():
    """The HIP on the end of a groove has one foot on both walls, which are bodies of their own."""
    for wide, deep in ((3.7, 1.7), (2.7, 1.02)):
        x, y, z = np.array([[-wide, 4, deep], [0, 4, 0], [wide, 4, deep]]).T * R
        points = np.vstack([np.c_[x, -y, z], np.c_[x, y, z]])
        triangles = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]], np.int32)
        for start in np.random.default_rng(6).uniform([-8, -9, 3], [8, 9, 9], (400, 3)) * R:
            engine = ProxyEngine.on(points, triangles, R)
            engine.reset(start)
            if meshes.distance(points[triangles], start[None])[0] < R:
                continue
            proxy = engine.step(points[1]).proxy
            assert meshes.distance(points[triangles], proxy[None])[0] > R * (1 - 2e-5)


def test_the_distance_is_that_of_the_nearest_of_all_triangles():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        points, triangles, _ = meshes.mesh(rng)
        places = rng.choice(points, 200) + rng.normal(size=(200, 3)) * rng.choice([1e-3, 0.1])
        found = ProxyEngine.on(points, triangles, R).distance(places)
        assert found == pytest.approx(meshes.distance(points[triangles], places), abs=1e-15)


def test_a_box_is_rounded_in_closed_form():
    """Over faces, edges and corners: the HIP, carried from the box's nearest place to R from it."""
    size = np.array([0.03, 0.02, 0.025])
    engine, rng = ProxyEngine.on(*meshes.box(size), R), np.random.default_rng(5)
    way = np.cumsum(rng.normal(size=(4000, 3)), axis=0)
    way /= row_lengths(way)[:, None]
    nearest = np.clip(way * 0.05, -size / 2, size / 2)
    normal = way * 0.05 - nearest
    normal /= row_lengths(normal)[:, None]
    hips = nearest + R * rng.uniform(0.4, 0.9, size=(4000, 1)) * normal
    trace = play(engine, hips, nearest[0] + 2 * R * normal[0])
    assert np.abs(trace.proxy - nearest - R * normal).max() < 5e-7
    assert (trace.status == 0).mean() > 0.99
    assert (trace.state == 1).all()


def test_corners_and_grooves_hold_it_where_two_and_three_walls_meet():
    corner = np.vstack([np.zeros(3), np.eye(3)]), [[0, 1, 2], [0, 2, 3], [0, 3, 1]]
    engine = ProxyEngine.on(*corner, R)
    engine.reset([0.02, 0.03, 0.04])
    held = engine.step([-1e-3, -2e-3, 3e-3])
    assert held.proxy == pytest.approx([R, R, R], abs=1e-9)
    assert held.force == pytest.approx([6, 7, 2], abs=1e-6)
    wide, deep = 0.02, 0.03
    points = [[x, y, z] for x, z in ((-wide, deep), (0, 0), (wide, deep)) for y in (-1, 1)]
    engine = ProxyEngine.on(points, [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]], R)
    low = R * np.hypot(wide, deep) / wide  # where the ball touches both sides
    along = np.linspace(0, 0.2, 300)
    hips = np.column_stack([0 * along, along, 0 * along + 1e-3])
    proxy = play(engine, hips, [0, 0, 0.05]).proxy
    assert proxy[1:] == pytest.approx(hips[1:] + np.array([0, 0, low - 1e-3]), abs=1e-9)


def test_a_rough_sheet_as_the_slow_god_object_has_it():
    """The truth slides in small steps among distances alone, by another method."""
    rng = np.random.default_rng(8)
    points, triangles = meshes.sheet(rng, 4, 1e-3)
    truth = (Triangles(points[triangles]),)
    engine = ProxyEngine.on(points, triangles, R)
    spots = rng.uniform(-1, 1, size=(6, 3)) * [1.5 * R, 1.5 * R, 1e-3]
    for spot in spots:
        start, hip = np.add(spot, [0, 0, 3 * R]), np.add(spot, [0, 0, 2e-3])
        engine.reset(start)
        engine.step(start)
        found = hold(engine, hip, 20).proxy[-1]
        assert np.abs(found - god_object.follow(truth, start, hip, R)).max() < 1e-6


def test_a_sphere_of_many_triangles_is_the_sphere():
    """Of its offset, outside and inside, by a tenth of a micrometre; no facet is felt."""
    points, triangles = meshes.sphere(0.03, 5)
    engine, turn = ProxyEngine.on(points, triangles, R), np.linspace(0, 1, 600)
    way = np.column_stack([np.cos(turn), np.sin(turn) * 0.8, np.sin(turn) * 0.6])
    for start, hip, proxy in ((0.05, 0.033, 0.035), (0.01, 0.029, 0.025)):
        trace = play(engine, hip * way, start * way[0])
        assert np.abs(trace.proxy - proxy * way).max() < 1e-7
        assert (trace.status == 0).all()
    assert 1e-6 < engine.parameters.band < 5e-5
    assert engine.distance(trace.proxy).min() >= R - engine.parameters.band


@pytest.mark.parametrize("rule", ["exact", "robust"])
@pytest.mark.parametrize("turned", [False, True])
def test_under_the_skin_of_closed_bodies_the_way_out_is_the_outer_one(turned, rule):
    """Two balls 3 mm apart, nearer than the proxy fits; of one, facets may look inwards."""
    points, triangles = meshes.sphere(0.03, 3)
    points = np.vstack((points, points + np.array([0.063, 0, 0])))
    second = triangles + len(points) // 2
    corners = np.vstack((triangles, second[:, ::-1] if turned else second))
    drawn = replace(meshed(points, corners), sample_radius=1e-3)
    drawn = replace(drawn, rendering=replace(drawn.rendering, band=1.5e-4))
    engine = ProxyEngine.of(drawn, rule)
    rng = np.random.default_rng(4)
    deepest = {"exact": 0.95, "robust": 0.8}[rule] * R
    for depth in (1e-6, *rng.uniform(0, deepest, 6)):
        away = rng.normal(size=3) if depth > 1e-3 else np.array([1, 0, 0])
        hip = away / np.linalg.norm(away) * (0.0295 - depth)
        engine.reset(hip)
        trace = hold(engine, hip, 3000)
        assert trace.status[0] == Status.INSIDE
        assert trace.status[-1] == 0
        out = trace.proxy[-1:]
        assert meshes.winding(points[corners], out)[0] == 0
        assert engine.distance(out)[0] >= R - engine.parameters.band
        assert step_lengths(trace.force).max() <= 1000 * (R / 256 + 1e-9)


def test_on_the_skin_of_a_closed_body_the_way_out_is_the_outer_one():
    points, triangles = refined(*meshes.box(), 5e-3)
    engine = ProxyEngine.on(points, triangles, R)
    for hip in points:
        engine.reset(hip)
        proxy = hold(engine, hip, 1500).proxy[-1:]
        assert meshes.winding(points[triangles], proxy)[0] == 0


def test_far_from_a_mesh_the_state_tells_whether_it_has_smooth_edges():
    """As docs/rules.md says: -1 where it has, else 0."""
    for shape, state in ((meshes.sphere(0.03, 3), -1), (meshes.box((0.02, 0.02, 0.02)), 0)):
        assert ProxyEngine.on(*shape, R).step([1.0, 0.0, 0.0]).state == state


def row_of_cubes():
    """The engine of 1500 cubes, and a place in the first. A search for its body looks through all
    of them, which takes more than a tick."""
    points, triangles = meshes.box((0.02, 0.02, 0.02))
    rows = np.arange(1500)[:, None, None]
    points = (points + 0.03 * rows * RAY).reshape(-1, 3)
    engine = ProxyEngine.on(points, (triangles + 8 * rows).reshape(-1, 3), R)
    return engine, np.array([0.0085, 1e-3, 5e-4])


@pytest.mark.parametrize("speed", [1e-4, 1e-3, 3e-3])
def test_a_hand_that_never_rests_comes_out_of_a_body(speed):
    """It goes by up to R a tick, and all the cubes stay before it. Else the force would stay."""
    engine, hip = row_of_cubes()
    play(engine, np.tile(hip, (200, 1)))
    trace = engine.run(hip - np.outer(np.arange(1000), speed * RAY))
    assert trace.status[0] == Status.INSIDE
    assert np.linalg.norm(trace.force[0]) > 0.5
    assert not np.any(trace.status[500:])
    assert not np.any(trace.force[500:])


def test_a_search_for_the_body_stops_at_the_budget_of_a_tick():
    engine, hip = row_of_cubes()
    times = []
    for _ in range(4):
        engine.reset(hip)
        trace, micros = engine.run_timed(np.tile(hip, (2000, 1)))
        times.append(micros)
    assert trace.status[-1] == 0
    assert trace.proxy[-1] == pytest.approx(hip * [0, 1, 1] + [0.01 + R, 0, 0], abs=1e-6)
    assert np.min(times, axis=0).max() < 1e6 * MAX_TICK_TIME


# Along which the core looks for the body.
RAY = np.array([0.4317, 0.5713, 0.6980361])


@pytest.mark.parametrize("shape", [meshes.sphere(0.03, 2), refined(*meshes.box(), 8e-3)])
def test_a_ray_through_corners_and_edges_tells_the_side(shape, tmp_path):
    points, triangles = shape
    corners = points[triangles]
    edges = (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3) / 2
    on_skin = np.vstack([points, np.unique(edges, axis=0), corners.mean(axis=1)])
    places = np.vstack([on_skin + way * RAY for way in (-0.05, -0.013, -0.004, -1e-3, 1e-3, 0.01)])
    places = places[meshes.distance(corners, places) > 1e-6]
    numbers = [len(points), len(triangles), len(places)]
    for rows in (points, triangles, places):
        numbers += rows.ravel().tolist()
    program = compiled(tmp_path, NATIVE / "mesh_sides.cpp", "-O0", "-DVFPLAN_NARROW")
    found = output(program, input=" ".join(map(repr, numbers)))
    assert np.array_equal(np.array(found.split(), int), meshes.winding(corners, places))
    assert len(places) > 800


@pytest.mark.parametrize("times", [0, 2])
def test_a_refined_mesh_is_the_same_surface(times):
    """Turned and moved, so that nothing lies on round numbers."""
    rng = np.random.default_rng(6)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    points, triangles = meshes.sphere(0.03, times) if times else meshes.box()
    finer, many = refined(points, triangles, 2e-3)
    finer = finer @ turn.T + [0.5, 0.2, 0.3]
    assert len(many) > 50 * len(triangles)
    engine = ProxyEngine.on(finer, many, R)
    plain = ProxyEngine.on(points @ turn.T + [0.5, 0.2, 0.3], triangles, R)
    inside = np.einsum("kij,ki->kj", finer[many], rng.dirichlet(np.ones(3), size=len(many)))
    assert plain.distance(inside).max() < 1e-10
    around = finer[rng.integers(len(finer), size=300)] + rng.normal(size=(300, 3)) * R
    assert engine.distance(around) == pytest.approx(plain.distance(around), abs=1e-10)


@pytest.mark.parametrize("cover", [3e-3, 4e-4])
def test_samples_of_a_mesh_leave_no_place_farther_away(cover):
    """Of a ball, of a box, and of needles, against a fine search over each triangle."""
    rng = np.random.default_rng(8)
    needles = rng.normal(size=(30, 3)) * [0.02, 0.02, 2e-4]
    shapes = [meshes.sphere(0.03, 1), meshes.box(), (needles, np.arange(30).reshape(10, 3))]
    for points, triangles in shapes:
        triangles = np.ascontiguousarray(triangles, np.int32)
        samples, pieces = _core.sampled(points, triangles, cover)
        assert np.array_equal(samples[: len(points)], points), "corners keep their numbers"
        assert largest_cover(pieces, samples) <= cover * (1 + 1e-9)
        weights = rng.dirichlet(np.ones(3), size=(400, 1))
        places = (points[triangles] * weights[..., None]).sum(axis=2).reshape(-1, 3)
        assert cKDTree(samples).query(places)[0].max() <= cover * (1 + 1e-9)
        again, same = _core.sampled(samples, pieces, cover)
        assert np.array_equal(again, samples)
        assert np.array_equal(same, pieces)


def test_more_samples_than_a_bundle_holds_are_refused():
    drawn = replace(meshed(*meshes.box()), sample_radius=1e-6)
    assert ProxyEngine.of(drawn).rule == "exact"
    with pytest.raises(SceneError, match="more than 4000000"):
        ProxyEngine.of(drawn, "robust")


@pytest.mark.parametrize("rule", ["robust", "paper"])
def test_rules_that_render_points_take_samples_of_a_drawn_mesh(rule):
    """A box's side is 18 mm from any corner in its middle: corners alone let the tool through."""
    points, triangles = meshes.box()
    drawn = replace(meshed(points, triangles), sample_radius=6e-4)
    way = np.linspace(0.02, 0.0, 400)[:, None] * [0.0, 0.0, 1.0] + [1e-3, 2e-3, points[:, 2].max()]
    engine = ProxyEngine.of(drawn, rule)
    assert play(engine, way).proxy[-1] == pytest.approx(way[-1] + [0, 0, R], abs=2e-4)
    # Edits number the samples: corners first, and the others where `sampled` has them.
    made = sampled(drawn)
    assert made.sample_radius is None
    assert np.array_equal(drawn.forbidden, made.points)
    below = row_lengths(made.points - way[-1]) < 2 * R
    engine.edit(remove=np.flatnonzero(below))
    hold(engine, way[-1], 40)
    assert engine.step(way[-1]).proxy == pytest.approx(way[-1], abs=1e-9)


@pytest.mark.parametrize("triangles, said", [
    ([[0, 1]], r"\(K, 3\)"), ([[0, 1, 3]], "0 to 2"), ([[0, -1, 2]], "0 to 2"),
    ([[0.0, 1, 2]], r"\(K, 3\)"), (np.empty((0, 3), int), r"\(K, 3\)")])  # fmt: skip
def test_what_is_no_mesh_is_refused(triangles, said):
    with pytest.raises(SceneError, match=said):
        ProxyEngine.on(np.eye(3), triangles)
