"""Lossy links, two rules side by side, and limits: each against a slow, obvious form."""

from __future__ import annotations

import pickle
from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from refusals import refuses
from replays import at_1_khz, codes_of, fixture_of, line, probing

import vfplan
from vfplan.errors import SettingError
from vfplan.geometry.lines import row_lengths, step_lengths
from vfplan.replaying.findings import bound_text, check_text, verdict_sentence
from vfplan.replaying.link import Comparison, Link, LossyLink
from vfplan.replaying.metrics import Number
from vfplan.replaying.replay import replay
from vfplan.robot import Robot, read_robot
from vfplan.session.result import TickBlock
from vfplan.session.session import Session


def delivered(link, time, hip, size):
    """What arrives, tick by tick, when the session is fed in blocks of `size`."""
    lossy, out, last = LossyLink(link), [], None
    for start in range(0, len(time), size):
        arrived, rows = lossy.deliver(time[start : start + size], hip[start : start + size])
        for row in rows:
            last = arrived[row] if row >= 0 else last
            out.append(last)
        if len(arrived):
            last = arrived[-1]
    return np.array(out), lossy.report(20)


@pytest.mark.parametrize("link", [
    Link(drop=0.3, seed=4),
    Link(jitter_s=3e-3, seed=4),
    Link(delay_ticks=13),
    Link(quantum_m=1e-4),
    Link(drop=0.2, jitter_s=2e-3, delay_ticks=5, quantum_m=5e-5, seed=9),
    Link(drop=0.95, delay_ticks=400, seed=1),
], ids=lambda link: "-".join(link.report()))  # fmt: skip
def test_blocks_do_not_change_what_arrives(link):
    session = probing(1.0, seed=3)
    whole, report = delivered(link, session.time, session.hip, 1000)
    for size in (1, 7, 64, 333):
        parts, again = delivered(link, session.time, session.hip, size)
        assert_array_equal(parts, whole, err_msg=f"blocks of {size}")
        assert again == report


def test_delay_and_quantum_are_exact():
    session = probing(1.0)
    late, _ = delivered(Link(delay_ticks=13), session.time, session.hip, 100)
    assert_array_equal(late[13:], session.hip[:-13])
    assert_array_equal(late[:13], np.repeat(session.hip[:1], 13, axis=0))
    coarse, _ = delivered(Link(quantum_m=1e-4), session.time, session.hip, 100)
    assert np.abs(coarse - session.hip).max() <= 0.5e-4 + 1e-12
    assert_allclose(coarse / 1e-4, np.round(coarse / 1e-4), atol=1e-9)


def test_jitter_only_ages_and_keeps_order():
    time = np.arange(2000) * 1e-3
    hip = np.stack([time, 0 * time, 0 * time], axis=1)  # x says when the position was true
    seen, _ = delivered(Link(jitter_s=4e-3, seed=2), time, hip, 100)
    age = time - seen[:, 0]
    assert age.min() >= -1e-12
    assert age.max() <= 4e-3 + 1e-12
    assert (np.diff(seen[:, 0]) >= 0).all()
    assert 0.5e-3 < age.mean() < 2.5e-3


def test_losses_are_counted():
    session = probing(2.0)
    seen, report = delivered(Link(drop=0.5, seed=8), session.time, session.hip, 128)
    lost = ~(seen == session.hip).all(axis=1)
    assert report["lost"] == np.count_nonzero(lost)
    assert 0.45 < lost.mean() < 0.55
    longest = max(sum(group) for is_lost, group in groupby(lost) if is_lost)
    assert report["lost_longest"] == longest
    start = report["lost_longest_tick"]
    assert lost[start : start + longest].all()


def test_a_lost_packet_repeats_the_last_command():
    session = probing(1.0)
    found = replay(fixture_of(line()), session, link=Link(drop=0.4, seed=5))
    lost = ~(found.ticks.hip == session.hip).all(axis=1)
    assert lost.sum() == found.metrics["link"]["lost"] > 300
    for k in np.flatnonzero(lost):
        assert_array_equal(found.ticks.force[k], found.ticks.force[k - 1])
    # Energy goes to the hand, which moved on while the command was repeated.
    work = (found.ticks.force[:-1] * np.diff(session.hip, axis=0)).sum()
    assert found.metrics["energy_j"] == pytest.approx(work, rel=1e-9)


def test_a_governor_behind_a_lossy_link_counts_every_tick():
    fast = at_1_khz(np.linspace([0.05, 0.02, 0], [0.05, -0.09, 0], 400))
    weak = replace(read_robot("franka"), force_step_limit_n=0.6)
    free, held = (
        replay(fixture_of(line()), fast, governor=robot, link=Link(drop=0.6, seed=1))
        for robot in (None, weak)
    )
    differs = (free.ticks.force != held.ticks.force).any(axis=1)
    assert held.metrics["governor"]["held_ticks"] == np.count_nonzero(differs) > 300


def test_a_link_is_compared_with_a_perfect_one():
    session = probing(seed=2)
    clean = replay(fixture_of(line()), session)
    found = replay(fixture_of(line()), session, link=Link(delay_ticks=8))
    link = found.metrics["link"]
    assert link["delay_ticks"] == 8
    assert not {"drop", "lost"} & link.keys()
    assert link["perfect"]["energy_j"] == clean.metrics["energy_j"]
    gap = row_lengths(found.ticks.force - clean.ticks.force)
    assert link["apart"]["force_max_n"] == pytest.approx(gap.max())
    assert link["apart"]["first_difference_tick"] == 1
    # A late spring pushes where it should no longer: the loop is active.
    assert found.metrics["energy_j"] > 3 * clean.metrics["energy_j"] > 0
    assert "active" in codes_of(found) - codes_of(clean)


def test_a_robot_stops_where_too_many_packets_are_lost():
    link, robot = Link(drop=0.9, seed=3), read_robot("franka")
    found = replay(fixture_of(line()), probing(1.0), link=link, robot=robot)
    assert found.metrics["link"]["lost_longest"] > 20
    assert found.metrics["link"]["robot_stops"] is True
    assert "robot-stops" in codes_of(found)


@pytest.mark.parametrize(
    "fault", [{"drop": 1.0}, {"drop": -0.1}, {"jitter_s": -1.0}, {"delay_ticks": -1},
              {"quantum_m": 0.0}, {"drop": float("nan")}, {"seed": -1}],
)  # fmt: skip
def test_impossible_links_are_refused(fault):
    with refuses(SettingError, "link-out-of-range", **fault):
        Link(**fault)


def test_both_rules_and_where_they_part():
    # Lifting straight off the paper's proxy never lets go.
    time = np.arange(1500) * 1e-3
    y = np.interp(time, [0, 0.3, 0.6, 0.9, 1.5], [0.012, 0.002, 0.002, 0.03, 0.03])
    session = Session(time, np.stack([0 * time + 0.05, y, 0 * time], axis=1))
    both = replay(fixture_of(line()), session, rule="both")
    paper = replay(fixture_of(line()), session, rule="paper")
    robust = replay(fixture_of(line()), session, rule="robust")
    assert (both.metrics["rule"], both.record["rule"]) == ("both", "robust")
    assert both.metrics["force_max_n"] == robust.metrics["force_max_n"]
    assert both.metrics["paper"]["force_max_n"] == paper.metrics["force_max_n"]
    assert_array_equal(both.other.ticks.proxy, paper.ticks.proxy)
    gap = row_lengths(robust.ticks.proxy - paper.ticks.proxy)
    apart = both.metrics["apart"]
    assert apart["spans"][0]["start_tick"] == np.flatnonzero(gap > 5e-5)[0]
    assert apart["ticks"] == np.count_nonzero(gap > 5e-5)
    assert apart["proxy_max_m"] == pytest.approx(gap.max())
    assert gap.max() > 0.015


def test_a_comparison_does_not_grow_with_the_session():
    comparison, sizes = Comparison(), []
    block = *np.zeros((4, 1000, 3)), *np.zeros((3, 1000))
    for first in range(0, 3000, 1000):
        one = TickBlock(np.arange(first, first + 1000.0), *block)
        comparison.update(one, replace(one, proxy=one.proxy + 1))
        sizes.append(len(pickle.dumps(comparison)))
    assert sizes[2] - sizes[0] < 100
    assert comparison.report()["spans"][0]["end_tick"] == 2999


def test_limits_hold_or_do_not():
    fixture, session = fixture_of(line()), probing()
    limits = (("force_max_n", "at_most", 3.9), ("clearance_min_m", "at_least", -1e-5))
    found = replay(fixture, session, limits=limits)
    assert found.metrics["checks"][0]["value"] == found.metrics["force_max_n"]
    assert verdict_sentence(found.metrics) == (
        "never beyond the drawn line; 1 of 2 limits broken: force_max_n at most 3.9 N; held: "
        "clearance_min_m at least -0.01 mm"
    )
    rounding = {"name": "clearance_min_m", "value": -6.9e-16}
    for bound, told in ((1e-3, "is 0 mm, "), (-1e-3, "is 0 mm, "), (0.0, "is -6.9e-13 mm, ")):
        assert told in check_text(rounding | {"at_least": bound})
    assert Number("clearance_min_m", "µm", 2).text(-6.9e-16) == "0.00"
    assert [Number("", "mJ", 3).text(j) for j in (0.0156, -1e-6)] == ["15.6", "-0.001"]
    for value, unit in ((None, "µm"), (-9e-4, "µm"), (606.8, "m"), (-2e-3, "m")):
        assert Number("clearance_min_m", "µm", 2).suiting(0.0, value).unit == unit
    with refuses(SettingError, "no-such-number") as refused:
        replay(fixture, session, limits=(("penetration_max_mm", "at_most", 1.0),))
    hint, names = str(refused.value).split(" Give one of ")
    assert hint.endswith("Did you mean penetration_max_m?")
    assert names.split(", ") == sorted(names.split(", "))


def test_robot_limits_are_counted():
    session = probing(seed=1)
    weak = Robot("weak", 1.0, 1.0, 1000.0, force_limit_n=2.0, force_step_limit_n=0.02)
    own = [("force_max_n", "at_most", 99.0)]
    found = replay(fixture_of(line()), session, robot=weak, limits=own)
    texts = [bound_text(check) for check in found.metrics["checks"]]
    assert texts == ["at most 99 N", "at most 2 N (robot weak)", "at most 0.02 N"]
    force = row_lengths(found.ticks.force)
    step = step_lengths(found.ticks.force)
    robot = found.metrics["robot"]
    assert robot["force_over_ticks"] == np.count_nonzero(force > 2.0)
    assert robot["force_step_over_ticks"] == np.count_nonzero(step > 0.02)
    assert "speed_over_ticks" not in robot
    assert [c["pass"] for c in found.metrics["checks"]] == [True, False, False]
    slow = Session(session.time[::10], session.hip[::10])
    assert "session-rate" in codes_of(replay(fixture_of(line()), slow, robot=weak))


def test_command_line_faults_and_limits(vfplan_cli, tmp_path):
    vfplan.write_fixture(fixture_of(line()), tmp_path / "f.h5")
    session = probing()
    np.savez(tmp_path / "s.npz", time=session.time, hip=1e3 * session.hip)
    call = ("replay", tmp_path / "f.h5", tmp_path / "s.npz", "--units", "mm", "--json")
    faults = ("--drop", "0.1", "--delay", "2", "--jitter", "0.5", "--quantise", "10", "--seed", "7")
    link = vfplan_cli(*call, *faults, "--rule", "both").sound.json["link"]
    expected = {"drop": 0.1, "delay_ticks": 2, "jitter_s": 5e-4, "quantum_m": 1e-5, "seed": 7}
    assert {name: link[name] for name in expected} == expected
    for wrong in (("--at-most", "force_max_n"), ("--drop", "1"), ("--at-most", "nothing=5")):
        assert vfplan_cli(*call, *wrong).code == 2
