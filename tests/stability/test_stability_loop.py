"""The closed loop against closed forms, each stage alone, and the largest stable K."""

from dataclasses import replace

import numpy as np
import pytest
from bundles import whole

from vfplan import Status, Step
from vfplan.geometry.lines import row_lengths, step_lengths
from vfplan.robot import Robot
from vfplan.stability import loop
from vfplan.stability.closed_loop import blow_case, engine_for, largest_stiffness, press, strike
from vfplan.stability.contacts import contacts_along, patch
from vfplan.stability.loop import FlatWall, SimulatedHand, exact_bound, simulate

ROBOT, NONE = Robot("test", 1.0, 5.0, 1000.0), SimulatedHand(np.zeros(3))


class Spring:
    """A linear, two-sided spring to the origin along y: what theory knows all about."""

    def reset(self, hip):
        pass

    def step(self, hip):
        proxy = np.array([hip[0], 0.0, hip[2]])
        return Step(proxy, np.array([0.0, 1.0, 0.0]), proxy - hip, 1, Status.OK)


@pytest.mark.parametrize("filter_hz", [None, 80.0])
@pytest.mark.parametrize("delay", [0, 1, 4])
def test_linear_loop_is_the_matrix_power(delay, filter_hz):
    robot = replace(ROBOT, delay_ticks=delay, filter_hz=filter_hz)
    motion = simulate(Spring(), robot, NONE, 3000.0, np.array([0, 1e-3, 0]), np.zeros(3), 200)
    one = loop.loop_matrix(robot, 3000.0)
    state = np.zeros(len(one))
    state[0] = state[2 : 2 + delay] = 1e-3  # the force was what it is at the first tick
    if filter_hz is not None:
        state[-1] = -3000.0 * 1e-3
    expected = [(np.linalg.matrix_power(one, k) @ state)[0] for k in range(200)]
    np.testing.assert_allclose(motion.x[:, 1], expected, rtol=0, atol=1e-13)


def test_energy_is_kept_to_second_order_without_damping_or_wall():
    hand = SimulatedHand(np.zeros(3), 100.0)
    free = replace(ROBOT, damping_n_s_per_m=0.0)
    motion = simulate(Spring(), free, hand, 0.0, np.array([1e-2, 0, 0]), np.zeros(3), 3000)
    np.testing.assert_allclose(motion.energy, motion.energy[0], rtol=1e-12)


def test_friction_with_damping_in_closed_form():
    robot = replace(ROBOT, friction_n=2.0)
    motion = simulate(Spring(), robot, NONE, 0.0, np.zeros(3), np.array([0.3, 0, -0.1]), 400)
    # m v' = -b v - f: stops after (m/b) ln(1 + b v0 / f), at m v0/b - (m f/b²) ln(1 + b v0 / f)
    stops = [v / 5 - 2 / 25 * np.log(1 + 5 * v / 2) for v in (0.3, 0.1)]
    assert motion.x[-1] == pytest.approx([stops[0], 0, -stops[1]], rel=1e-12)
    assert (motion.x[-1] == motion.x[-2]).all()


def test_quantum_limits_and_counts():
    push, start = SimulatedHand(np.array([0, -4.0, 0])), np.array([0, 1e-3, 0])
    robot = replace(ROBOT, quantum_m=1e-4, force_limit_n=1.0, force_step_limit_n=0.25)
    motion = simulate(Spring(), robot, push, 1000.0, start, np.zeros(3), 300)
    assert np.abs(motion.held_force).max() <= 1.0 + 1e-12
    assert step_lengths(motion.held_force).max() <= 0.25 + 1e-12
    assert motion.limited_ticks > 0
    plain = simulate(Spring(), ROBOT, push, 1000.0, start, np.zeros(3), 300)
    assert plain.limited_ticks is None
    coarse = replace(ROBOT, quantum_m=1e-4)
    quantum = simulate(Spring(), coarse, push, 1000.0, start, np.zeros(3), 300)
    steps = quantum.held_force[:, 1] / 0.1
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)


def test_a_jittered_delay_lies_between_its_ends():
    start = np.array([0, 1e-3, 0])
    robots = [
        replace(ROBOT, delay_ticks=d, delay_jitter_ticks=j) for d, j in ((0, 0), (0, 2), (2, 0))
    ]
    energies = [simulate(Spring(), robot, NONE, 1000.0, start, np.zeros(3), 400).energy[-1]
                for robot in robots]  # fmt: skip
    assert energies[0] < energies[1] < energies[2]


def test_hard_blows_find_what_light_ones_miss():
    """The limit of a change of force makes the loop ring, though its linear bound is 20 kN/m."""
    panda = Robot("p", 1.0, 30.0, 1000.0, 1, force_limit_n=20.0, force_step_limit_n=1.2)
    [case] = blow_case(panda, 16_000.0, 1.25)
    assert [blow["rests"] for blow in case.values["blows"]] == [True, False, False]
    assert case.outcome == "fail"
    found = case.measured / 1.25
    [below] = blow_case(panda, 0.95 * found, 1.25)
    assert (below.outcome, below.measured) == ("pass", None)
    ringing = simulate(FlatWall(), panda, SimulatedHand(np.array([0, -10.0, 0])), 1.05 * found,
                       np.zeros(3), np.array([0, -0.3, 0]), 8000)  # fmt: skip
    assert np.ptp(ringing.x[-1000:, 1]) > 1e-3


@pytest.mark.full
def test_of_200_robots_none_that_passes_rings_and_each_beyond_its_bound_does():
    """At a blow that the verdict does not strike."""
    rng, passed = np.random.default_rng(8), 0
    while passed < 200:
        m, b, delay = rng.uniform(0.5, 2), rng.uniform(5, 40), int(rng.integers(0, 3))
        step, cutoff = rng.choice([None, 1.2]), rng.choice([0.0, 100.0])
        robot = Robot("any", m, b, 1000.0, delay, filter_hz=cutoff, force_step_limit_n=step)
        bound = exact_bound(robot)
        assert not strike(robot, 1.3 * bound, 0.2)["rests"]
        stiffness = bound * rng.uniform(0.05, 0.8)
        if blow_case(robot, stiffness, 1.25)[0].outcome == "pass":
            passed += 1
            decay = -np.log(loop.spectral_radius(robot, stiffness))
            assert strike(robot, stiffness, 0.2)["rings_s"] <= np.log(20) / decay / 1000 + 2.0


def test_a_blow_rests_when_the_linear_loop_does():
    """Within its limits the robot is linear: the time to rest follows from the largest root."""
    robot = replace(ROBOT, delay_ticks=1)
    blow = strike(robot, 1000.0, 0.0)
    decay = -np.log(loop.spectral_radius(robot, 1000.0))
    assert blow["rings_s"] == pytest.approx(np.log(20) / decay / 1000, rel=0.1)


ROBOTS = [
    *((5.0, 1000.0, delay) for delay in (0, 2)),
    *(pytest.param(*robot, delay, marks=pytest.mark.full)
      for robot in ((2.0, 500.0), (5.0, 1000.0), (10.0, 2000.0), (40.0, 2000.0), (50.0, 8000.0))
      for delay in (0, 1, 3)),
]  # fmt: skip


@pytest.mark.parametrize("rule", ["robust", "paper"])
@pytest.mark.parametrize("damping, rate, delay", ROBOTS)
def test_flat_wall_meets_the_exact_bound_within_two_percent(rule, damping, rate, delay):
    robot = Robot("any", 1.0, damping, rate, delay)
    measured, exact = largest_stiffness(patch(), robot, engine_for(patch(), rule))
    assert exact == exact_bound(robot)
    assert abs(measured / exact - 1) < 0.02


def test_press_is_the_second_order_step_response():
    found = press(patch(), ROBOT, engine_for(patch(), "robust"), 1000.0)
    # zeta = (b - K T/2) / (2 sqrt(m K)), overshoot exp(-pi zeta / sqrt(1 - zeta²))
    zeta = (5 - 0.5) / (2 * np.sqrt(1000.0))
    overshoot = np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2))
    assert found["overshoot"] == pytest.approx(overshoot, abs=0.02)
    assert found["rest_s"] == pytest.approx(np.log(20) / (zeta * np.sqrt(1000.0)), rel=0.1)
    assert found["limit_cycle_m"] < 2e-6


def test_along_presses_on_both_sides_of_a_planar_curve():
    elbow = whole()
    places = list(contacts_along(elbow, 3))
    assert len(places) >= 4
    for place in places:
        clear = row_lengths(elbow.points - place.touch).min()
        assert clear == pytest.approx(5e-3, abs=1e-4)
        assert abs(place.normals[0] @ elbow.ignore_axis) < 1e-9
