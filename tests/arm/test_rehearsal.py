"""A rehearsal: what it measures against closed forms, and what it must notice."""

from __future__ import annotations

import numpy as np
import pytest
from replays import fixture_of

from vfplan.arm.model import Arm
from vfplan.arm.rehearsal import rehearse
from vfplan.errors import InputError, SettingError
from vfplan.replaying.link import approach_sessions
from vfplan.robot import Robot
from vfplan.session.session import Session

pytestmark = pytest.mark.slow


def wall(length=0.06, stiffness=1000.0):
    """A straight drawn line along x before the arm, endless along z."""
    x = np.arange(0.0, length, 2e-4)
    return fixture_of(np.stack([0.45 + x, 0 * x + 0.05, 0 * x + 0.3], axis=1), stiffness=stiffness)


def pressed(depth, at=0.03, seconds=1.2):
    """A hand that goes through the wall's contact by `depth` [m] and rests there."""
    ticks = round(seconds * 1000)
    share = np.minimum(np.arange(ticks) / (0.5 * ticks), 1.0)
    goal = [0.45 + at, 0.055 - depth, 0.3]
    start = np.array([0.45 + at, 0.075, 0.3])
    hip = start + share[:, None] * (np.array(goal) - start)
    return Session(1e-3 * np.arange(ticks), hip)


def pulled_off():
    """Presses hard near the line's end and goes on past it: the force is gone in a tick."""
    down = pressed(25e-3, at=0.05).hip
    hip = np.concatenate((down, np.linspace(down[-1], down[-1] + [0.05, 0, 0], 400)))
    return Session(1e-3 * np.arange(len(hip)), hip)


def without_friction():
    arm = Arm("panda")
    arm.model.dof_frictionloss[:] = 0
    return arm


def test_hand_and_fixture_share_the_way_like_two_springs():
    """At rest k_h (goal - x) = K (proxy - x), so depth is k_h / (K + k_h) of the hand's."""
    found = rehearse(wall(), pressed(9e-3, seconds=3.0), without_friction(), hand_stiffness=800.0)
    assert found.passed, found.metrics["reflexes"]
    m = found.metrics
    depth = found.ticks.penetration[-1]
    assert depth == pytest.approx(9e-3 * 800 / 1800, rel=0.02)
    assert np.linalg.norm(found.motion.force[-1]) == pytest.approx(1000 * depth, rel=1e-9)
    assert np.linalg.norm(found.motion.pull[-1]) == pytest.approx(1000 * depth, rel=0.05)
    assert m["clearance_min_m"] >= -1e-9
    assert m["force_max_n"] == pytest.approx(np.linalg.norm(found.motion.force, axis=1).max())
    # The torques are J^T F of the posture.
    found.arm.hold(found.motion.q[-1])
    J = found.arm.read_tip()[2][:3]
    assert found.motion.torque[-1] == pytest.approx(J.T @ found.motion.force[-1], abs=1e-9)


def test_a_release_stops_the_raw_arm_and_not_the_governed_one():
    fixture, session = wall(stiffness=2000.0), pulled_off()
    raw = rehearse(fixture, session, Arm("panda"), governed=False)
    assert not raw.passed
    kind = "controller_torque_discontinuity"
    first = next(reflex for reflex in raw.metrics["reflexes"] if reflex["kind"] == kind)
    assert first["value"] > first["limit"] == 1.0
    assert 0.05 < first["s_m"] < 0.0601  # at the line's end
    held = rehearse(fixture, session, Arm("panda"))
    assert kind not in {reflex["kind"] for reflex in held.metrics["reflexes"]}
    assert held.metrics["torque_step_max_nm"] <= 0.95
    assert held.metrics["force_step_max_n"] <= 1.2
    governor = held.metrics["governor"]
    assert governor["engine_force_step_max_n"] > 5
    assert governor["work_j"] <= 1.01 * governor["energy_stored_j"]
    assert governor["energy_given_j"] <= 1.01 * governor["energy_stored_j"]


def test_the_same_rehearsal_gives_the_same_bits():
    one, two = (rehearse(wall(), pressed(5e-3), Arm("fr3")) for _ in range(2))
    for name in ("q", "tip", "torque", "force"):
        assert np.array_equal(getattr(one.motion, name), getattr(two.motion, name))


def test_the_base_moves_everything_with_it():
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # a quarter turn about z
    here = rehearse(wall(), pressed(5e-3), Arm("panda"))
    fixture = fixture_of(wall().points @ turn.T + [1.0, 2, 0.5])
    session = Session(pressed(5e-3).time, pressed(5e-3).hip @ turn.T + [1.0, 2, 0.5])
    half = np.sqrt(0.5)
    there = rehearse(fixture, session, Arm("panda", base=(1, 2, 0.5, half, 0, 0, half)))
    assert there.motion.q == pytest.approx(here.motion.q, abs=1e-6)


def test_a_filter_behind_which_nothing_is_bounded_is_refused_before_the_run(monkeypatch):
    monkeypatch.delattr("vfplan.arm.rehearsal.run_loop")
    slow = Robot(**vars(Arm("panda").robot) | {"filter_hz": 0.01})
    with pytest.raises(SettingError, match="behind so slow a filter"):
        rehearse(wall(), pressed(5e-3), Arm("panda", slow))


def test_out_of_reach_is_said_with_its_place():
    fixture = fixture_of(wall().points + np.array([0.6, 0, 0]))
    session = Session(pressed(5e-3).time, pressed(5e-3).hip + np.array([0.6, 0, 0]))
    found = rehearse(fixture, session, Arm("panda"))
    assert not found.metrics["reachable"]
    assert not found.passed
    place = found.metrics["unreached"][0]
    assert place["left_m"] > 0.1
    assert place["s_m"] == pytest.approx(0.03, abs=1e-3)


def test_mass_and_condition_are_those_of_the_postures():
    found = rehearse(wall(), pressed(3e-3), Arm("panda"))
    arm, m = found.arm, found.metrics
    arm.hold(found.motion.q[m["mass_min_tick"]])
    J = arm.read_tip()[2][:3].copy()
    inverse = J @ np.linalg.inv(arm.inertia()) @ J.T
    assert m["mass_min_kg"] == pytest.approx(1 / np.linalg.eigvalsh(inverse)[-1])
    assert np.linalg.cond(J) <= m["condition_max"]
    margins = np.minimum(found.motion.q - arm.low, arm.high - found.motion.q)
    assert m["joint_margin_min_rad"] == margins.min()
    assert 1600 < m["k_max_n_per_m"] < 1650  # b / (1.5 T + 1 / (2 pi 100 Hz)) = 1617 N/m


def test_a_visit_goes_along_both_sides_and_no_deeper_than_the_line():
    fixture = wall()
    left, right = approach_sessions(fixture)
    for way, sign in ((left, 1), (right, -1)):
        beside = sign * (way.hip[:, 1] - 0.05)
        assert beside.min() == pytest.approx(0.0, abs=1e-9)
        assert beside[[0, -1]] == pytest.approx([7.5e-3] * 2)
        assert np.ptp(way.hip[:, 0]) == pytest.approx(0.0598)
        speed = np.linalg.norm(np.diff(way.hip, axis=0), axis=1).max() / 1e-3
        assert speed == pytest.approx(0.05, rel=1e-3)
    with pytest.raises(InputError, match="no drawn curve"):
        approach_sessions(fixture_of(fixture.points, curve=False))
