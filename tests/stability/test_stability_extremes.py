"""The extreme motions of `vfplan stability` come out, and can tell right from wrong."""

import resource
import time
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from bundles import whole
from replays import of_lines

from vfplan import Trace
from vfplan.stability import cases
from vfplan.stability.cases import CASES, breach, run_extreme_cases
from vfplan.stability.closed_loop import engine_for
from vfplan.stability.contacts import patch

SLOW = {"hip/at rest for 1e7 ticks"}  # some seconds; the command runs it


def bay():
    """An open curve of 0.35 m, around whose ends a proxy reaches the far side within a tick."""
    t = np.linspace(0, 1, 900)
    x, y = 0.375 + 0.3 * t, -0.05 - 0.06 * np.sin(4 * t)
    return of_lines(np.column_stack([x, y, 0.02 + 0 * t]))


@pytest.mark.parametrize("on", [None, whole(), bay()], ids=["patch", "bundle", "open curve"])
@pytest.mark.parametrize("case", [c for c in CASES if not c.full and c.name not in SLOW],
    ids=lambda c: c.name)  # fmt: skip
def test_case_comes_out_as_the_table_says(case, on):
    [row] = run_extreme_cases([case], on)
    assert row.outcome == "pass", row.detail


@pytest.mark.full
def test_long_cases_need_no_more_time_or_memory_in_the_end():
    times, memory = [], []
    walk = partial(cases.breach_by_long_walk, ticks=5_000_000)
    for _ in range(4):
        started = time.thread_time()
        [row] = run_extreme_cases([replace(CASES[-1], measure=walk)])
        assert row.measured == 0
        times.append(time.thread_time() - started)
        memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    assert times[-1] < 1.5 * times[0]
    assert memory[-1] - memory[0] < 4000  # [kB]
    for row in run_extreme_cases([c for c in CASES if c.full or c.name in SLOW]):
        assert row.outcome == "pass", row.detail


def test_a_figure_beyond_the_limit_and_none_fail():
    wrong = [
        cases.ExtremeCase("x", "nothing", lambda place, engine, v=v: v) for v in (1.0, float("nan"))
    ]
    assert [row.outcome for row in run_extreme_cases(wrong)] == ["fail", "fail"]


def test_breach_sees_what_it_should():
    engine = engine_for(patch(), "robust")
    proxy, state = np.array([[0.0, 4e-3, 0.0], [0.0, 6e-3, 0.0]]), np.zeros(2, np.int8)
    trace = Trace(proxy, proxy, proxy, state, state.astype(np.uint8))
    expected = 5e-3 - engine.parameters.band - 4e-3
    assert breach(engine, trace) == pytest.approx(expected)
    untouched = Trace(proxy, proxy, 0 * proxy, state, state.astype(np.uint8))
    assert breach(engine, untouched) == np.inf


def test_the_long_run_takes_the_bundles_own_points():
    short = partial(cases.breach_by_long_walk, ticks=200_000)
    [row] = run_extreme_cases([replace(CASES[-1], measure=short)], whole())
    assert (row.outcome, row.measured) == ("pass", 0.0), row.detail
