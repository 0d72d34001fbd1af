"""Every failure of the paper's rule: shown for "paper", cured for "robust"."""

import failures
import pytest

BAND = 1e3 * 12.6e-6  # the default band of these clouds at 0.5 mm [mm]

# scene, its settings, what is measured, at least for "paper", at most for "robust"
CASES = [
    (failures.lift_off, (), "pull-back after 60 mm of lift [N]", 49.9, 1e-9),
    (failures.corner, (), "inside the other wall [mm]", 3.2, BAND),
    (failures.press_through, (0.5, 50.0), "inside at 0.5 m/s, 50 Hz [mm]", 0.29, BAND),
    (failures.press_through, (1.0, 50.0), "inside at 1 m/s, 50 Hz [mm]", 4.85, BAND),
    (failures.press_through, (10.0, 1000.0), "inside at 10 m/s, 1000 Hz [mm]", 0.29, BAND),
    (failures.point_radius, (6e-3,), "false drag at r_v = 6 mm [N]", 31.0, 1e-3),
    (failures.point_radius, (10e-3,), "false drag at r_v = 10 mm [N]", 31.0, 1e-3),
    (failures.channel, (), "inside in the channel [mm]", 3.0, BAND),
    (failures.channel, (), "ticks inside", 200, 0),
    (failures.coarse, (4e-3,), "inside at spacing 4 mm [mm]", 0.05, 0.9),
    (failures.coarse, (8e-3,), "inside at spacing 8 mm [mm]", 1.5, 0.0101),
]


@pytest.mark.parametrize(("scene", "settings", "what", "fails", "holds"), CASES)
def test_paper_fails_and_robust_holds(scene, settings, what, fails, holds):
    assert scene("paper", *settings)[what] >= fails
    assert scene("robust", *settings)[what] <= holds


def test_one_kilohertz_is_enough_for_paper_below_ten_metres_a_second():
    """The sweep that `paper` lacks is not missed at the speeds of a hand."""
    assert failures.press_through("paper", 2.0, 1000.0)["inside at 2 m/s, 1000 Hz [mm]"] < 1e-6


@pytest.mark.parametrize("rule", ["paper", "robust"])
def test_gaps_wider_than_the_proxy_let_it_through(rule):
    """No rule closes a sheet whose spacing exceeds sqrt(2) R; the planner's bound must."""
    lowest = "lowest proxy at spacing 8 mm [mm]"
    assert failures.coarse(rule, 8e-3)[lowest] < -4.0
    assert failures.coarse(rule, 4e-3)["lowest proxy at spacing 4 mm [mm]"] > 4.0
