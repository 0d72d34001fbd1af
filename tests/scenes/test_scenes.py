"""The scenes' truth against closed forms and against brute force; their clouds and paths."""

import numpy as np
import pytest
import shapely
from refusals import refuses
from scipy.spatial import cKDTree

from vfplan import scenes
from vfplan.errors import SceneError
from vfplan.geometry.lines import row_lengths, step_lengths
from vfplan.scenes import SCENES, god_object, outline
from vfplan.scenes.outline import unit_vectors

R, FLAT = 5e-3, np.array([1.0, 1.0, 0.0])
COARSE = {"sheet", "double-sheet", "sphere", "three-walls"}


def make(name, **settings):
    return SCENES[name](spacing=2e-3 if name in COARSE else 0.5e-3, **settings)


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def ball(c, r, hips):
    """Outside a ball the god-object is the HIP, inside it the nearest point of its surface."""
    away = hips - c
    out = np.linalg.norm(away, axis=1, keepdims=True) >= r
    return np.where(out, hips, c + r * unit(away))


def hollow(c, r, hips):
    away = hips - c
    return np.where(np.linalg.norm(away, axis=1, keepdims=True) <= r, hips, c + r * unit(away))


def capsule(half, hips):
    nearest = np.zeros_like(hips)
    nearest[:, 0] = np.clip(hips[:, 0], -half, half)
    return ball(nearest, R, hips)


def channel(scene, hips):
    """Centre line between the walls, fans around the ends outside."""
    x = hips.copy()
    inside = np.abs(hips[:, 0]) <= scene.length / 2
    room = scene.width / 2 - R
    x[inside, 1] = np.clip(hips[inside, 1], -room, room)
    end = np.stack([np.sign(hips[:, 0]) * scene.length / 2, np.sign(hips[:, 1]) * scene.width / 2])
    ends = np.column_stack([end.T, 0 * end[0]])
    fan = ball(ends, R, hips)
    # Near the mouth two fans meet on the axis at once; a HIP 3 mm off it leaves one of them.
    return np.where(inside[:, None], x, fan)


def wedge(hips):
    """Below the x leg, on the fan around the edge, beside the y leg: the way "over"."""
    fan = (hips[:, 0] < 0) & (hips[:, 1] < 0)
    rounded = np.arange(len(hips)) > np.flatnonzero(fan)[0]
    below = np.column_stack([hips[:, 0], np.minimum(hips[:, 1], -R), hips[:, 2]])
    beside = np.column_stack([np.minimum(hips[:, 0], -R), hips[:, 1], hips[:, 2]])
    x = np.where(rounded[:, None], beside, below)
    x[fan] = ball(np.zeros(3), R, hips[fan])
    return x


def above(level, sign):
    def closed(scene, hips):
        x = hips.copy()
        x[:, 1] = sign * np.maximum(sign * hips[:, 1], level(scene))
        return x

    return closed


def flat_z(closed):
    return lambda scene, hips: closed(scene, hips * [1, 1, 0]) + hips * [0, 0, 1]


def around(c, r, closed=ball):
    return lambda s, h: closed(np.zeros(3), r(s) + c, h)


FORMS = {
    "point": {"across": around(R, lambda s: 0)},
    "segment": {"above": lambda s, h: capsule(s.length / 2, h)},
    "sheet": {"front": above(lambda s: 0.1 + R, 1), "back": above(lambda s: R - 0.1, -1)},
    "double-sheet": {"above": above(lambda s: s.gap / 2 + R, 1),
                     "below": above(lambda s: s.gap / 2 + R, -1)},
    "circle": {"outside": flat_z(around(R, lambda s: s.radius)),
               "inside": flat_z(around(-R, lambda s: s.radius, hollow))},
    "sphere": {"outside": around(R, lambda s: s.radius),
               "inside": around(-R, lambda s: s.radius, hollow)},
    "corner": {"floor wall deep": flat_z(lambda s, h: np.maximum(h, [R, R, 0]))},
    "three-walls": {"diagonal edge": lambda s, h: np.maximum(h, R)},
    "channel": {"askew": flat_z(channel)},
    "wedge": {"over": flat_z(lambda s, h: wedge(h))},
}  # fmt: skip
CLOSED = {(name, route): form for name, forms in FORMS.items() for routes, form in forms.items()
          for route in routes.split()}  # fmt: skip


@pytest.mark.parametrize("name, route", CLOSED)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_truth_is_the_closed_form(name, route):
    scene = make(name)
    hips = scene.path(route, speed=0.25)
    found = scene.truth(hips, R)
    assert row_lengths(found - CLOSED[name, route](scene, hips)).max() < 1e-12
    assert np.mean(row_lengths(found - hips) > 1e-6) > 0.2  # in contact


@pytest.mark.parametrize("angle", [0.7, 2.0])
def test_corner_of_any_angle_is_the_projection_onto_its_cone(angle):
    """The free space is a convex cone: the nearest of its apex, two faces and itself."""
    scene = scenes.Corner(angle=angle, leg=0.08)
    apex = np.array([R / np.tan(angle / 2), R])
    v, hips = unit_vectors(angle), scene.path("floor", speed=0.3)
    for hip, proxy in zip(hips, scene.truth(hips, R), strict=True):
        normals, w = np.array([[0, 1], [v[1], -v[0]]]), hip[:2] - apex
        faces = [w - min(n @ w, 0) * n for n in normals]
        inside = [f for f in [w, *faces, np.zeros(2)] if (normals @ f).min() > -1e-12]
        best = min(inside, key=lambda f: np.linalg.norm(f - w))
        assert proxy[:2] == pytest.approx(apex + best, abs=1e-12)


@pytest.mark.parametrize("name, route",
    [(n, r) for n in ("omega", "teapot", "wedge", "channel") for r in make(n).routes])  # fmt: skip
def test_truth_is_free_and_nothing_near_it_is_better(name, route):
    """Slow reference: a dense cloud (1 µm) and random positions around the proxy."""
    scene = make(name)
    dense = cKDTree(outline.sample(scene.runs, 1e-6))
    hips = scene.path(route, speed=1.0)
    found, rng = scene.truth(hips, R), np.random.default_rng(7)
    assert dense.query(found[:, :2])[0].min() > R - 1e-9
    for i in range(0, len(hips), 7):
        pull = np.linalg.norm(found[i] - hips[i])
        if pull < 1e-7:
            continue
        tries = found[i, :2] + rng.normal(size=(400, 2)) * 10 ** rng.uniform(-7, -4, (400, 1))
        nearer = row_lengths(tries - hips[i, :2]) < pull - 1e-9
        assert not np.any(dense.query(tries[nearer])[0] > R + 1e-9), (i, hips[i], found[i])


@pytest.mark.parametrize("name", SCENES)
def test_every_route_starts_free_and_meets_the_scene(name):
    scene = make(name)
    for route in scene.routes:
        hips = scene.path(route, speed=1.0)
        assert scene.clearance(hips[:1])[0] > R
        proxy = scene.truth(hips, R)
        assert scene.clearance(proxy).min() > R - 1e-12
        force = scene.force(hips, proxy, [1000, 500, 250])
        pull = (proxy - hips) * [1, 1, 0 if isinstance(scene, scenes.Drawn) else 1]
        assert force == pytest.approx(pull * [1000, 500, 250], rel=1e-15)
        assert row_lengths(force).max() > 0.2


@pytest.mark.parametrize("name", sorted(set(SCENES) - {"point"}))
def test_points_lie_on_the_geometry_at_the_spacing(name):
    scene = make(name)
    points = scene.points
    assert scene.clearance(points[:: max(1, len(points) // 200)]).max() < 1e-12
    nearest = cKDTree(points).query(points, 2)[0][:, 1]
    assert np.median(nearest) == pytest.approx(scene.spacing, rel=0.12)
    assert nearest.max() < 1.5 * scene.spacing
    assert nearest.min() > 0.3 * scene.spacing


def test_channel_narrower_than_the_proxy_is_never_entered():
    scene = scenes.Channel(width=9.9e-3)
    assert scene.truth(scene.path("through", speed=0.2)[:200], R)[:, 0].max() < -scene.length / 2
    wide = scenes.Channel(width=10.005e-3)
    assert np.ptp(wide.truth(wide.path("through", speed=0.2), R)[:, 0]) > wide.length


def test_extruded_scenes_have_the_same_truth_in_space():
    hips = scenes.Corner().path("floor", speed=0.3) + np.array([0, 0, 1e-3])
    flat, tall = scenes.Corner(), scenes.Corner(extrude=0.02, spacing=1e-3)
    assert (flat.ignore_axis, tall.ignore_axis) == ("z", None)
    assert np.array_equal(flat.truth(hips), tall.truth(hips))
    assert np.ptp(tall.points[:, 2]) == pytest.approx(0.02)


def loop(rng):
    """A closed polyline (K, 3) with hollows, narrow places and hooks."""
    n = rng.integers(5, 30)
    turn = 2 * np.pi * (np.arange(n) + rng.uniform(-0.3, 0.3, n)) / n
    flat = rng.uniform(0.012, 0.05, n)[:, None] * unit_vectors(turn)
    return np.column_stack([flat, np.zeros(n)])


def distance(corners, x):
    """(T,) of the positions x (T, 2) from a closed polyline."""
    return shapely.distance(shapely.LinearRing(corners[:, :2]), shapely.points(x))


def inside(corners, x):
    """(T,) which positions x (T, 2) a closed polyline encloses."""
    return shapely.contains_xy(shapely.Polygon(corners[:, :2]), *x.T)


def follow_closed(corners, start, hips):
    """Follow HIPs (T, 3) along a closed polyline; check every position on the way."""
    flat = corners * FLAT
    walls = (outline.Sides(flat, (np.roll(flat, -1, axis=0) - flat,), endless=True),)
    x, side = start, inside(corners, start[None, :2])[0]
    for hip in hips:
        way = np.array([x, *god_object.slide(walls, x, hip, R)])
        room = distance(corners, way[:, :2])
        assert room.min() >= R * (1 - 1e-9)
        step = step_lengths(way)
        assert np.all(step < np.maximum(R / 7, room[:-1] - R + 1e-12)), "nothing is jumped over"
        assert np.all(inside(corners, way[:, :2]) == side)
        assert np.abs(way[:, 2]).max() < 1e-18, "a drawing has no third direction to leave by"
        x = way[-1]


@pytest.mark.parametrize("seed", range(10))
def test_no_path_leads_through_a_closed_polyline(seed):
    """HIPs up to 140 mm apart, a tick each; the proxy inside or outside to begin with."""
    rng = np.random.default_rng(seed)
    corners = loop(rng)
    places = np.column_stack([rng.uniform(-0.07, 0.07, (300, 2)), np.zeros(300)])
    free = places[distance(corners, places[:, :2]) > R]
    enclosed = inside(corners, free[:, :2])
    start = free[np.argmax(enclosed == (seed % 2 == 0))]
    follow_closed(corners, start, rng.permutation(places)[:25])


@pytest.mark.parametrize("name", ["circle", "wedge", "channel", "omega", "teapot"])
def test_clearance_of_a_drawing_is_that_of_its_pieces(name):
    scene, x = make(name), np.random.default_rng(3).uniform(-0.15, 0.15, (300, 3))
    x[:100] = scene.points[:100] + np.random.default_rng(4).normal(0, 1e-4, (100, 3))
    one_by_one = [god_object.look(scene.pieces, row * [1, 1, 0]).distance.min() for row in x]
    assert scene.clearance(x) == pytest.approx(one_by_one, abs=1e-14)


@pytest.mark.parametrize("kind", ["segments", "walls", "rectangles", "spheres", "arcs"])
def test_gradients_and_hessians_are_those_of_the_distance(kind):
    rng = np.random.default_rng(2)
    a, b, c = rng.normal(size=(3, 12, 3))
    c -= b * ((b * c).sum(axis=1) / (b * b).sum(axis=1))[:, None]
    angle, ends = rng.uniform(-3, 3, 12), np.vstack([b[:6], a[6:]])
    made = {
        "segments": outline.Sides(a, (ends - a,)), "rectangles": outline.Sides(a, (b, c)),
        "walls": outline.Sides(a * FLAT, ((ends - a) * FLAT,), endless=True),
        "spheres": outline.Spheres(a, rng.uniform(0.5, 3, 12)),
        "arcs": outline.Arcs(a[:, :2], rng.uniform(0.5, 3, 12), angle, rng.uniform(-0.7, 0.7, 12)),
    }[kind]  # fmt: skip
    for _ in range(30):
        x, e = rng.normal(size=3) * 2, 1e-5
        look = made.look(x)
        steps = [(made.look(x + d), made.look(x - d)) for d in np.eye(3) * e]
        slope = np.stack([(p.distance - m.distance) / (2 * e) for p, m in steps], axis=1)
        bend = np.stack([(p.normal - m.normal) / (2 * e) for p, m in steps], axis=2)
        assert slope == pytest.approx(look.normal, abs=1e-6)
        smooth = np.abs(bend - look.hessian).max(axis=(1, 2)) < 1e-5 * np.abs(look.hessian).max()
        assert smooth.mean() > 0.9  # the rest straddles an edge between two features


def test_biarcs_pass_through_their_nodes_with_one_tangent():
    rng = np.random.default_rng(4)
    nodes = np.cumsum(rng.uniform(0.5, 1.5, (8, 2)) * [1, 0.3], axis=0)
    run = outline.smooth(nodes)
    for before, after in zip(run.links, run.links[1:], strict=False):
        e = 1e-7
        assert before.b == pytest.approx(after.a, abs=1e-12)
        arriving = before.b - before.at(np.array([before.length - e]))[0]
        leaving = after.at(np.array([e]))[0] - after.a
        assert unit(arriving) @ unit(leaving) == pytest.approx(1.0, abs=1e-9)
    ends = np.array([link.a for link in run.links[::2]])
    assert ends == pytest.approx(nodes[:-1], abs=1e-12)


def test_a_start_inside_is_refused():
    with refuses(SceneError, "starts-inside"):
        god_object.follow(scenes.Point().pieces, np.array([1e-3, 0, 0]), np.zeros(3), R)
