"""Every failure of the paper's rule: shown for "paper", cured for "robust"."""

import failures
import pytest


@pytest.mark.parametrize("scene, settings, what, fails, holds", failures.CASES)
def test_paper_fails_and_robust_holds(scene, settings, what, fails, holds):
    assert scene("paper", *settings)[what] >= fails
    assert scene("robust", *settings)[what] <= holds


def test_one_kilohertz_is_enough_for_paper_below_ten_metres_a_second():
    """The sweep that `paper` lacks is not missed at the speeds of a hand."""
    assert failures.press_through("paper", 2.0, 1000.0)["inside at 2 m/s, 1000 Hz [mm]"] < 1e-6


@pytest.mark.parametrize("rule", ["paper", "robust"])
def test_gaps_wider_than_the_proxy_let_it_through(rule):
    """No rule closes a sheet whose spacing exceeds sqrt(2) R; the planner's bound must."""
    assert failures.coarse(rule, 8e-3)["lowest proxy at spacing 8 mm [mm]"] < -4.0
    assert failures.coarse(rule, 4e-3)["lowest proxy at spacing 4 mm [mm]"] > 4.0
