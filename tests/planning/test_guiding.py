"""A planned curve as a guide: what a plan makes of it, refuses, and says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bundles import stored
from conftest import ELBOW
from motion import unit_circle
from refusals import refuses
from replays import fixture_of

import vfplan
from vfplan.errors import CheckFailed, SettingError
from vfplan.fixture import Curve, Guidance
from vfplan.planning.match import Record
from vfplan.planning.plan import add_guidance, plan
from vfplan.planning.settings import FixtureSettings
from vfplan.robot import Robot


def two_lines(apart, other=None):
    """Two strokes along x [m]; the second is another line where one is given."""
    x = np.arange(0, 0.1, 0.5e-3)
    one = np.column_stack([x, 0 * x, 0 * x])
    two = np.add(one, [0, apart, 0]) if other is None else other
    curve = Curve(np.repeat([0, 1], [len(one), len(two)]).astype(np.int32), np.zeros(2, bool))
    return replace(fixture_of(np.vstack([one, two])), curve=curve)


def test_a_plan_guides_along_the_drawn_curve(tmp_path):
    made = plan(*ELBOW, settings=FixtureSettings(guide_m=1e-3, guide_ends="open"))
    assert made.fixture.guidance == Guidance(1e-3, 1000.0, "open", None)
    assert made.registered.report["guide"]["radius_m"] == 1e-3
    assert made.registered.report["guide"]["lengths_m"] == pytest.approx([0.4158], rel=1e-3)
    read = vfplan.read_fixture(stored(tmp_path / "guide.h5", made.fixture))
    assert read.guidance == made.fixture.guidance
    assert len(read.forbidden) == 0
    guide = vfplan.Guide.of(read)
    assert guide.lengths_m == made.registered.report["guide"]["lengths_m"]


def test_one_stroke_guides_beside_the_one_that_is_forbidden():
    settings = FixtureSettings(guide_m=1e-3, guide_stroke=1)
    record = Record()
    fixture = add_guidance(two_lines(0.02), settings, record)
    assert (fixture.forbidden[:, 1] == 0).all()
    assert record.report["guide"]["clearance_min_m"] == pytest.approx(0.015, abs=1e-5)
    assert not record.findings
    add_guidance(two_lines(5.5e-3), settings, record)
    assert [finding.code for finding in record.findings] == ["guide-in-forbidden"]


def test_a_guide_that_leads_into_the_forbidden_region_is_refused_with_the_place():
    x = np.arange(0, 0.1, 0.5e-3)
    slope = np.column_stack([x, 0.02 - 0.18 * x, 0 * x])  # 5 mm near at x = 82 mm
    with pytest.raises(CheckFailed, match=r"at arc 10\d.* mm, \[99.5, 2.09"):
        add_guidance(two_lines(0, slope), FixtureSettings(guide_m=1e-3, guide_stroke=1), Record())


def test_a_pull_along_the_curve_is_in_the_bundle(tmp_path):
    settings = FixtureSettings(guide_m=1e-3, guide_stroke=1, guide_pull=(2.0, 0.03))
    fixture = add_guidance(two_lines(0.02), settings, Record())
    led = vfplan.read_fixture(stored(tmp_path / "led.h5", fixture))
    guide = vfplan.Guide.of(led, hold="at_once")
    assert guide.run(np.tile([0.05, 0.02, 0], (1000, 1))).force[-1] == pytest.approx([2.0, 0, 0])


def test_a_closed_guide_has_no_ends():
    base = two_lines(0.02)
    closed = replace(base, curve=replace(base.curve, closed=np.array([False, True])))
    with pytest.raises(SettingError, match="closed curve has no ends"):
        add_guidance(closed, FixtureSettings(guide_m=1e-3, guide_stroke=1, guide_ends="open"),
                     Record())  # fmt: skip


def test_a_bend_tighter_than_the_tube_is_refused_unless_it_may_be_cut():
    x = np.arange(0, 0.05, 0.5e-3)
    bent = np.column_stack([x, 0.02 + np.abs(x - 0.025), 0 * x])
    settings = {"guide_m": 3e-3, "guide_stroke": 1}
    with pytest.raises(SettingError, match=r"mm fit the bends, .* at arc 3\d"):
        add_guidance(two_lines(0, bent), FixtureSettings(**settings), Record())
    cutting = FixtureSettings(**settings, guide_cut_bends=True)
    record = Record()
    add_guidance(two_lines(0, bent), cutting, record)
    assert "guide-tight-bend" in [finding.code for finding in record.findings]


@pytest.mark.parametrize("change, says", [
    ({"guide_m": 0.05}, "radius 50 mm: at most .* fit"),
    ({"guide_stroke": 2}, "guide stroke 2 "),
    ({"guide_stroke": -1}, "guide stroke -1 "),
])  # fmt: skip
def test_what_cannot_guide_is_refused(change, says):
    settings = FixtureSettings(**({"guide_m": 1e-3} | change))
    turn = np.linspace(0, 2 * np.pi, 200)
    ring = 0.03 * unit_circle(turn)
    with pytest.raises(SettingError, match=says):
        add_guidance(two_lines(0, ring), settings, Record())


def test_a_pull_that_the_robot_cannot_give_is_warned_of():
    from vfplan.stability.study import strong_pull

    settings = FixtureSettings(guide_m=1e-3, guide_stroke=1, guide_pull=(-25.0,))
    fixture = add_guidance(two_lines(0.02), settings, Record())
    weak = Robot("weak", 1.0, 1.0, 1000.0, force_limit_n=20.0)
    (finding,) = strong_pull(fixture, weak)
    assert (finding.code, finding.severity, finding.stage) == ("guide-pull-strong", "doubt", "plan")
    assert not strong_pull(fixture, replace(weak, force_limit_n=25.0))
    assert not strong_pull(fixture, replace(weak, force_limit_n=None))


def test_lines_and_arcs_guide_and_ticks_too_long_are_warned_of(monkeypatch):
    monkeypatch.setattr("vfplan.engine.proxy.MAX_TICK_TIME", 1e-6)
    made = plan(*ELBOW, settings=FixtureSettings(guide_m=1e-3))
    assert made.fixture.pieces.error < 2e-6
    guide = vfplan.Guide.of(made.fixture, hold="at_once")
    on = made.fixture.points @ np.diag([1.0, 1, 0])
    assert np.abs(guide.run(on).lateral_m).max() < 5e-6
    assert "tick-too-long" in [finding.code for finding in made.findings]
    with refuses(SettingError, "arcs-coarse") as refused:
        plan(*ELBOW, settings=FixtureSettings(guide_m=1e-4, arcs_m=5e-5))
    assert "allows 5 % of that. Give --arcs 0.0047 or less" in str(refused.value)
    with refuses(SettingError, "guide-stroke"):
        add_guidance(made.fixture, FixtureSettings(guide_m=1e-3, guide_stroke=0), Record())
