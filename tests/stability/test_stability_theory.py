"""The exact discretisation and the bounds on K, against mpmath and closed forms."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest

from vfplan.errors import SettingError
from vfplan.robot import Robot
from vfplan.stability import loop
from vfplan.stability.loop import exact_bound, linear_bound, transition

# Mass, damping, rate, stiffness of the hand.
PLANTS = [(1.0, 5.0, 1e3, 0.0), (1.0, 5.0, 1e3, 2000.0), (0.05, 80.0, 100.0, 0.0),
          (20.0, 1e-6, 1e5, 0.0), (1.0, 0.0, 1e3, 0.0)]  # fmt: skip


def robot_of(mass=1.0, damping=5.0, rate=1e3, delay=0):
    return Robot("r", mass, damping, rate, delay)


def exact_transition(mass, damping, rate, hand):
    """The same motion in 50 digits, from the state matrix itself."""
    with mpmath.workdps(50):
        m, b, k, t = map(mpmath.mpf, (mass, damping, hand, 1 / rate))
        rate = mpmath.matrix([[0, 1, 0], [-k / m, -b / m, 1 / m], [0, 0, 0]])
        moved = mpmath.expm(rate * t)
        return np.array([[float(moved[i, j]) for j in (1, 2)] for i in (0, 1)])


@pytest.mark.parametrize("plant", PLANTS, ids=str)
def test_transition_is_exact(plant):
    moved = transition(robot_of(*plant[:3]), plant[3])
    np.testing.assert_allclose(moved, exact_transition(*plant), rtol=1e-14)


@pytest.mark.parametrize("damping, delay, bound", [
    (5, 0, 10_008), (5, 1, 3_338), (20, 0, 40_134), (20, 1, 13_407), (1, 0, 2_000),
    (1, 1, 667)])  # fmt: skip
def test_bounds_known_from_the_literature(damping, delay, bound):
    robot = robot_of(damping=damping, delay=delay)
    assert exact_bound(robot) == pytest.approx(bound, rel=2.5e-4)
    assert linear_bound(robot) == pytest.approx(damping / (1e-3 * (0.5 + delay)))


def test_exact_bound_without_delay_in_closed_form():
    # Jury's criterion for z² + (xf K - 1 - E) z + E + K (vf xv - xf vv): the last is 1 at the edge.
    robot = robot_of(0.7, 9.0, 1 / 1.5e-3)
    (xv, xf), (vv, vf) = transition(robot)
    assert exact_bound(robot) == pytest.approx((1 - vv) / (vf * xv - xf * vv), rel=1e-9)


def test_the_exact_bound_is_where_a_root_of_the_loop_leaves_the_unit_circle():
    """40 robots with delay and filter, against the roots of the loop's transfer function."""
    rng = np.random.default_rng(3)
    for _ in range(40):
        m, b, rate = rng.uniform(0.3, 4), rng.uniform(2, 60), rng.uniform(500, 4000)
        robot = Robot("r", m, b, rate, int(rng.integers(0, 4)), filter_hz=rng.uniform(30, 400))
        edge = exact_bound(robot)

        # m x'' + b x' = F with F held; y += share (F - y); d ticks of delay.
        t, e = 1 / rate, np.exp(-b / rate / m)
        share = t / (t + 1 / (2 * np.pi * robot.filter_hz))
        h = [t / b - m / b**2 * (1 - e), m / b**2 * (1 - e) - t / b * e]
        loop_poles = np.poly([1, e, 1 - share, *[0] * robot.delay_ticks])
        zeros = np.append(h, 0) * share
        for factor, is_inside in ((1 - 1e-5, True), (1 + 1e-5, False)):
            roots = np.roots(np.polyadd(loop_poles, factor * edge * zeros))
            assert (np.abs(roots).max() < 1) == is_inside


def test_a_filter_of_100_hz_halves_the_bound_and_0_is_none():
    robot = Robot("r", 1.0, 5.0, 1000.0, 1, filter_hz=100.0)
    assert exact_bound(robot) == pytest.approx(1629, abs=1)
    none, zero = (replace(robot, filter_hz=cutoff) for cutoff in (None, 0.0))
    assert exact_bound(none) == exact_bound(zero) == pytest.approx(3338, abs=1)


@pytest.mark.parametrize("damping", [1e-2, 5.0, 500.0, 1e3, 2e3, 1e4, 1e7])
def test_the_slowest_filter_leaves_a_bound_to_a_mass_that_a_hand_holds(damping):
    robot = replace(robot_of(damping=damping), filter_hz=loop.MIN_FILTER * min(damping, 1e3))
    # Of short ticks it is 1 / (1 - 1 / pi) times as large, and most at a decay of 2.
    assert exact_bound(robot, 0.2) < 7 * exact_bound(robot)


def test_no_damping_no_stable_spring():
    robot = robot_of(damping=0.0)
    assert exact_bound(robot) == 0.0
    assert loop.spectral_radius(robot, 1.0) >= 1.0


@pytest.mark.parametrize("wrong",
    [{"damping": 1e-12}, {"mass": 1e12}, {"mass": 1e-300}, {"damping": 1e300}])  # fmt: skip
def test_a_decay_that_float64_cannot_tell_is_refused(wrong):
    with pytest.raises(SettingError) as caught:
        exact_bound(robot_of(**wrong))
    [decay] = caught.value.numbers.values()
    assert not loop.MIN_DECAY <= decay <= loop.MAX_DECAY


@pytest.mark.parametrize("edge", [{"damping": 1.01e-6}, {"mass": 4.9e6}, {"mass": 1e-14}])
def test_exact_bound_holds_up_to_the_edges_of_what_is_allowed(edge):
    robot = robot_of(**edge)
    assert exact_bound(robot) == pytest.approx(linear_bound(robot), rel=3e-4)
