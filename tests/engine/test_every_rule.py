"""What every rule keeps, over (rule, scene, path): bits, bad positions, resets, starts inside."""

import curves
import meshes
import numpy as np
import pytest
from failures import floor, inside
from motion import SHEET, R, led_out, play, same, sizes

from vfplan import ProxyEngine, Status, scenes
from vfplan.errors import SceneError
from vfplan.reference import PaperProxy

BOX = meshes.box()
LINE = curves.pieces([(np.array([[-0.04, 0], [0.04, 0]]), np.zeros(2), False)])


def dust(rng):
    return rng.uniform(-0.02, 0.02, (2000, 3))


# The sheet's top is z = 0, the box's is 12.5 mm above the middle, and the line is seen from y.
ENGINES = {
    "robust": lambda: ProxyEngine(SHEET),
    "robust in a plane": lambda: ProxyEngine(SHEET[:81, [0, 2, 1]], ignore_axis="y"),
    "paper": lambda: ProxyEngine(SHEET, rule="paper"),
    "exact on lines": lambda: ProxyEngine.along(LINE),
    "exact on triangles": lambda: ProxyEngine.on(*BOX),
    "reference": lambda: PaperProxy(SHEET),
}
every_rule = pytest.mark.parametrize("make", ENGINES.values(), ids=ENGINES)


@every_rule
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e7, 1e200, 1e300])
def test_a_bad_hip_is_a_status_and_leaves_the_proxy_where_it_was(make, bad):
    engine = make()
    first = engine.step([0, bad, 0])
    assert (first.status, first.state) == (Status.BAD_HIP, -1)
    assert np.concatenate([first.proxy, first.normal, first.force]).tolist() == [0] * 9
    for begun in (engine, make()):  # the first good one begins
        step = begun.step([0, 0.03, 0.03])
        assert (step.proxy.tolist(), step.force.tolist()) == ([0, 0.03, 0.03], [0, 0, 0])
    engine.reset([1e-3, 8e-3, 0.02])
    deep = [1e-3, 1e-3, 1e-3]
    engine.step(deep)
    good = engine.step(deep)
    for hip in np.where(np.eye(3) > 0, bad, 0):
        step = engine.step(hip)
        assert step.status == Status.BAD_HIP
        assert np.array_equal(step.proxy, good.proxy)
        assert np.array_equal(step.force, good.force)
    after = engine.step(deep)
    assert after.status == Status.OK
    assert np.linalg.norm(after.proxy - good.proxy) < 1e-6


def wandering(rng, count, start=(0, 0, 4e-3), step=4e-4):
    return np.array(start) + np.cumsum(rng.normal(0, step, (count, 3)), axis=0)


@every_rule
def test_a_run_is_step_by_step_and_repeats_to_the_bit(make):
    hips = wandering(np.random.default_rng(5), 300)
    one, two, three = make(), make(), make()
    trace, halves = one.run(hips), [two.run(hips[:100]), two.run(hips[100:])]
    same(trace, [three.step(hip) for hip in hips])
    for name, rows in vars(trace).items():
        assert np.array_equal(rows, np.concatenate([getattr(half, name) for half in halves]))
    assert len(two.run(np.empty((0, 3)))) == 0


@every_rule
def test_positions_that_are_none_are_refused(make):
    engine = make()
    for hips in (np.zeros(3), np.zeros((4, 2)), [["x", "y", "z"]]):
        with pytest.raises(SceneError):
            engine.run(hips)
    for hip in ([np.nan, 0, 0], [0, 1e7, 0], [0, 0]):
        with pytest.raises(SceneError):
            engine.reset(hip)


def used_clouds(rng):
    """A cloud, settings, and a path to run before the reset."""
    clouds = [SHEET, dust(rng), rng.uniform(-0.01, 0.01, (rng.integers(1, 70), 3))]
    settings = {"point_radius": rng.choice([0, 1e-3]), "rule": rng.choice(["paper", "robust"])}
    hips = wandering(rng, 150, rng.uniform(-0.01, 0.01, 3), 2e-4)
    hips = np.vstack([hips, np.repeat(hips[-1:], 60, axis=0)])
    cloud = clouds[rng.integers(3)]
    return lambda: ProxyEngine(cloud, **settings), hips, [0.3, 0.4, 0.5], hips[-60:]


def used_closely(rng):
    """A sheet that was looked at right beside the start: a replay begins at the reset."""
    points, rule = floor(0.8e-3, 0.015), rng.choice(["paper", "robust"])
    start = points[rng.integers(len(points))] + rng.normal(size=3) * 4e-3
    before = start + np.array([[3e-4, 0, 0], [3e-4, 1e-4, 0]])
    return lambda: ProxyEngine(points, rule=rule), before, start, wandering(rng, 100, start, 3e-4)


def used_curves(rng):
    curve, hips = curves.curve(rng), rng.normal(size=(500, 3)) * [2 * R, 2 * R, 0]
    return lambda: ProxyEngine.along(curve, R), hips[::-1], hips[0] + [1, 0, 0], hips


@pytest.mark.parametrize("used_before, cases",
    [(used_clouds, 60), (used_closely, 80), (used_curves, 3)])  # fmt: skip
def test_nothing_survives_a_reset_to_the_bit(used_before, cases):
    """A used engine after reset answers as a fresh one, wherever its HIP was and stays."""
    rng = np.random.default_rng(7)
    for _ in range(cases):
        make, before, start, hips = used_before(rng)
        used, fresh = make(), make()
        play(used, before)
        same(play(used, hips, start), play(fresh, hips, start))


def starts():
    """Clouds, and where in them a hand rests."""
    sheet = floor(0.5e-3, 0.015)
    yield "just below the surface", sheet, [0, 4.9e-3, 0]
    yield "1 mm below the surface", sheet, [1e-4, 4e-3, 2e-4]
    yield "deep", sheet, [0.1e-3, 1e-3, 0.2e-3]
    yield "hardly above its middle", sheet, [1e-4, 1e-4, 2e-4]
    yield "in the surface", sheet, [1e-4, 0, 2e-4]
    yield "on a point", sheet, [0, 0, 0]
    yield "in a corner", scenes.Corner(extrude=0.02).points, [2e-3, 1e-3, 0]
    yield "between two sheets", scenes.DoubleSheet(side=0.03).points, [0, 0, 0]
    yield "in a filled ball", np.random.default_rng(1).normal(size=(3000, 3)) * 4e-3, [0, 0, 0]


@pytest.mark.parametrize("name, points, start", [*starts()], ids=[s[0] for s in starts()])
def test_a_start_inside_is_told_and_left_without_a_force_jump(name, points, start):
    """A resting hand: out in a second at most, the status says so, and then all is still."""
    engine = ProxyEngine(points)
    hips = np.tile(start, (1000, 1))
    trace = play(engine, hips)
    assert (trace.status[0], trace.state[0]) == (Status.INSIDE, 2)
    out = led_out(trace, hips)
    assert np.all(inside(points, trace.proxy[out:]) <= engine.parameters.band + 1e-11)
    largest = sizes(trace.force, np.zeros(3)).max()
    assert largest <= 2.0
    if "sheet" not in name and "ball" not in name and "corner" not in name:
        assert largest < 0.1
        assert abs(abs(trace.proxy[-1, 1]) - R) < 2e-5
        assert np.abs(np.diff(trace.proxy[-100:], axis=0)).max() == 0
        assert trace.status[-1] == Status.OK


@pytest.mark.parametrize("seed", range(20))
def test_a_start_inside_lines_and_arcs_is_led_out_without_a_jump(seed):
    rng = np.random.default_rng(seed)
    curve = curves.curve(rng)
    start = curve.vertices[rng.integers(len(curve.vertices))] * [1, 1, 0]
    path = start + np.cumsum(rng.normal(size=(1500, 3)) * [2e-5, 2e-5, 0], axis=0)
    assert led_out(play(ProxyEngine.along(curve, R), path), path) < 1400


@pytest.mark.parametrize("seed", range(24))
def test_a_start_inside_a_mesh_is_led_out_without_a_jump(seed):
    """Any mesh, and a body with a cavity: a hand that rests, wanders, trembles."""
    rng = np.random.default_rng(seed)
    began_inside = 0
    for points, triangles in (meshes.mesh(rng)[:2], meshes.hollow(rng)):
        engine = ProxyEngine.on(points, triangles, R)
        corner = points[triangles[rng.integers(len(triangles)), 0]]
        start = corner * rng.uniform(0.8, 1.05) + 0.2 * R * rng.normal(size=3)
        noise = 10 ** rng.uniform(-6, -3.5) * rng.normal(size=(1500, 3))
        moves = (0 * noise, 1000), (np.cumsum(noise, axis=0), 1700), (noise, 1700)
        for moved, most in moves:
            path = start + np.vstack([moved, np.tile(moved[-1], (3000, 1))])
            trace = play(engine, path)
            if trace.status[0] & Status.INSIDE:
                began_inside += 1
                assert led_out(trace, path) < most
    assert began_inside >= 3, "half of all at least"
