"""A replay along a guide: lateral error over arc length, time outside, work; beside a region."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from replays import at_1_khz, fixture_of, line, write_session

import vfplan
from vfplan.errors import SceneError
from vfplan.fixture import Curve, Guidance, Pieces
from vfplan.replaying.link import Link
from vfplan.replaying.replay import replay

K, RHO = 1000.0, 1e-3
BOTH = np.vstack([line(), np.add(line(), [0, 5.5e-3, 0])])


def guided(fixture, **how):
    return replace(fixture, guidance=Guidance(RHO, K, **how))


def along(y, x=None):
    """A hand that goes along x, `y` (T,) [m] beside it."""
    x = np.linspace(0.01, 0.09, len(y)) if x is None else x
    return at_1_khz(np.column_stack([x, y, 0 * y]))


def test_lateral_error_force_and_work_are_those_of_the_closed_form():
    y = 3e-3 * np.sin(np.linspace(0, 4 * np.pi, 4000)) ** 2
    found = replay(guided(fixture_of(line())), along(y))
    m, guide = found.metrics, found.metrics["guide"]
    force = K * np.maximum(y - RHO, 0)
    assert np.abs(found.ticks.force[:, 1] + force).max() < 1e-9
    assert m["lateral_max_m"] == pytest.approx(y.max(), abs=1e-12)
    assert m["arc_m"] == pytest.approx([0.01, 0.09], abs=1e-9)
    assert guide["outside_ticks"] == int((y > RHO).sum())
    assert guide["outside_s"] == pytest.approx((y > RHO).sum() * 1e-3, rel=1e-3)
    assert guide["work_j"] == pytest.approx(m["energy_j"], abs=1e-12)
    assert m["force_max_n"] == pytest.approx(2.0, abs=1e-4)
    assert m["states"] == {"-1": 0, "0": int((y <= RHO).sum()), "1": int((y > RHO).sum()), "2": 0}
    assert not {"clearance_min_m", "overlap_max_m", "entrenched_ticks"} & m.keys()
    assert m["left_out"]["region"] == 1
    profile = guide["profile"]
    seen = [(a, v) for a, v in zip(profile["arc_m"], profile["lateral_m"], strict=True) if v]
    assert len(seen) > 350
    assert max(v for _, v in seen) == pytest.approx(y.max(), abs=1e-12)


def test_behind_a_lossy_link_every_tick_counts():
    session = along(np.linspace(0, 3e-3, 4000))
    m = replay(guided(fixture_of(line())), session, link=Link(drop=0.2)).metrics
    assert (m["guide"]["held_ticks"], m["guide"]["outside_ticks"]) == (4000, m["contact_ticks"])


def test_before_the_tip_is_in_the_tube_there_is_no_force():
    y = np.r_[np.linspace(0.03, 0, 1000), np.linspace(0, 2e-3, 500)]
    found = replay(guided(fixture_of(line())), along(y))
    assert not found.ticks.force[:1000].any()
    assert found.metrics["guide"]["held_ticks"] == int((np.abs(y) <= RHO).argmax() * -1 + 1500)
    assert found.metrics["force_max_n"] == pytest.approx(1.0)
    away = replay(guided(fixture_of(line())), along(np.full(100, 0.03))).metrics
    assert (away["arc_m"], away["guide"]["held_ticks"]) == (None, 0)


STRAIGHT = Pieces(BOTH[[0, 199, 200, 399]], np.zeros(4), np.repeat([0, 1], 2).astype(np.int32),
                  np.zeros(2, bool))  # fmt: skip


def beside(pieces):
    """A guide 5.5 mm beside what is forbidden, a hand between them, and its forces along y.

    The tube reaches 0.5 mm into the region.
    """
    curve = Curve(np.repeat([0, 1], 200).astype(np.int32), np.zeros(2, bool), pieces=pieces)
    y = np.r_[np.linspace(6e-3, 8e-3, 500), np.linspace(8e-3, 4e-3, 1000)]
    force = K * (np.maximum(5e-3 - y, 0) + np.maximum(4.5e-3 - y, 0) - np.maximum(y - 6.5e-3, 0))
    fixture = guided(replace(fixture_of(BOTH), curve=curve), stroke=1)
    return fixture, along(y, np.full(1500, 0.05)), force


@pytest.mark.parametrize("pieces", [None, STRAIGHT])
def test_forces_of_region_and_guide_add_and_both_are_reported(pieces):
    """Of points, or of two straight pieces: to a rounding, with the clearance of the line."""
    fixture, session, force = beside(pieces)
    found = replay(fixture, session)
    assert np.abs(found.ticks.force[:, 1] - force).max() < (1e-6 if pieces else 0.02)
    guide = found.metrics["guide"]
    assert guide["force_max_n"] == pytest.approx(1.5, abs=1e-6)
    assert (guide["region_force_max_n"], guide["strokes"]) == (pytest.approx(1.0, abs=0.02), [1])
    assert found.metrics["clearance_min_m"] > -2e-5
    if pieces:
        assert (found.metrics["rule"], found.metrics["scene"]["lines_and_arcs"]) == ("exact", 1)
        assert abs(found.metrics["clearance_min_m"]) < 1e-9
    paper = replay(fixture, session, rule="paper", engine="reference")
    assert np.abs(paper.ticks.force - found.ticks.force).max() < 0.05


@pytest.mark.parametrize("far, told", [
    (0.0, "tube of 1.000 mm: up to 3.000 mm from"), (9.0, "never had hold of the tip\n"),
])  # fmt: skip
def test_the_command_reports_it(vfplan_cli, tmp_path, far, told):
    vfplan.write_fixture(guided(fixture_of(line())), tmp_path / "guide.h5")
    write_session(tmp_path / "s.csv", along(far + 3e-3 * np.sin(np.linspace(0, 6, 600))))
    run = vfplan_cli("replay", tmp_path / "guide.h5", tmp_path / "s.csv")
    assert re.search(f"^guide: 600 ticks .*\nguide        {told}", run.stdout, re.S | re.M)


def test_a_guide_is_never_rendered_as_a_forbidden_region():
    with pytest.raises(SceneError, match="the fixture guides"):
        vfplan.ProxyEngine.of(guided(fixture_of(line())))
