"""The governor: closed forms, an independent twin, and limits that nothing crosses."""

import numpy as np
import pytest
from motion import NATIVE, compiled, output
from oracle.governor_twin import Twin

import vfplan
from vfplan import GovernorStatus
from vfplan.engine.governor import HEADROOM
from vfplan.errors import SceneError, SettingError

K, M, T = 1000.0, 1.0, 1e-3


def governor(step=0.5, **more):
    settings = {"stiffness_n_per_m": K, "mass_kg": M} | more
    return vfplan.Governor(force_step_n=step, force_max_n=20.0, **settings)


def test_below_its_limits_it_is_not_there():
    draw = np.random.default_rng(1)
    forces = np.cumsum(draw.uniform(-0.28, 0.28, (5000, 3)), axis=0)
    forces *= min(1.0, 19.9 / np.linalg.norm(forces, axis=1).max())
    g = governor()
    assert np.array_equal(g.run(forces), forces)
    assert (g.held_back_n, g.energy_given_j, g.energy_stored_j) == (0.0, 0.0, 0.0)
    assert g.status == GovernorStatus.OK
    turning = governor(torque_step_nm=1.0, torque_max_nm=87.0)
    for force in forces[:500]:
        jacobian = draw.uniform(-1e-3, 1e-3, (3, 7)) + 0.5
        assert np.array_equal(turning.step(force, jacobian), force)
        assert turning.torque_nm == pytest.approx(jacobian.T @ force, abs=1e-13)


def test_a_release_is_a_straight_ramp_and_gives_what_the_formula_says():
    """From F0 by s a tick: F0/s ticks, F0² t²/8m with t = F0 T/s, less a tick's part.

    By 1 N a tick some 7 mJ of 0.1 J.
    """
    for step in (0.5, 1.0, 2.0):
        g, n = governor(step), int(15 / step)
        start = g.run(np.linspace([0, 0, 0], [0, 15.0, 0], 40 * n))[-1]
        assert start.tolist() == [0, 15.0, 0]
        ramp = g.run(np.zeros((n, 3)))
        assert ramp[:, 1] == pytest.approx(15 - step * np.arange(1, n + 1), abs=1e-6)
        assert not ramp[:, [0, 2]].any()
        g.run(np.zeros((2, 3)))
        pushed = T * sum(15 - step * k for k in range(1, n + 1))
        assert g.energy_given_j == pytest.approx(pushed**2 / (2 * M), rel=1e-6)
        assert g.energy_given_j == pytest.approx(15**2 * (15 * T / step) ** 2 / (8 * M), rel=0.3)
        assert g.energy_stored_j == pytest.approx(15**2 / (2 * K), rel=1e-9)


def test_the_least_passive_step_is_where_given_meets_stored():
    least = 20.0 * T * np.sqrt(K / M) / 2
    g = governor(least)
    assert g.least_passive_step_n == pytest.approx(least, rel=1e-14)
    g.run(np.full((100, 3), [20.0, 0, 0]))
    g.reset()  # nothing given before
    g.run(np.linspace([0, 0, 0], [20.0, 0, 0], 200))
    g.run(np.zeros((100, 3)))
    assert 0.95 < g.energy_given_j / g.energy_stored_j < 1.0  # less by a tick's part
    with pytest.raises(SettingError, match=rf"at least {least:.6g} N") as caught:
        governor(0.31)
    assert caught.value.numbers == {"force_step_n": 0.31}
    assert governor(0.31, mass_kg=1.05).least_passive_step_n < 0.31


@pytest.mark.parametrize("seed", range(2))
def test_the_twin_in_numpy_agrees(seed):
    draw = np.random.default_rng(seed)
    step, most = np.full(7, 0.9), np.array([9.0] * 4 + [4.0] * 3)
    g = governor(0.8, torque_step_nm=step, torque_max_nm=most)
    twin = Twin(0.8, 20.0, step, most, K, M, T)
    force, jacobian = np.zeros(3), draw.uniform(-0.8, 0.8, (3, 7))
    seen = GovernorStatus.OK
    for k in range(400):
        if k % 40 == 0:
            force = draw.normal(0, 10, 3)
        force = force + draw.normal(0, 0.05, 3)
        jacobian = jacobian + draw.normal(0, 2e-3, (3, 7))
        if k == 200:  # elsewhere at once
            jacobian = draw.uniform(-0.8, 0.8, (3, 7))
        assert g.step(force, jacobian) == pytest.approx(twin.step(force, jacobian), abs=2e-6)
        assert g.torque_nm == pytest.approx(twin.torque, abs=4e-6)
        seen |= g.status
    assert GovernorStatus.TORQUE_LAGS in seen
    given = twin.given + twin.momentum @ twin.momentum / (2 * M)
    assert g.energy_given_j == pytest.approx(given, rel=1e-3)
    assert g.energy_stored_j == pytest.approx(twin.stored + twin.top**2 / (2 * K), rel=1e-3)


def test_what_is_no_number_fades_out_and_is_said():
    for bad in (np.nan, np.inf, -np.inf, 1e308):
        g = governor()
        g.run(np.linspace([0, 0, 0], [10.0, 0, 0], 100))
        force = g.step([bad, 0, 0])
        assert g.status == GovernorStatus.BAD_FORCE
        assert force == pytest.approx([9.5, 0, 0], abs=1e-6)
        assert np.isfinite(g.run(np.full((40, 3), bad))).all()
        assert g.step([0, 0, 0]).tolist() == [0, 0, 0]
    g = governor(torque_step_nm=0.4, torque_max_nm=87.0)
    for k in range(100):
        g.step([0.1 * k, 0, 0], np.eye(3))
    broken = np.eye(3)
    broken[1, 1] = np.nan
    force = g.step([9.9, 0, 0], broken)
    assert g.status & GovernorStatus.BAD_JACOBIAN
    assert g.torque_nm == pytest.approx([9.5, 0, 0])
    assert force == pytest.approx([9.4, 0, 0])


@pytest.mark.parametrize("settings, numbers", [
    *(({name: value}, {name: value}) for name, value in (
        ("force_step_n", 0.0), ("force_step_n", np.inf), ("force_step_n", 40.1), ("mass_kg", 0.0),
        ("force_max_n", -1.0),
        ("stiffness_n_per_m", 0.0), ("rate_hz", 0.0), ("torque_step_nm", 0.0))),
    ({"torque_step_nm": [1.0, 2.0], "torque_max_nm": [1.0]}, {}),
    ({"torque_step_nm": np.ones(17)}, {}), ({"torque_step_nm": "much"}, {}),
    ({"torque_step_nm": 1e-9, "torque_max_nm": 80}, {"torque_step_nm": 1e-9})])  # fmt: skip
def test_settings_out_of_range_are_refused(settings, numbers):
    good = {"force_step_n": 0.5, "force_max_n": 20, "stiffness_n_per_m": K, "mass_kg": M}
    with pytest.raises(SettingError) as caught:
        vfplan.Governor(**good | settings)
    assert caught.value.numbers == numbers


def test_shapes_are_refused_and_a_jacobian_is_asked_for():
    g, turning = governor(), governor(torque_step_nm=np.ones(7))
    for says, call, *given in (
        (r"force .*\(2,\)", g.step, [1, 2]),
        (r"jacobian .*\(7, 3\)", g.step, [1, 2, 3], np.ones((7, 3))),
        (r"jacobians .*\(4, 3, 7\)", g.run, np.zeros((5, 3)), np.zeros((4, 3, 7))),
        ("jacobian", turning.step, [1, 2, 3]),
        ("n 7", turning.step, [1, 2, 3], np.ones((3, 6))),
    ):
        with pytest.raises(SceneError, match=says):
            call(*given)


def test_steps_and_a_run_are_the_same():
    draw = np.random.default_rng(5)
    forces, jacobians = draw.normal(0, 9, (300, 3)), draw.uniform(-0.5, 0.5, (300, 3, 7))
    one, all_ = governor(torque_step_nm=1.0), governor(torque_step_nm=1.0)
    stepped = np.array([one.step(f, j) for f, j in zip(forces, jacobians, strict=True)])
    assert np.array_equal(all_.run(forces, jacobians), stepped)
    assert np.array_equal(one.torque_nm, all_.torque_nm)
    assert (one.held_back_n, one.status) == (all_.held_back_n, all_.status)
    one.reset()
    assert (one.torque_nm.size, one.held_back_n, one.energy_given_j) == (0, 0.0, 0.0)
    assert np.array_equal(one.step(forces[0], jacobians[0]), stepped[0])


def test_a_force_that_turns_round_stays_within_the_tank_from_twice_the_passive_step_on():
    turned = np.repeat([[20.0, 0, 0], [-20.0, 0, 0]], 400, axis=0)
    least = 2 * governor().least_passive_step_n
    for share, within in ((1.0, True), (0.8, False)):
        g = governor(share * least)
        overdrawn = (g.trace(turned).status & GovernorStatus.OVERDRAWN).any()
        assert overdrawn != within
        if within:
            assert g.energy_given_j <= 1.01 * g.energy_stored_j


@pytest.mark.parametrize("name", ["franka", "fr3"])
def test_of_a_robot_file(name):
    robot = vfplan.read_robot(name)
    g = vfplan.Governor.of(robot, 1000.0, torques=True)
    for tick in (1, 2):
        assert g.step([20.0, 0, 0], np.full((3, 7), 0.1))[0] == pytest.approx(tick * 1.2)
    turning = np.full((3, 7), 1.5)
    g.reset()
    g.step([20.0, 0, 0], turning)
    assert g.torque_nm == pytest.approx(np.full(7, HEADROOM))
    with pytest.raises(SettingError) as caught:
        vfplan.Governor.of(robot, 20_000.0)
    assert caught.value.numbers == {"force_step_n": 1.2}
    bare = vfplan.Robot("bare", 1.0, 5.0, 1000.0)
    with pytest.raises(SettingError, match="'bare' has no force_limit_n"):
        vfplan.Governor.of(bare, 1000.0)


@pytest.mark.slow
def test_the_header_alone_holds_every_limit_and_allocates_nothing(tmp_path):
    """The program itself stops at the first tick beyond a limit and at any allocation."""
    program = compiled(tmp_path, NATIVE / "governor_ticks.cpp", "-O2")
    for line in output(program, 1_000_000).splitlines():
        row = dict(zip(line.split()[1::2], map(float, line.split()[2::2]), strict=True))
        assert 0.99 < row["force_step"] <= 1
        assert row["held"] > 100_000
    assert 0.99 < row["torque_step"] <= 1
    assert 0.9 < row["torque"] <= 1
