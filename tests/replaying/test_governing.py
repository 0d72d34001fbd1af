"""A governor in a replay: what the hand then feels, and what an arm would have said without."""

from __future__ import annotations

import numpy as np
import pytest
from replays import codes_of, fixture_of, write_session

import vfplan
from vfplan.session.session import Session

PANDA = vfplan.read_robot("franka")


def off_the_edge(depth=12e-3):
    """Pressed on a wall 40 mm long, slid along it and off its end, and on: a release in a tick."""
    wall = np.column_stack([np.arange(0, 0.04, 2e-4), np.zeros(200), np.zeros(200)])
    down = np.linspace([0.02, 0.01, 0], [0.02, 5e-3 - depth, 0], 400)
    along = np.linspace(down[-1], [0.06, 5e-3 - depth, 0], 800)
    hip = np.concatenate((down, along))
    fixture = fixture_of(wall)
    return fixture, Session(1e-3 * np.arange(len(hip)), hip)


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
    assert said(robot=PANDA) == []  # its own checks say it
    assert said(governor=PANDA) == []
    slow = Session(1e-2 * np.arange(len(session.hip)), session.hip)
    assert "force-step" not in codes_of(vfplan.replay(fixture, slow))


def test_the_command_takes_the_robots_limits_or_its_own(tmp_path, vfplan_cli):
    fixture, session = off_the_edge()
    bundle, table = tmp_path / "wall.h5", tmp_path / "session.csv"
    vfplan.write_fixture(fixture, bundle)
    write_session(table, session)
    plain = vfplan_cli("replay", bundle, table)
    assert "warning: force-step: The force changes by" in plain.stdout
    held = vfplan_cli("replay", bundle, table, "--governor", "--robot", "fr3", "--json").json
    assert (held["governor"]["force_step_n"], held["governor"]["force_max_n"]) == (1.2, 20.0)
    assert next(c for c in held["checks"] if c["name"] == "force_step_max_n")["pass"]
    own = vfplan_cli("replay", bundle, table, "--governor", "0.4,15", "--rule", "both")
    assert own.stdout.count("governor     0.4 N a tick, 15 N at most") == 2
    vfplan_cli("replay", bundle, table, "--governor",
               "0.01,20").fails(2, "force_step_n", "at least 0.316228")  # fmt: skip
