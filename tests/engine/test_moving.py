"""A fixture that moves: its frame against closed forms, its engine's guarantees in that frame."""

import motion
import numpy as np
import pytest
from motion import NATIVE, compiled, even, grid, output, sizes

import vfplan
from vfplan import MovingFrame, Status
from vfplan.engine.moving import matrices
from vfplan.errors import SceneError, SettingError

K, R, T = 1000.0, 5e-3, 1e-3


def turned(axis, angle, place=(0, 0, 0)):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = motion.turned(axis, angle), place
    return pose


def shifted(x, y=0.0, z=0.0):
    return turned([0, 0, 1], 0, [x, y, z])


def sheet():
    return grid(even(30e-3, 1e-3), even(30e-3, 1e-3))


def test_from_pose_to_pose_it_goes_evenly_one_sample_late():
    f = MovingFrame()
    speed, turn, axis = 0.05, 0.4, [1, 2, -1]
    for k in range(2001):
        t = k * T
        if k % 20 == 0:
            assert f.pose(t, turned(axis, turn * t, [speed * t, 0, 0]))
        at = f.at(t)
        if k > 40:
            late = turned(axis, turn * (t - 0.02), [speed * (t - 0.02), 0, 0])
            assert np.abs(at - late).max() < 3e-7  # a chord for an arc, and nothing else
    assert not f.stale


@pytest.mark.parametrize("seed", range(3))
def test_no_pose_moves_it_faster_than_told(seed):
    draw = np.random.default_rng(seed)
    pivot = draw.uniform(-0.1, 0.1, 3)
    f = MovingFrame(max_speed_m_s=0.2, max_turn_rad_s=0.7, pivot=pivot)
    before, has_begun, t = None, False, 0.0
    for _ in range(1500):
        step = draw.choice([T, T, T, 5 * T, 0.0])
        t += step
        if draw.random() < 0.05:
            late = draw.uniform(0, 0.03)
            axis, angle = draw.normal(size=3), draw.uniform(-4, 4)
            f.pose(t - late, turned(axis, angle, draw.uniform(-1, 1, 3)))
            has_begun = True
        now = f.at(t)[:3]
        turn = now[:, :3]
        assert np.abs(turn.T @ turn - np.eye(3)).max() < 1e-14
        if before is not None:
            moved = now @ [*pivot, 1] - before @ [*pivot, 1]
            by = before[:, :3].T @ turn
            cosine = (np.trace(by) - 1) / 2
            sine = np.linalg.norm(by - np.eye(3)) / np.sqrt(8)
            assert np.linalg.norm(moved) <= 0.2 * step + 1e-14
            assert cosine > 0
            assert 2 * np.arcsin(sine) <= 0.7 * step * (1 + 1e-6) + 1e-12
        before = now if has_begun else None


def test_stale_is_told_within_a_tick_and_coming_back_makes_no_step():
    e, f = vfplan.ProxyEngine(sheet()), MovingFrame(max_age_s=0.1)
    hip = np.array([0, 0, 3e-3])
    nothing = f.step(e, 0.0, hip)
    assert nothing.status == Status.STALE
    assert not nothing.force.any()
    assert np.array_equal(nothing.proxy, hip)
    assert f.step(e, 0.0, [np.nan, 0, 0]).status == Status.STALE | Status.BAD_HIP
    f.pose(0.001, np.eye(4))
    e.reset([0, 0, 8e-3])
    forces, stale = [], []
    for k in range(1, 501):
        if k == 300:
            f.pose(k * T, shifted(0, 0, 8e-3))
        s = f.step(e, k * T, hip if k > 1 else [0, 0, 8e-3])
        forces.append(s.force)
        stale.append(bool(s.status & Status.STALE))
    at = T * np.arange(1, 501)
    assert stale == (at - np.where(at < 300 * T, 0.001, 300 * T) > 0.1).tolist()
    assert sizes(forces)[1:].max() <= K * 0.25 * T * (1 + 1e-6)
    assert forces[-1] == pytest.approx([0, 0, 10.0], abs=0.1)
    early = MovingFrame()
    early.pose(0.0, np.eye(4))
    early.pose(5.0, np.eye(4))  # a clock that is ahead
    early.at(0.01)
    assert early.stale


BAD_TICKS = {"good": 0, "stuck": 99, "not a number": 99, "infinite": 99, "back 100 s": 99,
    "back 100 s with its tracker": 99, "one tick back": 1, "one tick not a number": 1}  # fmt: skip


def test_a_bad_clock_is_stale_in_a_controller(tmp_path):
    """The fixture stands still in a tick whose time is not later than the one before."""
    printed = output(compiled(tmp_path, NATIVE / "moving_clock.cpp", "-O0"))
    told = dict(line.rsplit(": ", 1) for line in printed.splitlines())
    for case, ticks in BAD_TICKS.items():
        for poses in ("poses", "no poses"):
            assert int(told.pop(f"{case}, {poses}")) == ticks, (case, poses)
    assert told == {}


def test_looking_at_the_frame_before_the_step_is_no_bad_clock():
    e, f = vfplan.ProxyEngine(sheet()), MovingFrame()
    f.pose(0.0, np.eye(4))
    for k in range(1, 50):
        f.at(k * T)
        assert not f.stale
        assert f.step(e, k * T, [0, 0, 8e-3]).status == 0
    f.at(40 * T)
    assert f.stale
    f.at(50 * T)
    assert not f.stale


def test_the_lag_is_the_way_that_is_left():
    """The pose jumps by 0.5 m and turns by 1 rad, while the frame may do a quarter of that a s."""
    turn, place = 1.0, np.array([0.0, 0.3, 0.2])
    f = MovingFrame(max_turn_rad_s=0.25)
    assert f.lag_m(place) == np.inf
    f.pose(0.0, np.eye(4))
    f.at(0.0)
    assert f.lag_m(place) == 0
    assert f.lag_m([np.nan, 0, 0]) == np.inf
    f.pose(T, turned([1, 0, 0], turn, [0.5, 0, 0]))
    for k in range(1, 5001):
        f.at(k * T)
        went, left = min(0.25 * (k - 1) * T, 0.5), turn - 0.25 * (k - 1) * T
        chord = 2 * 0.13**0.5 * np.sin(max(left, 0) / 2)
        moved = place + np.array([went, 0, 0])
        assert f.lag_m(moved) == pytest.approx(np.hypot(0.5 - went, chord), abs=1e-6)
    assert f.lag_m(place) == pytest.approx(0, abs=1e-15)


def test_clearance_holds_in_the_fixtures_frame_and_k_turns_with_it():
    k = [400.0, 700.0, 1000.0]
    e = vfplan.ProxyEngine(sheet(), stiffness=k)
    f = MovingFrame(max_turn_rad_s=20, max_speed_m_s=1)
    draw, n = np.random.default_rng(3), 4000
    t = T * np.arange(n)
    hips = np.stack((8e-3 * np.sin(3 * t), 5e-3 * np.cos(2 * t), 6e-3 * np.cos(9 * t) + 3e-3), 1)
    seen = 0
    for first in range(0, n, 17):
        pose = turned([1, 1, 3], 0.5 * np.sin(t[first]), [3e-3 * np.sin(1.5 * t[first]), 0, 0])
        pose[:3, 3] += draw.normal(0, 2e-4, 3)
        f.pose(t[first], pose)
        part = slice(first, first + 17)
        trace, frames, ages, _ = f.traced(e, t[part], hips[part])
        turns = matrices(frames)[:, :3, :3]
        proxies = np.einsum("tji,tj->ti", turns, trace.proxy - frames[:, :3])
        out = trace.status & Status.INSIDE == 0
        assert (e.distance(proxies)[out] >= R - e.parameters.band).all()
        inner = np.einsum("tji,tj->ti", turns, trace.proxy - hips[part])
        force = np.einsum("tij,tj->ti", turns, k * inner)
        assert trace.force == pytest.approx(force, abs=1e-9)
        assert (ages <= 0.017 + 1e-9).all()
        seen += np.count_nonzero(trace.state == 1)
    assert seen > 500


def test_a_guide_moves_with_its_frame():
    x = np.arange(0, 0.06, 1e-3)
    curve = np.stack((x, 2e-3 * np.sin(90 * x), 0 * x), axis=1)
    made = [vfplan.Guide(curve, 1e-3, lead_force=0.5) for _ in range(2)]
    f, t = MovingFrame(pivot=[0.03, 0, 0]), T * np.arange(1200)
    hips = np.stack((0.03 + 0.02 * np.sin(3 * t), 3e-3 * np.cos(7 * t), 2e-3 * np.sin(9 * t)), 1)
    parts = []
    assert f.step(made[0], 0.0, hips[0]).status == Status.STALE
    for first in range(0, 1200, 20):
        f.pose(t[first], turned([1, -1, 2], 0.2 * t[first], [2e-3 * t[first], 0, 1e-3]))
        parts.append(f.traced(made[0], t[first : first + 20], hips[first : first + 20])[:2])
    traces, frames = zip(*parts, strict=True)
    frames = np.concatenate(frames)
    turns = matrices(frames)[:, :3, :3]
    wanted = made[1].run(np.einsum("tji,tj->ti", turns, hips - frames[:, :3]))
    for name in ("arc_m", "lateral_m", "remaining_m", "held"):
        found = np.concatenate([getattr(trace, name) for trace in traces])
        assert found == pytest.approx(getattr(wanted, name), abs=1e-12), name
    force = np.concatenate([trace.force for trace in traces])
    outer = np.einsum("tij,tj->ti", turns, wanted.force)
    assert force == pytest.approx(outer, abs=1e-9)
    assert np.linalg.norm(force, axis=1).max() > 1


def test_what_is_no_pose_is_refused():
    f, mirror = MovingFrame(), np.diag([1.0, 1.0, -1.0, 1.0])
    for bad in (np.eye(3), 2 * np.eye(4), mirror, np.full((4, 4), np.nan), shifted(2e6)):
        with pytest.raises(SceneError, match="pose"):
            f.pose(0.0, bad)
    with pytest.raises(SceneError, match="time"):
        f.pose(np.nan, np.eye(4))
    assert [f.pose(t, np.eye(4)) for t in (0.5, 0.5, 0.4)] == [True, False, False]
    assert f.refused == 2
    assert all(f.pose(1.0 + i, np.eye(4)) for i in range(63))
    assert not f.pose(99.0, np.eye(4))
    for bad in ({"max_age_s": 0}, {"max_speed_m_s": np.inf}, {"max_turn_rad_s": -1}):
        with pytest.raises(SettingError, match=next(iter(bad))):
            MovingFrame(**bad)


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """The loop and the thread beside it, built without Python, watched by ThreadSanitizer."""
    folder = tmp_path_factory.mktemp("changing")
    flags = ("-O0", "-DVFPLAN_NARROW", "-fsanitize=thread")
    return compiled(folder, NATIVE / "changing_ticks.cpp", *flags)


@pytest.mark.slow
@pytest.mark.full
def test_a_controllers_bits_are_pythons(program, tmp_path):
    draw = np.random.default_rng(5)
    rows, stamp = [], 0.0
    for k in range(1500):
        t = k * T
        if t >= stamp + draw.uniform(0.01, 0.05):
            stamp = t
            q = np.array([1, 0, 0, 0]) + draw.normal(0, 0.02, 4)
            rows.append([0, t - 0.005, *draw.normal(0, 5e-4, 3), *(q / np.linalg.norm(q))])
        hip = [8e-3 * np.sin(3 * t), 5e-3 * np.cos(2 * t), 6e-3 * np.cos(9 * t) + 3e-3]
        rows.append([1, t, *hip, 0, 0, 0, 0])
    np.array(rows).tofile(tmp_path / "in")
    output(program, "move", tmp_path / "in", tmp_path / "out", timeout=1800)
    found = np.fromfile(tmp_path / "out").reshape(-1, 7)
    g = np.arange(-20, 21) * 1e-3
    e, f = vfplan.ProxyEngine(grid(g, g)[:, [1, 0, 2]], band=1e-5), MovingFrame(pivot=[0, 0, 1e-3])
    wanted = []
    for kind, t, x, y, z, *q in rows:
        if kind == 0:
            f.native.pose(t, np.array([x, y, z]), np.array(q))
        else:
            s = f.step(e, t, [x, y, z])
            wanted.append([*s.proxy, *s.force, int(s.status)])
    assert np.array_equal(found, wanted)
    assert np.count_nonzero(found[:, 5]) > 500


@pytest.mark.slow
@pytest.mark.parametrize(
    "exchanges, edits", [(60, 4000), pytest.param(10_000, 1_000_000, marks=pytest.mark.full)]
)
def test_exchanges_and_edits_under_load_race_with_nothing(program, exchanges, edits):
    for word, done, count in (("exchange", "exchanged", exchanges), ("edit", "edited", edits)):
        assert f"{done} {count} ticks " in output(program, word, count, timeout=1800)


@pytest.mark.slow
@pytest.mark.full
def test_two_threads_make_and_step_engines_without_a_race(program):
    """The loops over points are chosen once in a program, by whoever comes first."""
    assert "two threads" in output(program, "make", 2000)


def test_one_stray_stamp_is_overcome_and_a_reset_forgets():
    """A tracker at 50 Hz sends one pose from the far future, and one from the past."""
    frame, stale = MovingFrame(), []
    for tick in range(1000):
        if tick % 20 == 0:
            stray = {300: 1e9, 600: -1e9}.get(tick, 1e-3 * tick)
            frame.pose(stray, np.eye(4))
        frame.at(1e-3 * tick)
        stale.append(frame.stale)
    assert not any(stale[:300] + stale[400:])
    assert sum(stale) <= 60
    assert frame.refused <= 4
    frame.reset()
    assert frame.stale
    assert frame.pose(0.0, np.eye(4))
    frame.at(0.0)
    assert not frame.stale
