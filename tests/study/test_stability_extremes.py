"""The table of extreme cases holds, and the probes can tell right from wrong."""

from __future__ import annotations

from dataclasses import replace

import mpmath
import numpy as np
import pytest

from vfplan import ProxyEngine
from vfplan.engine.parameters import Trace
from vfplan.stability.precision import paper_tick, precision
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
    assert {"extreme/image", "extreme/markers", "extreme/cloud"} <= set(out)


def test_precision_rows_pass():
    for row in precision(count=60):
        assert row.outcome == "pass", row.detail


def test_ticks_agree_with_mpmath():
    """The tick of `paper_tick` in mpmath: another arithmetic than the command's."""
    rng = np.random.default_rng(4)
    worst = 0.0
    with mpmath.workdps(40):

        def exact(x):
            return [mpmath.mpf(float(c)) for c in x]

        for _ in range(100):
            points = rng.normal(size=(8, 3))
            points *= (
                5e-3 * rng.choice([0.9, 1.0, 1.3], (8, 1)) / np.linalg.norm(points, axis=1)[:, None]
            )
            hip = rng.normal(size=3) * 3e-3
            engine = ProxyEngine(points, rule="paper")
            engine.reset(np.zeros(3))
            found = engine.step(hip).proxy
            cloud = [exact(p) for p in points]
            tick = paper_tick(cloud, exact(np.zeros(3)), exact(hip), engine.parameters, mpmath.mpf)
            worst = max(
                worst, *(abs(float(a - b)) for a, b in zip(exact(found), tick, strict=True))
            )
    assert worst < 200 * np.spacing(5e-3)


def test_the_long_run_takes_the_bundles_own_points():
    from bundles import whole

    cases, left_out = chosen(fixture := whole(), full=True)
    assert "extreme/long" not in left_out
    short = replace(cases["long"][0], args={"ticks": 200_000})
    [row] = try_group([short], fixture)
    assert (row.outcome, row.measured) == ("pass", 0.0), row.detail
