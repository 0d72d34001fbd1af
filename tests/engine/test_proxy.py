"""The native engine on its own: sliding, starts inside, threads, and what it refuses."""

import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
from motion import SHEET, R, even, grid, led_out, play, same

import vfplan
from vfplan import Status, _core


def dust(n=2000, half=0.02, seed=1):
    return np.random.default_rng(seed).uniform(-half, half, (n, 3))


def press_and_slide(ticks=2000):
    t = np.arange(ticks) * 1e-3
    hip = np.column_stack([0.015 * np.sin(2 * t), 0.01 * np.cos(3 * t), 0.012 - 0.02 * t])
    hip[:, 2] = np.maximum(hip[:, 2], -0.006)
    return hip


@pytest.fixture
def use_width():
    """Sets the width of all engines, until the test ends or fails."""
    yield _core.use_width
    _core.use_width(8)


@pytest.mark.parametrize("rule", ["paper", "robust"])
@pytest.mark.parametrize("axis", [None, "z", (1, 2, 3)], ids=str)
def test_widths_and_searches_give_the_same_path(rule, axis, use_width):
    cloud, hips = dust(4000), press_and_slide(800)
    make = partial(vfplan.ProxyEngine, cloud, rule=rule, ignore_axis=axis)
    trace, microseconds = make().run_timed(hips)
    for width in (2, 4, 8):
        use_width(width)
        same(trace, vfplan.Trace(*_core.Engine(cloud, make().parameters).run(hips)[:5]))
    assert microseconds.shape == (800,)
    assert (microseconds > 0).all()


def test_a_normal_is_that_of_the_corner_at_hand():
    """Pressed into one corner, then only touching another: nothing of the first is left."""
    wall = np.arange(41) * 0.5e-3
    floor = grid(wall, wall)
    corner, away = np.vstack([floor, floor[:, [2, 0, 1]]]), np.array([0.2, 0, 0.5])
    engine = vfplan.ProxyEngine(np.vstack([corner, corner * [-1, 1, -1] + away]))
    first, second = np.array([R, 0.01, R]), away + np.array([-R, 0.01, -R])
    back = np.array([0.02, 0, 0.02])
    out = first + back
    deep = first - [2e-3, 0, 3e-3]
    engine.run(np.linspace(out, deep, 200))
    pressed = engine.step(deep)
    np.testing.assert_allclose(pressed.normal, np.array([2, 0, 3]) / 13**0.5, atol=1e-3)
    engine.run(np.linspace(out, second - back, 2000))
    trace = engine.run(np.linspace(second - back, second, 30))
    assert trace.state[-1] == 1
    np.testing.assert_allclose(trace.normal[-1], [-(0.5**0.5), 0, -(0.5**0.5)], atol=1e-3)


def test_a_unit_axis_is_taken_to_the_bit():
    """A controller renders the bundle's own numbers; scaling them again would move the last bit."""
    for axis in np.random.default_rng(3).normal(size=(200, 3)):
        unit = axis / np.linalg.norm(axis)
        engine = vfplan.ProxyEngine([[0.0, 0, 0]], ignore_axis=unit)
        assert np.array_equal(engine.parameters.ignore_axis, unit)
        unit[0] = 0.5  # the caller's own array stays the caller's
        assert engine.parameters.ignore_axis[0] != 0.5


def filled(dims, half, spacing):
    """A filled square or cube, as thick as it is wide [m]."""
    side = even(half, spacing)
    axes = [side, side, side if dims == 3 else np.zeros(1)]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("dims, half", [(2, 0.12), (2, 0.012), (3, 0.012)])
def test_a_start_deep_in_a_thick_fixture_is_taken_out(dims, half):
    """Up to 120 R thick: the spring grows no longer than the way out, and the status ends."""
    radius = 1e-3
    engine = vfplan.ProxyEngine(filled(dims, half, 1.3e-3), contact_radius=radius,
        ignore_axis="z" if dims == 2 else None)  # fmt: skip
    hip = np.array([1e-4, 2e-4, 0.0 if dims == 2 else 1e-4])
    trace = play(engine, np.tile(hip, (int(256 * (half / radius + 3)) + 100, 1)))
    spring = np.linalg.norm(trace.proxy - hip, axis=1)
    assert spring.max() <= half + 2 * radius
    assert trace.status[0] == Status.INSIDE
    assert trace.status[-1] == Status.OK
    assert engine.distance(trace.proxy[-1:])[0] >= radius - engine.parameters.band
    outside = engine.distance(trace.proxy) >= radius
    assert np.count_nonzero(outside & (trace.status == Status.INSIDE)) <= 256
    assert np.abs(np.diff(trace.proxy - hip, axis=0)).max() <= 2 * radius / 256


def cluttered(rng):
    """Clouds out of which the rule has to jump: dust, a heap, a cage, a curve, three walls."""
    a, b, zero = grid(np.arange(0, 0.03, 1e-3), np.arange(0, 0.03, 1e-3)).T
    cage = np.arange(-0.015, 0.0151, rng.choice([2e-3, 4e-3]))
    bends = np.cumsum(np.cumsum(rng.normal(size=(12, 3)), axis=0), axis=0) * 2e-3
    t = np.linspace(0, 11, int(rng.integers(20, 400)))
    yield dust(int(10 ** rng.uniform(1, 3.5)), 0.03, int(rng.integers(1 << 31)))
    yield rng.normal(size=(3000, 3)) * rng.uniform(2e-3, 8e-3)
    yield np.stack(np.meshgrid(cage, cage, cage), -1).reshape(-1, 3) + rng.normal(size=3) * 1e-4
    yield np.stack([np.interp(t, np.arange(12), x) for x in bends.T], axis=1)
    yield np.vstack([np.c_[a, b, zero], np.c_[a, zero, b], np.c_[zero, a, b]])


def hands(rng, start):
    """A hand that holds still, goes straight, wanders, trembles; at rest in the end."""
    speed = 10 ** rng.uniform(-6, -3)
    walk = np.cumsum(rng.normal(size=(1000, 3)), axis=0)
    way = rng.normal(size=3)
    yield np.tile(start, (1000, 1))
    yield start + np.outer(np.arange(1000), speed * way / np.linalg.norm(way))
    yield start + np.cumsum(speed * walk / np.linalg.norm(walk, axis=1, keepdims=True), axis=0)
    yield start + speed * rng.normal(size=(1000, 3))


@pytest.mark.parametrize("seed", range(12))
def test_a_hand_that_leaves_clutter_feels_no_jump(seed):
    """From inside to where the rule has taken over, to rounding, and it does take over."""
    rng, ticks = np.random.default_rng(seed), 0
    for points in cluttered(rng):
        band = {"band": 10 ** rng.uniform(-5.5, -3.3)} if rng.random() < 0.3 else {}
        engine = vfplan.ProxyEngine(points, stiffness=1000, **band)
        start = points[rng.integers(len(points))] + rng.normal(size=3) * 1e-3
        for hips in hands(rng, start):
            hips = np.vstack([hips, np.tile(hips[-1], (3000, 1))])
            trace = play(engine, hips, start)
            if trace.status[0] & Status.INSIDE:
                ticks += led_out(trace, hips) + 1
                out = np.flatnonzero(trace.state != 2)[0]
                kept = engine.distance(trace.proxy[out:]).min()
                assert kept >= R - engine.parameters.band - 1e-11
    assert ticks > 1000


def test_the_rule_takes_over_below_a_hand_that_never_rests():
    """Where the HIP trembles so that the rule uses up its iterations in each tick, the status still
    ends, and the force has not stepped until then."""
    rng, longest = np.random.default_rng(2), 0
    for seed in range(12):
        cloud = dust(300, half=0.015, seed=seed)
        engine = vfplan.ProxyEngine(cloud, band=1e-6, max_iterations=rng.choice([1, 3, 16]))
        start = cloud[rng.integers(len(cloud))] + rng.normal(0, 2e-3, 3)
        hips = start + 10 ** rng.uniform(-5.5, -4) * rng.uniform(-1, 1, (6000, 3))
        trace = play(engine, hips, start)
        if trace.status[0] & Status.INSIDE:
            longest = max(longest, led_out(trace, hips))
    assert longest > 100


def test_one_engine_or_governor_serves_one_thread():
    """What would race with the ticks of another thread is refused."""
    rows, engine = np.tile([0.03, 0.03, 0.03], (3_000_000, 1)), vfplan.ProxyEngine(dust())
    governor = vfplan.Governor(force_step_n=1, force_max_n=20, stiffness_n_per_m=1000, mass_kg=1)
    for one, act in (
        (engine, lambda: engine.step(rows[0])),
        (governor, governor.reset),
        (governor, lambda: governor.energy_given_j),
        (governor, lambda: governor.energy_stored_j),
    ):
        run = threading.Thread(target=one.run, args=(rows,))
        run.start()
        refused = ""
        while run.is_alive() and not refused:
            try:
                act()
            except RuntimeError as error:
                refused = str(error)
        run.join()
        assert f"one {'engine' if one is engine else 'governor'} serves one thread" in refused
        act()


def test_two_threads_run_at_once():
    cloud, hips = dust(), press_and_slide(500)
    alone = vfplan.ProxyEngine(cloud).run(hips)
    with ThreadPoolExecutor(2) as pool:
        for trace in pool.map(lambda _: vfplan.ProxyEngine(cloud).run(hips), range(2)):
            same(trace, alone)


def test_left_out_says_what_the_scene_does_not_need():
    left_out = {"coordinates": 7, "point_radius": 1, "stiffness_axes": 2, "grid": 1}
    assert vfplan.ProxyEngine(dust(7), ignore_axis="z").left_out == left_out
    assert vfplan.ProxyEngine(SHEET, point_radius=1e-3, stiffness=(1, 2, 3)).left_out == {}
