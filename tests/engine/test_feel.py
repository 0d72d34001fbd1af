"""The study of force steps: its truth against the god-object, its hand, and what rules do."""

import feel
import numpy as np
import pytest

WAVE = feel.Wave()
HIPS = WAVE.hand(16.0, feel.R, np.random.default_rng(0))
EXACT = WAVE.exact(HIPS, feel.R)


def test_the_closed_form_is_what_a_god_object_slides_to():
    for begin in (1000, 9000):
        some = slice(begin, begin + 150, 3)
        slid = WAVE.truth(HIPS[some], feel.R, start=EXACT[begin])
        assert slid == pytest.approx(EXACT[some], abs=1e-9)


def test_force_steps_are_counted_where_the_exact_proxy_makes_none():
    proxy = EXACT.copy()
    proxy[500:, 0] += 0.7e-3
    proxy[900:, 1] -= 2.1e-3
    trace = feel.Trace(proxy, proxy, proxy, np.zeros(len(HIPS)), np.zeros(len(HIPS), np.uint8))
    more = feel.judge(trace, HIPS, EXACT)
    assert (more["force_jumps"], more["force_jumps_large"]) == (2, 1)
    assert more["force_step_max_n"] == pytest.approx(2.1)


def test_neither_exact_nor_robust_steps_on_an_even_curve():
    _, records = next(feel.scenes(16.0))
    for method, near in (("exact", 1e-8), ("robust", 5e-5)):
        errors = records[method]
        assert errors["force_jumps"] == 0
        assert errors["limit_share"] < 0.01
        assert errors["error_rms"] < near
