"""The native engine: the reference's equal on the paper's rule; safe and exact on its own."""

import threading

import numpy as np
import pytest

import vfplan
from vfplan import Status, _core
from vfplan.errors import SceneError, SettingError

R = 5e-3


def sheet(side=0.04, spacing=5e-4):
    g = np.arange(-side / 2, side / 2 + spacing / 2, spacing)
    x, y = np.meshgrid(g, g)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def dust(n=2000, half=0.02, seed=1):
    return np.random.default_rng(seed).uniform(-half, half, (n, 3))


CLOUDS = {
    "sheet": sheet(),
    "dust": dust(),
    "few": dust(7),
    "one": np.zeros((1, 3)),
    "duplicates": np.repeat(dust(300), 3, axis=0),
    "far away": sheet() + np.array([900.0, -400.0, 5.0]),
}


@pytest.mark.parametrize("name", CLOUDS)
@pytest.mark.parametrize(
    "settings",
    [{}, {"ignore_axis": "z"}, {"ignore_axis": (1, 2, 3)}, {"point_radius": 2e-3}, {"gain": 0.5}],
    ids=str,
)
def test_paper_is_the_reference_from_any_common_state(name, settings):
    cloud = CLOUDS[name]
    centre = cloud.mean(axis=0)
    rng = np.random.default_rng(7)
    engine = vfplan.ProxyEngine(cloud, rule="paper", stiffness=(900, 1000, 1100), **settings)
    reference = vfplan.reference.PaperProxy(cloud, stiffness=(900, 1000, 1100), **settings)
    for _ in range(60):
        start = centre + rng.uniform(-0.02, 0.02, 3)
        if rng.random() < 0.5:  # touching a point
            away = rng.normal(size=3)
            start = cloud[rng.integers(len(cloud))] + away / np.linalg.norm(away) * R
        hip = start + rng.normal(0, 0.004, 3)
        engine.reset(start)
        reference.reset(start)
        ours, theirs = engine.step(hip), reference.step(hip)
        assert ours.state == theirs.state
        np.testing.assert_allclose(ours.proxy, theirs.proxy, rtol=0, atol=1e-9)
        # far from the origin the coordinates themselves are rounded to 1e-13 m
        atol = 1e-9 + 1e-10 * np.abs(centre).max()
        np.testing.assert_allclose(ours.normal, theirs.normal, rtol=0, atol=atol)
        np.testing.assert_allclose(ours.force, theirs.force, rtol=0, atol=2e-6)


def press_and_slide(ticks=2000):
    t = np.arange(ticks) * 1e-3
    hip = np.column_stack([0.015 * np.sin(2 * t), 0.01 * np.cos(3 * t), 0.012 - 0.02 * t])
    hip[:, 2] = np.maximum(hip[:, 2], -0.006)
    return hip


def test_slides_on_a_sheet_without_lag_and_without_sinking():
    engine = vfplan.ProxyEngine(sheet())
    hips = press_and_slide()
    trace = engine.run(hips)
    touching = trace.state == 1
    assert touching.mean() > 0.5
    assert np.abs(trace.proxy - hips)[touching][:, :2].max() < 1e-7
    assert np.abs(trace.proxy[touching, 2] - R).max() < 1e-6
    assert engine.distance(trace.proxy).min() >= R - engine.parameters.band


def test_lets_go_perpendicularly():
    z = np.r_[np.linspace(0.01, -0.005, 100), np.linspace(-0.005, 0.03, 100)]
    hips = np.column_stack([0 * z, 0 * z, z])
    trace = vfplan.ProxyEngine(sheet()).run(hips)
    assert np.abs(trace.force).max() > 5
    assert np.array_equal(trace.proxy[z > R + 1e-5], hips[z > R + 1e-5])
    assert np.array_equal(trace.force[-1], np.zeros(3))


@pytest.mark.parametrize("rule", ["paper", "robust"])
@pytest.mark.parametrize("axis", [None, "z", (1, 2, 3)], ids=str)
def test_widths_and_searches_give_the_same_path(rule, axis):
    cloud, hips = dust(4000), press_and_slide(800)
    traces = [
        vfplan.ProxyEngine(cloud, rule=rule, ignore_axis=axis, simd_width=w).run(hips)
        for w in (2, 4, 8)
    ]
    for trace in traces[1:]:
        assert trace.proxy.tobytes() == traces[0].proxy.tobytes()
        assert trace.force.tobytes() == traces[0].force.tobytes()


def test_run_is_step_by_step_and_repeats_to_the_bit():
    cloud, hips = dust(), press_and_slide(300)
    one, other = vfplan.ProxyEngine(cloud), vfplan.ProxyEngine(cloud)
    steps = [one.step(h) for h in hips]
    trace, microseconds = other.run_timed(hips)
    assert np.array([s.proxy for s in steps]).tobytes() == trace.proxy.tobytes()
    assert np.array([s.force for s in steps]).tobytes() == trace.force.tobytes()
    assert [s.state for s in steps] == trace.state.tolist()
    assert microseconds.shape == (300,)
    assert (microseconds > 0).all()


@pytest.mark.parametrize("rule", ["paper", "robust"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e7])
def test_a_bad_hip_is_a_status(rule, bad):
    engine = vfplan.ProxyEngine(sheet(), rule=rule)
    first = engine.step([0, 0, bad])
    assert first.status == Status.BAD_HIP
    for nothing_yet in (first.proxy, first.normal, first.force):
        assert nothing_yet.tolist() == [0, 0, 0]
    assert first.state == -1
    assert engine.step([0, 0, 0.03]).proxy.tolist() == [0, 0, 0.03]  # the first good one begins
    engine.reset([0, 0, 0.01])
    engine.step([0, 0, 0.001])
    before = engine.step([0, 0, 0.001])
    step = engine.step([bad, 0, 0])
    assert step.status == Status.BAD_HIP
    assert np.array_equal(step.proxy, before.proxy)
    assert np.array_equal(step.force, before.force)
    assert engine.step([0, 0, 0.001]).status == Status.OK


def test_nothing_survives_a_reset():
    """A used engine after reset answers as a fresh one, to the bit; the HIP stays where it was."""
    rng = np.random.default_rng(7)
    for _ in range(60):
        cloud = [sheet(), dust(), rng.uniform(-0.01, 0.01, (rng.integers(1, 70), 3))][
            rng.integers(3)
        ]
        settings = {"point_radius": rng.choice([0, 1e-3]), "rule": rng.choice(["paper", "robust"])}
        hips = np.cumsum(rng.normal(0, 2e-4, (150, 3)), axis=0) + rng.uniform(-0.01, 0.01, 3)
        hold, far = np.repeat(hips[-1:], 60, axis=0), [0.3, 0.4, 0.5]
        used, fresh = (vfplan.ProxyEngine(cloud, **settings) for _ in range(2))
        used.run(np.vstack([hips, hold]))
        for engine in (used, fresh):
            engine.reset(far)
        a, b = used.run(hold), fresh.run(hold)
        for name in ("proxy", "normal", "force", "state", "status"):
            assert np.array_equal(getattr(a, name), getattr(b, name)), name


def test_a_normal_is_that_of_the_corner_at_hand():
    """Pressed into one corner, then only touching another: nothing of the first is left."""
    grid = np.arange(41) * 0.5e-3
    x, y = (v.ravel() for v in np.meshgrid(grid, grid))
    corner = np.vstack([np.column_stack([x, y, 0 * x]), np.column_stack([0 * x, x, y])])
    away = np.array([0.2, 0, 0.5])
    engine = vfplan.ProxyEngine(np.vstack([corner, corner * [-1, 1, -1] + away]))
    first, second = np.array([R, 0.01, R]), away + np.array([-R, 0.01, -R])
    back = np.array([0.02, 0, 0.02])
    out = first + back
    engine.run(np.linspace(out, first - [2e-3, 0, 3e-3], 200))
    pressed = engine.step(first - [2e-3, 0, 3e-3])
    np.testing.assert_allclose(pressed.normal, np.array([2, 0, 3]) / 13**0.5, atol=1e-3)
    engine.run(np.linspace(out, second - back, 2000))
    trace = engine.run(np.linspace(second - back, second, 30))
    assert trace.state[-1] == 1
    np.testing.assert_allclose(trace.normal[-1], [-(0.5**0.5), 0, -(0.5**0.5)], atol=1e-3)


@pytest.mark.parametrize("depth", [0.0, 1e-3, 4.9e-3])
def test_a_start_inside_is_reported_and_ramps_out(depth):
    engine = vfplan.ProxyEngine(sheet())
    hip = np.array([1e-4, 2e-4, R - depth if depth else 0.0])
    engine.reset(hip)
    trace = engine.run(np.tile(hip, (600, 1)))
    assert trace.status[0] == Status.INSIDE
    assert trace.state[0] == 2
    assert trace.status[-1] == Status.OK
    force = np.r_[np.zeros((1, 3)), trace.force]
    assert np.linalg.norm(np.diff(force, axis=0), axis=1).max() < 0.1
    assert abs(abs(trace.proxy[-1, 2]) - R) < 2e-5
    assert np.abs(np.diff(trace.proxy[-100:], axis=0)).max() == 0


def test_a_unit_axis_is_taken_to_the_bit():
    """A controller renders the bundle's own numbers; scaling them again would move the last bit."""
    for axis in np.random.default_rng(3).normal(size=(200, 3)):
        unit = axis / np.linalg.norm(axis)
        engine = vfplan.ProxyEngine([[0.0, 0, 0]], ignore_axis=unit)
        assert np.array_equal(engine.parameters.ignore_axis, unit)
        unit[0] = 0.5  # the caller's own array stays the caller's
        assert engine.parameters.ignore_axis[0] != 0.5
        longer = vfplan.ProxyEngine([[0.0, 0, 0]], ignore_axis=3 * axis).parameters.ignore_axis
        assert np.linalg.norm(longer) == pytest.approx(1, abs=1e-15)


def test_stiffness_and_ignored_axis():
    cloud = sheet()
    hip = np.array([0.001, 0.002, 0.001])
    forces = {}
    for axis in (None, "x", (1, 1, 0)):
        engine = vfplan.ProxyEngine(cloud, stiffness=(500, 1000, 2000), ignore_axis=axis)
        engine.reset([0.001, 0.002, 0.02])
        step = engine.step(hip)
        forces[axis] = step.force
        along = {None: [0, 0, 0], "x": [1, 0, 0], (1, 1, 0): [1, 1, 0]}[axis]
        assert abs(step.force @ along) < 1e-12
        assert abs((step.proxy - hip) @ along) < 1e-15
    np.testing.assert_allclose(forces[None], [0, 0, 8], atol=1e-3)
    np.testing.assert_allclose(forces["x"], [0, 0, 8], atol=1e-3)


def filled(dims, half, spacing):
    """A filled square or cube, as thick as it is wide [m]."""
    g = np.arange(-half, half + spacing / 2, spacing)
    axes = [g, g, g if dims == 3 else np.zeros(1)]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)


@pytest.mark.parametrize(("dims", "half"), [(2, 0.12), (2, 0.012), (3, 0.012)])
def test_a_start_deep_in_a_thick_fixture_is_taken_out(dims, half):
    """Up to 120 R thick: the spring grows no longer than the way out, and the status ends."""
    radius = 1e-3
    engine = vfplan.ProxyEngine(
        filled(dims, half, 1.3e-3), contact_radius=radius, ignore_axis="z" if dims == 2 else None
    )
    hip = np.array([1e-4, 2e-4, 0.0 if dims == 2 else 1e-4])
    ticks = int(256 * (half / radius + 3)) + 100
    engine.reset(hip)
    trace = engine.run(np.tile(hip, (ticks, 1)))
    spring = np.linalg.norm(trace.proxy - hip, axis=1)
    assert spring.max() <= half + 2 * radius
    assert trace.status[0] == Status.INSIDE
    assert trace.status[-1] == Status.OK
    assert engine.distance(trace.proxy[-1:])[0] >= radius - engine.parameters.band
    outside = engine.distance(trace.proxy) >= radius
    assert np.count_nonzero(outside & (trace.status == Status.INSIDE)) <= 256
    assert np.abs(np.diff(trace.proxy - hip, axis=0)).max() <= 2 * radius / 256


@pytest.mark.parametrize("speed", [2e-5, 1e-4, 1e-3])  # [m] a tick
@pytest.mark.parametrize("way", [(0, 0, -1), (0, 0, 1), (1, 0, 0), (0.7, 0.1, -0.7)])
def test_a_hand_that_leaves_by_any_side_feels_no_jump(way, speed):
    """The HIP starts in a sheet and goes through it, back out, along it or aslant."""
    engine = vfplan.ProxyEngine(sheet(), stiffness=1000)
    start = np.array([0, 0, 5e-4])
    count = int(0.04 / speed)
    hips = start + np.outer(np.arange(count) * speed, way)
    hips = np.vstack([hips, np.tile(hips[-1], (600, 1))])
    engine.reset(start)
    trace = engine.run(hips)
    told = trace.status & Status.INSIDE > 0
    assert told[0]
    assert not told[-1]
    force = np.vstack([np.zeros(3), trace.force])
    steps = np.linalg.norm(np.diff(force, axis=0), axis=1)
    most = 1000 * (R / 256 + np.linalg.norm(np.diff(hips, axis=0, prepend=start[None]), axis=1))
    until = np.flatnonzero(told)[-1] + 2  # the tick that ends it too
    assert (steps - most)[:until].max() < 0.01
    assert engine.distance(trace.proxy[until - 1 :]).min() >= R - engine.parameters.band


def cluttered(rng):
    """Clouds out of which the rule has to jump: dust, a heap, a cage, a curve, three walls."""
    g = np.arange(0, 0.03, 1e-3)
    a, b = (x.ravel() for x in np.meshgrid(g, g))
    cage = np.arange(-0.015, 0.0151, rng.choice([2e-3, 4e-3]))
    bends = np.cumsum(np.cumsum(rng.normal(size=(12, 3)), axis=0), axis=0) * 2e-3
    t = np.linspace(0, 11, int(rng.integers(20, 400)))
    yield dust(int(10 ** rng.uniform(1, 3.5)), 0.03, int(rng.integers(1 << 31)))
    yield rng.normal(size=(3000, 3)) * rng.uniform(2e-3, 8e-3)
    yield np.stack(np.meshgrid(cage, cage, cage), -1).reshape(-1, 3) + rng.normal(size=3) * 1e-4
    yield np.stack([np.interp(t, np.arange(12), x) for x in bends.T], axis=1)
    yield np.vstack([np.c_[a, b, 0 * a], np.c_[a, 0 * a, b], np.c_[0 * a, a, b]])


def hands(rng, start, count=1000):
    """A hand that holds still, goes straight, wanders, trembles; at rest in the end."""
    speed = 10 ** rng.uniform(-6, -3)
    walk = np.cumsum(rng.normal(size=(count, 3)), axis=0)
    way = rng.normal(size=3)
    yield np.tile(start, (count, 1))
    yield start + np.outer(np.arange(count), speed * way / np.linalg.norm(way))
    yield start + np.cumsum(speed * walk / np.linalg.norm(walk, axis=1, keepdims=True), axis=0)
    yield start + speed * rng.normal(size=(count, 3))


@pytest.mark.parametrize("seed", range(12))
def test_a_hand_that_leaves_clutter_feels_no_jump(seed):
    """From inside to where the rule has taken over, to rounding, and it does take over."""
    rng = np.random.default_rng(seed)
    ticks, most = 0, -np.inf
    for points in cluttered(rng):
        band = {"band": 10 ** rng.uniform(-5.5, -3.3)} if rng.random() < 0.3 else {}
        engine = vfplan.ProxyEngine(points, stiffness=1000, **band)
        start = points[rng.integers(len(points))] + rng.normal(size=3) * 1e-3
        for hips in hands(rng, start):
            hips = np.vstack([hips, np.tile(hips[-1], (3000, 1))])
            engine.reset(start)
            trace = engine.run(hips)
            told = trace.status & Status.INSIDE > 0
            if not told[0]:
                continue
            end = np.flatnonzero(told)[-1] + 1
            assert end < len(hips)
            assert not (~told[:end]).any()
            out = np.flatnonzero(trace.state != 2)[0]
            assert engine.distance(trace.proxy[out:]).min() >= R - engine.parameters.band - 1e-11
            steps = np.linalg.norm(np.diff(trace.force, axis=0, prepend=np.zeros((1, 3))), axis=1)
            moved = np.linalg.norm(np.diff(hips, axis=0, prepend=start[None]), axis=1)
            ticks += end + 1
            most = max(most, (steps - 1000 * (R / 256 + moved))[: end + 1].max())
    print(f"of {ticks} ticks, most beyond K (R/256 + |dh|): {most:.1e} N")
    assert ticks > 1000
    assert most < 1e-9


def test_the_rule_takes_over_below_a_hand_that_never_rests():
    """Where the HIP trembles so that the rule uses up its iterations in each tick, the status still
    ends, and the force has not stepped until then."""
    rng = np.random.default_rng(2)
    longest = 0
    for seed in range(12):
        cloud = dust(300, half=0.015, seed=seed)
        engine = vfplan.ProxyEngine(cloud, band=1e-6, max_iterations=rng.choice([1, 3, 16]))
        start = cloud[rng.integers(len(cloud))] + rng.normal(0, 2e-3, 3)
        hips = start + 10 ** rng.uniform(-5.5, -4) * rng.uniform(-1, 1, (6000, 3))
        engine.reset(start)
        trace = engine.run(hips)
        told = trace.status & Status.INSIDE > 0
        if not told[0]:
            continue
        longest = max(longest, end := np.flatnonzero(told)[-1] + 1)
        assert end < len(hips)
        steps = np.linalg.norm(np.diff(trace.force, axis=0, prepend=np.zeros((1, 3))), axis=1)
        moved = np.linalg.norm(np.diff(hips, axis=0, prepend=start[None]), axis=1)
        assert (steps - 1000 * (R / 256 + moved))[: end + 1].max() < 1e-9
    assert longest > 100


def test_one_engine_serves_one_thread():
    engine = vfplan.ProxyEngine(dust())
    hips = np.tile([0.03, 0.03, 0.03], (3_000_000, 1))
    run = threading.Thread(target=engine.run, args=(hips,))
    run.start()
    refused = ""
    while run.is_alive() and not refused:
        try:
            engine.step(hips[0])
        except RuntimeError as error:
            refused = str(error)
    run.join()
    assert "one engine serves one thread" in refused
    engine.step(hips[0])


def test_two_threads_run_at_once():
    cloud, hips = dust(), press_and_slide(500)
    alone = vfplan.ProxyEngine(cloud).run(hips).proxy
    out = {}
    threads = [
        threading.Thread(target=lambda i=i: out.update({i: vfplan.ProxyEngine(cloud).run(hips)}))
        for i in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(out[i].proxy, alone) for i in range(2))


def test_left_out_says_what_the_scene_does_not_need():
    assert vfplan.ProxyEngine(CLOUDS["few"], ignore_axis="z").left_out == {
        "coordinates": 7,
        "point_radius": 1,
        "stiffness_axes": 2,
        "grid": 1,
    }
    engine = vfplan.ProxyEngine(sheet(), point_radius=1e-3, stiffness=(1, 2, 3))
    assert engine.left_out == {}


@pytest.mark.parametrize(
    ("settings", "error"),
    [
        ({"search": "tree"}, SettingError),
        ({"max_iterations": 0}, SettingError),
        ({"max_iterations": 2.5}, SettingError),
        ({"simd_width": 3}, SettingError),
        ({"simd_width": [4]}, SettingError),
        ({"contact_radius": -1.0}, SettingError),
        ({"band": 0.01}, SettingError),
        ({"stiffness": 0.0}, SettingError),
    ],
    ids=str,
)
def test_settings_out_of_range(settings, error):
    with pytest.raises(error):
        vfplan.ProxyEngine(sheet(), **settings)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("contact_radius", 0.99e-9),
        ("contact_radius", 1.01e6),
        ("point_radius", 1.01e6),
        ("band", 4.9e-11),
        ("band", 5e-324),
        ("outer_radius", 2.01e6),
        ("outer_radius", np.nan),
    ],
)
def test_the_native_engine_refuses_what_python_does(name, value):
    """A C++ user has no Python in front."""
    native = _core.Parameters(**{name: value})
    with pytest.raises(ValueError, match=name):
        _core.Engine(sheet(), native, 0)
    with pytest.raises(SettingError, match=name):
        vfplan.ProxyEngine(sheet(), **({"band": 1e-5} | {name: value}))


@pytest.mark.parametrize(
    "points", [np.zeros((0, 3)), np.zeros((3, 2)), [[0, 0, np.nan]], [["a", "b", "c"]], 1.0]
)
def test_points_that_are_no_cloud(points):
    with pytest.raises(SceneError):
        vfplan.ProxyEngine(points)


def test_paths_that_are_none():
    engine = vfplan.ProxyEngine(sheet())
    for hips in (np.zeros(3), np.zeros((4, 2))):
        with pytest.raises(SceneError):
            engine.run(hips)
    assert len(engine.run(np.zeros((0, 3)))) == 0
