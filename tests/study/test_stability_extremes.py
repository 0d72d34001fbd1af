"""The table of extreme cases holds, and the probes can tell right from wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vfplan.engine.parameters import Trace
from vfplan.study.extremes import TABLE, Extreme, chosen, try_extreme, try_group
from vfplan.study.extremes.ground import breach, patch

# Some seconds each; the command runs them.
SLOW = {"1e7 points", "1e6 points", "at rest for 1e7 ticks"}


@pytest.mark.parametrize(
    "case", [c for c in TABLE if not c.full and c.name not in SLOW], ids=lambda c: c.name
)
def test_case_comes_out_as_the_table_says(case):
    row = try_extreme(case)
    assert row.outcome == "pass", row.detail


@pytest.mark.full
@pytest.mark.parametrize("case", [c for c in TABLE if c.full], ids=lambda c: c.name)
def test_long_case(case):
    row = try_extreme(case)
    assert row.outcome == "pass", row.detail


def test_names_are_unique_and_every_group_has_its_module():
    names = [(case.group, case.name) for case in TABLE]
    assert len(set(names)) == len(names)


def test_a_wrong_value_an_unexpected_answer_and_an_unexpected_refusal_fail():
    wrong = Extreme("x", "cloud", "nothing", "press", {}, limit=-1.0)
    taken = Extreme("x", "cloud", "refused", "press", {}, limit=None, refusal=("SceneError",))
    refused = Extreme("x", "cloud", "taken", "blob", {"kind": "none"})
    assert [try_extreme(c).outcome for c in (wrong, taken, refused)] == ["fail"] * 3


def test_breach_sees_what_it_should():
    ground = patch()
    engine = ground.engine()
    proxy = np.array([[0.0, 4e-3, 0.0], [0.0, 6e-3, 0.0]])
    state = np.zeros(2, np.int8)
    trace = Trace(proxy, proxy, proxy, state, state.astype(np.uint8))
    expected = 5e-3 - engine.parameters.band - 4e-3
    assert breach(engine, ground, trace) == pytest.approx(expected)
    untouched = Trace(proxy, proxy, 0 * proxy, state, state.astype(np.uint8))
    assert breach(engine, ground, untouched) == np.inf


def test_what_a_bundle_cannot_meet_is_left_out():
    from bundles import whole

    groups, out = chosen(whole(), full=False)
    assert set(groups) == {"hip"}
    assert {"extreme/setting", "extreme/cloud"} <= set(out)


def test_the_long_run_takes_the_bundles_own_points():
    from bundles import whole

    cases, left_out = chosen(fixture := whole(), full=True)
    assert "extreme/long" not in left_out
    short = replace(cases["long"][0], args={"ticks": 200_000})
    [row] = try_group([short], fixture)
    assert (row.outcome, row.measured) == ("pass", 0.0), row.detail
