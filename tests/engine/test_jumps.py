"""A bad sample of the tracker: it counts as no position, and the wall stays on its side."""

import numpy as np
import pytest
from motion import even

import vfplan
from vfplan import Status

LINE = np.stack([even(50e-3, 0.25e-3), *np.zeros((2, 401))], axis=1)
# Single samples: far beside the open end, in millimetres, round the end, just too far.
BAD = [(1.0, 0.0, 0.0), (20.0, -2.0, 0.0), (0.1, 5e-3, 0.0), (20e-3, -2.3e-2, 0.0)]


def pressed(rule):
    """An engine pressed 7 mm deep near one end of a line; the place of the hand."""
    engine = vfplan.ProxyEngine(LINE, rule=rule, band=5e-5, ignore_axis="z", max_hip_step=0.02)
    path = np.linspace([20e-3, 10e-3, 0], [20e-3, -2e-3, 0], 200)
    assert engine.run(path).force[-1] == pytest.approx([0, 7, 0], abs=0.1)
    return engine, path[-1]


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("rule", ["robust", "paper"])
def test_one_bad_sample_changes_nothing_for_good(rule, bad):
    engine, hip = pressed(rule)
    before = engine.step(hip)
    jump = engine.step(bad)
    assert jump.status == engine.status == Status.JUMPED
    assert np.array_equal([jump.force, jump.proxy], [before.force, before.proxy])
    after = engine.run(np.tile(hip, (500, 1)))
    assert not after.status.any()
    assert after.force == pytest.approx(np.tile(before.force, (500, 1)), abs=0.02)


def test_a_jump_holds_until_the_tip_is_back_or_the_engine_is_reset():
    engine, hip = pressed("robust")
    away = np.add(hip, [0.05, 0, 0])
    assert (engine.run(np.tile(away, (300, 1))).status == Status.JUMPED).all()
    assert engine.step([np.nan, 0, 0]).status == Status.BAD_HIP
    engine.reset(away)
    assert engine.step(away).status != Status.JUMPED
    engine.reset(away)
    assert engine.step(hip).status == Status.JUMPED, "a reset is a position too"
