"""A controller's log with poses, exchanges, edits and a governor replays to the bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion import even, grid
from refusals import refuses
from replays import at_1_khz, codes_of, fixture_of, write_session

import vfplan
from vfplan.bundle.write import write_fixture
from vfplan.errors import SceneError, SessionError, SettingError
from vfplan.replaying.findings import open_words
from vfplan.session.events import Event, Poses, read_events, read_poses, write_events

K, T, N = 1000.0, 1e-3, 2500


def sheet(z=0.0, half=25e-3):
    return grid(even(half, 1e-3), even(half, 1e-3), z)


def fixture(z=0.0, half=25e-3):
    return fixture_of(sheet(z, half), axis=None, stiffness=K, curve=False, band=5e-5)


TIMES = T * np.arange(N)
DOWN = 9e-3 * np.cos(2 * np.pi * TIMES / 1.2) + 2e-3
HIPS = np.stack((6e-3 * np.sin(2 * TIMES), 4e-3 * np.cos(3 * TIMES), DOWN), axis=1)
SESSION = vfplan.Session(TIMES, HIPS)


def tracked(draw):
    """Poses at 20 to 60 Hz that come 5 to 40 ms late, turned a little."""
    time = np.cumsum(draw.uniform(0.016, 0.05, 160))
    time = time[time < N * T]
    q = np.column_stack((np.ones(len(time)), draw.normal(0, 5e-3, (len(time), 3))))
    q /= np.linalg.norm(q, axis=1)[:, None]
    place = np.column_stack((2e-3 * np.sin(time), 0 * time, 1e-3 * np.sin(4 * time)))
    late = np.maximum.accumulate(time + draw.uniform(0.005, 0.04, len(time)))
    return Poses(time, np.column_stack((place, q)), late)


def happened(draw):
    """An edit in every 97th tick, and two exchanges."""
    gone = draw.permutation(len(sheet()))[:200].reshape(-1, 10)
    come = sheet()[gone] - [0, 0, 2e-4]
    events = [Event(97 * (i + 1), remove=gone[i], add=come[i]) for i in range(10)]
    events += [Event(1100, fixture=fixture(0.5e-3, 20e-3)), Event(1101, remake=True)]
    events += [Event(1200 + 97 * i, remove=[3 * i], add=come[i]) for i in range(5)]
    return [*events, Event(2000, fixture=fixture(-0.5e-3))]


def controller(poses, events, robot=None):
    """The loop, tick by tick, as docs/moving.md has it."""
    engine, frame = vfplan.ProxyEngine.of(fixture()), vfplan.MovingFrame()
    governor = None if robot is None else vfplan.Governor.of(robot, K)
    engine.make_editable()
    events, n, forces = list(events), 0, []
    for t, hip in zip(TIMES, HIPS, strict=True):
        while poses is not None and n < len(poses.time) and poses.arrived[n] <= t:
            frame.native.pose(poses.time[n], poses.pose[n, :3].copy(), poses.pose[n, 3:].copy())
            n += 1
        while events and events[0].tick == round(t / T):
            event = events.pop(0)
            if event.kind == "exchange":
                other = vfplan.ProxyEngine.of(event.fixture)
                other.make_editable()
                engine.exchange(other)
            elif event.kind == "edit":
                engine.edit(event.remove, event.add)
            else:
                engine.native.remake()
        force = (frame.step(engine, t, hip) if poses is not None else engine.step(hip)).force
        forces.append(force if governor is None else governor.step(force))
    return np.array(forces)


WEAK = replace(vfplan.read_robot("franka"), force_step_limit_n=0.4, force_limit_n=5.0)


@pytest.mark.parametrize(
    "moves, changes, robot",
    [(False, True, None), (True, False, None), (True, True, None), (True, True, WEAK)],
)  # fmt: skip
def test_a_log_replays_to_the_bit(moves, changes, robot, tmp_path):
    """A governor is behind all of it: K is the stiffest that comes."""
    draw = np.random.default_rng(8)
    poses = tracked(draw) if moves else None
    events = happened(draw) if changes else []
    forces = controller(poses, events, robot)
    how = {"rule": "robust", "poses": poses, "governor": robot}
    done = vfplan.replay(fixture(), SESSION, events=events, **how)
    assert np.array_equal(done.trace.force, forces)
    assert np.abs(forces).max() > 3
    found = done.metrics
    if robot is not None:
        assert found["governor"]["engine_force_max_n"] > 5.0 >= found["force_max_n"]
        assert found["governor"]["held_ticks"] > 100
        stiff = replace(fixture().rendering, stiffness=np.full(3, 9e4))
        stiffer = [Event(5, fixture=replace(fixture(), rendering=stiff))]
        with pytest.raises(SettingError, match="spring"):
            vfplan.replay(fixture(), SESSION, events=stiffer, governor=robot)
    assert (found["exchanges"], found["edits"]) == (2 if changes else 0, 255 if changes else 0)
    assert found["changing_ticks"] >= (18 if changes else 0)
    assert found["clearance_min_m"] >= -5e-5
    if moves:
        assert 0.02 < found["pose_age_max_s"] < 0.1
        assert found["stale_ticks"] == np.count_nonzero(poses.arrived[0] > TIMES)
    if changes:
        for event in events:
            if event.fixture is not None:
                write_fixture(event.fixture, tmp_path / f"{event.tick}.h5")
                object.__setattr__(event, "fixture", tmp_path / f"{event.tick}.h5")
        write_events(tmp_path / "events.csv", events)
        read = read_events(tmp_path / "events.csv")
        assert [event.kind for event in read] == [event.kind for event in events]
        again = vfplan.replay(fixture(), SESSION, events=tmp_path / "events.csv", **how)
        assert np.array_equal(again.trace.force, forces)


def test_the_fixtures_own_work_is_told_apart():
    """A sheet that comes 4 mm up against a hand that is still: K/2 (d1² - d0²), lifted slowly."""
    time = np.arange(0, 3, 0.02)
    up = 4e-3 * np.clip((time - 0.5) / 2, 0, 1)
    rows = np.zeros((len(time), 7))
    rows[:, 2], rows[:, 3] = up, 1
    hips = np.tile([0, 0, 3e-3], (3000, 1))
    hips[:200, 2] = np.linspace(8e-3, 3e-3, 200)
    session = vfplan.Session(T * np.arange(3000), hips, "robot_base")
    found = vfplan.replay(fixture(), session, poses=Poses(time, rows, time)).metrics
    spring = K / 2 * (6e-3**2 - 2e-3**2)
    # The hand does not move: what the wall stores in the spring it takes from its own motion.
    assert found["fixture_energy_j"] == pytest.approx(spring, rel=0.02)
    assert found["energy_j"] == pytest.approx(-K / 2 * 6e-3**2, rel=0.02)


def test_poses_and_events_are_read_strictly(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("t,x,y,z,qw,qx,qy,qz\n0,0,0,0,1,0,0,0\n0.02,1e-3,0,0,0.6,0.8,0,0\n")
    poses = read_poses(path)
    assert poses.pose.shape == (2, 7)
    assert np.array_equal(poses.arrived, [0, 0.02])
    assert read_poses(path, "mm").pose[1].tolist() == [1e-6, 0, 0, 0.6, 0.8, 0, 0]
    head = "t,x,y,z,qw,qx,qy,qz\n"
    path.write_text(head + "0,0,0,0,1,0,0,0\n1,0,0,0,0.6,0.8018,0,0\n")
    rounded = read_poses(path)
    assert rounded.rounded == 1
    assert np.linalg.norm(rounded.pose[:, 3:], axis=1) == pytest.approx([1, 1], abs=1e-15)
    findings = vfplan.replay(fixture(), SESSION, poses=rounded).metrics["findings"]
    assert "poses-rounded" in [finding["code"] for finding in findings]
    for text, code in (("t,x,y,z\n0,0,0,0\n", "column-missing"), (head, "poses-empty"),
                       (head + "0,0,0,0,2,0,0,0\n", "pose-invalid"),
                       (head + "1,0,0,0,1,0,0,0\n0,0,0,0,1,0,0,0\n", "pose-invalid"),
                       (head + "0,0,0,nan,1,0,0,0\n", "pose-invalid")):  # fmt: skip
        path.write_text(text)
        with refuses(SessionError, code):
            read_poses(path)
    path.write_text("")
    with refuses(SessionError, "no-events"):
        read_events(path)
    for text in (
        "\xff", "-1,edit", "1e3,edit", "9,edit\n8,edit", "9,remove,3", "9,edit\n10,add,0,0,0",
        "9,edit\n9,add,0,0", "9,edit\n9,add,0,nan,0", "9,edit\n9,add,0,0,0\n9,remove,1",
        "9,edit\n9,remove,4294967296", "9,exchange", "9,edit,1", "9,burn",
    ):  # fmt: skip
        path.write_text("tick,what,x,y,z\n" + text)
        with refuses(SessionError, "event-invalid"):
            read_events(path)
    with refuses(SettingError, "changes-alone"):
        vfplan.replay(fixture(), SESSION, rule="both", events=[])


def test_the_command_replays_poses_and_events(vfplan_cli, tmp_path):
    write_fixture(fixture(), tmp_path / "f.h5")
    edit = "tick,what,x,y,z\n9,edit\n9,remove,3\n"
    (tmp_path / "again.csv").write_text(edit + edit[16:])
    (tmp_path / "gone.csv").write_text(edit + "11,exchange,no.h5\n")
    write_session(tmp_path / "s.csv", SESSION)
    poses = tracked(np.random.default_rng(8))
    table = np.column_stack((poses.time, poses.pose, poses.arrived))
    head = "t,x,y,z,qw,qx,qy,qz,arrived"
    np.savetxt(tmp_path / "p.csv", table, "%.17g", ",", header=head, comments="")
    write_events(tmp_path / "e.csv", [Event(900, remove=[3, 4], add=[[0, 0, 1e-4]])])
    where = ("f.h5", "s.csv", "--poses", "p.csv", "--events", "e.csv")
    done = vfplan_cli("replay", *where, "--pivot", "0,0,0.001", "--json", cwd=tmp_path).sound
    assert done.json["edits"] == 3
    assert done.json["stale_ticks"] == np.count_nonzero(poses.arrived[0] > TIMES)
    assert "gave the hand" in vfplan_cli("replay", *where, cwd=tmp_path).stdout
    for code, says, *words in (
        (2, "one rule", *where, "--drop", "0.1"),
        (2, "--poses", *where[:2], "--events", "e.csv", "--pivot", "0,0,1"),
        (2, "--poses", *where[:2], "--pose-limits", "1,1,1"),
        (3, "again.csv, line 4: remove: each a point", *where[:2], "--events", "again.csv"),
        (3, "no.h5", *where[:2], "--events", "gone.csv"),
    ):
        assert says in vfplan_cli("replay", *words, cwd=tmp_path).fails(code).stderr


def test_a_pass_without_the_poses_of_a_log_says_so_and_a_log_of_zeros_does_not(tmp_path):
    limits = (("force_max_n", "at_most", 1e6),)
    for count, is_told in ((0, False), (1, True)):
        path = tmp_path / f"{count}.csv"
        write_session(path, SESSION, poses=np.full(N, count), events=0 * TIMES)
        found = vfplan.replay(fixture(), path, rule="robust", limits=limits)
        assert ("session-changes" in codes_of(found), found.verdict) == (is_told, "pass")
        assert ("the fixture moved" in open_words(found.metrics)) == is_told
    moved = vfplan.replay(fixture(), path, rule="robust", poses=tracked(np.random.default_rng(8)))
    assert moved.metrics["session"]["ignored_columns"] == []


def turned(angle_deg):
    """A pose (7,) that is turned about z."""
    half = np.radians(angle_deg) / 2
    return np.array([0, 0, 0, np.cos(half), 0, 0, np.sin(half)])


HERE, AWAY = turned(0), np.array([0.05, 0, 0, 1, 0, 0, 0])
TRACKERS = {
    # name: (times of the poses [s], poses by their number, verdict, jumps, words of the verdict)
    "good": (np.arange(0, 2.5, 0.02), lambda k: HERE, "pass", 0, ()),
    "stops": (np.arange(0, 0.2, 0.02), lambda k: HERE, "not-tested", 0, ("too old",)),
    "late": (np.arange(1.0, 2.5, 0.02), lambda k: HERE, "not-tested", 0, ("no pose had come",)),
    "jumps": (np.arange(0, 2.5, 0.02), lambda k: AWAY if k == 30 else HERE, "pass", 2,
              ("2 poses jumped", "lagged by up to 4")),
    "turns": (np.arange(0, 2.5, 0.02), lambda k: turned(180 * (k == 30)), "pass", 2, ("jumped",)),
    "slips": (np.arange(0, 2.5, 0.02), lambda k: turned(20 * (k > 30)), "pass", 1,
              ("1 pose jumped",)),
}  # fmt: skip


@pytest.mark.parametrize("name", TRACKERS)
def test_a_verdict_tells_what_its_poses_were_worth(name):
    times, pose_of, verdict, jumps, words = TRACKERS[name]
    poses = Poses(times, np.array([pose_of(k) for k in range(len(times))]), times)
    limits = (("force_max_n", "at_most", 100),)
    replayed = vfplan.replay(fixture(), SESSION, rule="robust", poses=poses, limits=limits)
    found = replayed.metrics
    assert (found["verdict"], found["pose_jumps"]) == (verdict, jumps)
    assert all(word in open_words(found) for word in words)
    assert ("pose-jump" in codes_of(replayed)) == (jumps > 0)
    assert ("stale" in codes_of(replayed)) == (verdict == "not-tested")
    assert (found["stale_contact_ticks"] > 0) == (verdict == "not-tested")
    assert words or not open_words(found)


def test_a_fixture_is_exchanged_within_its_frame_alone_and_an_event_that_never_came_is_told():
    late = vfplan.replay(fixture(), SESSION, rule="robust", events=[Event(90000, remove=[3])])
    assert "events-left" in codes_of(late)
    other = replace(fixture(), frame="patient_lps", registration=None)
    for moves in (False, True):
        poses = tracked(np.random.default_rng(8)) if moves else None
        with refuses(SceneError, "exchange-frame"):
            vfplan.replay(fixture(), SESSION, events=[Event(900, fixture=other)], poses=poses)


PANDA = vfplan.read_robot("franka")


def off_the_edge():
    """Pressed on a wall 40 mm long, slid along it and off its end, and on: a release in a tick."""
    wall = np.column_stack([np.arange(0, 0.04, 2e-4), np.zeros(200), np.zeros(200)])
    down = np.linspace([0.02, 0.01, 0], [0.02, -7e-3, 0], 400)
    along = np.linspace(down[-1], [0.06, -7e-3, 0], 800)
    return fixture_of(wall), at_1_khz(np.concatenate((down, along)))


def test_a_release_is_held_back_and_only_the_force_changes():
    fixture, session = off_the_edge()
    raw = vfplan.replay(fixture, session)
    held = vfplan.replay(fixture, session, governor=PANDA)
    assert raw.metrics["force_step_max_n"] > 5
    assert held.metrics["force_step_max_n"] <= 1.2
    report = held.metrics["governor"]
    assert report["engine_force_step_max_n"] == raw.metrics["force_step_max_n"]
    assert report["held_back_max_n"] == pytest.approx(raw.metrics["force_step_max_n"] - 1.2)
    for name in ("penetration_max_m", "clearance_min_m", "states"):
        assert held.metrics[name] == raw.metrics[name]
    commanded, rendered = held.ticks.force, raw.ticks.force
    assert np.array_equal(commanded, vfplan.Governor.of(PANDA, 1000.0).run(rendered))
    work = ((commanded - rendered)[:-1] * np.diff(session.hip, axis=0)).sum()
    assert report["work_j"] == pytest.approx(work, rel=1e-9)
    assert held.metrics["energy_j"] == pytest.approx(raw.metrics["energy_j"] + work)
    assert report["energy_given_j"] <= 1.01 * report["energy_stored_j"]
    assert report["overdrawn_ticks"] == 0
    assert "governor" not in raw.metrics
    assert held.record["governor"]["force_step_n"] == 1.2


def test_without_a_robot_it_says_what_a_common_arm_does():
    fixture, session = off_the_edge()

    def said(**more):
        found = vfplan.replay(fixture, session, **more).metrics["findings"]
        return [f["message"] for f in found if f["code"] == "force-step"]

    (message,) = said()
    assert "a Franka arm stops above about 1.2 N" in message
    assert (said(robot=PANDA), said(governor=PANDA)) == ([], [])
    slow = vfplan.Session(1e-2 * np.arange(len(session.hip)), session.hip)
    assert "force-step" not in codes_of(vfplan.replay(fixture, slow))


def test_the_command_takes_the_robots_limits_or_its_own(tmp_path, vfplan_cli):
    fixture, session = off_the_edge()
    bundle, table = tmp_path / "wall.h5", tmp_path / "session.csv"
    vfplan.write_fixture(fixture, bundle)
    write_session(table, session)
    held = vfplan_cli("replay", bundle, table, "--governor", "--robot", "fr3", "--json").json
    assert (held["governor"]["force_step_n"], held["governor"]["force_max_n"]) == (1.2, 20.0)
    assert next(c for c in held["checks"] if c["name"] == "force_step_max_n")["pass"]
    own = vfplan_cli("replay", bundle, table, "--governor", "0.4,15", "--rule", "both")
    assert own.stdout.count("governor     0.4 N a tick, 15 N at most") == 2
    weak = vfplan_cli("replay", bundle, table, "--governor", "0.01,20")
    weak.fails(2, "force_step_n", "at least 0.316228")
