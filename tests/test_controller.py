"""`Controller`: what it demands of a bundle, what stops it, and how the force ends."""

from dataclasses import replace
from itertools import product

import bundles
import numpy as np
import pytest

import vfplan
from vfplan import Controller, Status, Trust, read_keys
from vfplan.bundle.seal import keygen, sign
from vfplan.conformance import fixtures
from vfplan.controller import ASKED
from vfplan.engine.governor import GovernorStatus
from vfplan.errors import SettingError, VfplanError
from vfplan.findings import doubt
from vfplan.fixture import Curve, Guidance

ANY = {"accept_unsigned": True, "accept_unreviewed": True}
LINE = np.stack([np.linspace(-0.05, 0.05, 401), *np.zeros((2, 401))], axis=1)
DEEP = np.array([0.02, -2e-3, 0])  # 7 mm deep in it: 7 N
ABOVE = np.array([0.02, 10e-3, 0])
JACOBIAN = np.linspace(-0.5, 0.5, 21).reshape(3, 7)


def stored(path, up=0.0, is_approved=False, **changes):
    """A bundle of a line, infinite along z; `up` shifts it along y [m]."""
    made = bundles.small()
    how = {"stiffness": np.full(3, 1000.0), "band": 5e-5, "ignore_axis": np.eye(3)[2]}
    curve = Curve(np.zeros(401, np.int32), np.array([False]))
    line = replace(
        made, points=np.add(LINE, [0, up, 0]), curve=curve, rendering=replace(made.rendering, **how)
    )
    line = replace(line, **changes)
    vfplan.write_fixture(bundles.approved(line) if is_approved else line, path)
    return path


@pytest.fixture
def controller(tmp_path):
    return Controller(stored(tmp_path / "f.h5"), **ANY)


def press(controller, hip=DEEP):
    """Lead the tip from above to `hip`; the last answer."""
    controller.reset(ABOVE)
    for tip in np.linspace(ABOVE, hip, 300):
        out = controller.step(tip)
    return out


def ending(controller, tip, ticks=100):
    """The answers until the loop stops, the force's steps within the governor's 1 N."""
    answers = [controller.step(DEEP)]
    while len(answers) < ticks and not answers[-1].stop:
        answers.append(controller.step(tip))
    steps = np.diff([out.force for out in answers], axis=0)
    assert np.linalg.norm(steps, axis=1).max() <= 1 + 1e-9
    return answers[1:]


def test_a_bundle_is_what_is_demanded_or_refused(tmp_path):
    key, other = (keygen(tmp_path / name)[0] for name in ("k", "l"))
    plain = stored(tmp_path / "plain.h5", is_approved=True)
    open_one = doubt("end-other-colour", "extract", "The end lies under other ink.")
    doubted = stored(tmp_path / "doubted.h5", is_approved=True, findings=(open_one,))
    bare, signed = stored(tmp_path / "bare.h5"), tmp_path / "signed.h5"
    placed, touched = tmp_path / "patient.h5", tmp_path / "touched.h5"
    vfplan.write_fixture(fixtures.touched(), touched)
    vfplan.write_fixture(replace(bundles.small(), frame="patient_lps"), placed)
    sign(plain, signed, tmp_path / "k", case="C1", robot_serial="R7")
    unsigned = {"accept_unsigned": True}
    for path, demand, code in (
        (signed, {"keys": key}, None),
        (signed, {"keys": [other, key], "case": "C1", "robot_serial": "R7"}, None),
        (signed, {"keys": key, "case": "C2"}, "signature"),
        (signed, {"keys": key, "robot_serial": "R8"}, "signature"),
        (signed, {"keys": other, **unsigned}, "signature"),
        (signed, {"keys": Trust(read_keys(key), "C1", "R7", 3600)}, None),
        (signed, {"keys": Trust(read_keys(other), "C1")}, "signature"),
        (signed, {"keys": Trust(read_keys(key), "C2")}, "signature"),
        (signed, {"keys": Trust({}, "C1"), **unsigned}, "signature.missing"),
        (plain, {"keys": key}, "signature"),
        (plain, {}, "signature.missing"),
        (plain, {**unsigned, "case": "C1"}, "signature.missing"),
        (plain, unsigned, None),
        (bare, unsigned, "unsafe.review"),
        (bare, ANY, None),
        (doubted, unsigned, "unsafe.findings"),
        (doubted, {**unsigned, "accept_doubts": True}, None),
        (placed, ANY, "unsafe.frame"),
        (touched, {**ANY, "tool": "probe 1"}, None),
        (touched, {**ANY, "tool": "probe 2"}, "unsafe.tool"),
        (bare, {**ANY, "tool": "probe 1"}, "unsafe.tool"),
    ):
        if code is None:
            controller = Controller(path, **demand)
            assert (controller.stiffness, controller.contact_radius) == (1000, 5e-3)
            assert controller.rule == "robust"
            continue
        with pytest.raises(VfplanError) as refused:
            Controller(path, **demand)
        assert refused.value.code == code, (path, demand)
        assert str(path) in str(refused.value)
    with pytest.raises(SettingError, match="A Trust holds the case"):
        Controller(signed, Trust(read_keys(key)), case="C1")


BAD = {Status.BAD_HIP: [np.nan, 0, 0], Status.JUMPED: [1.0, 0, 0]}


@pytest.mark.parametrize("bit", BAD)
def test_without_a_position_the_force_holds_then_fades_and_the_loop_stops(bit, controller):
    first = press(controller)
    assert first.force == pytest.approx([0, 7, 0], abs=0.1)
    for _ in range(19):
        out = controller.step(BAD[bit])
        assert (out.status, out.stopping) == (bit, 0)
        assert np.array_equal(out.force, first.force)
    assert controller.step(DEEP).status == Status.OK
    out = ending(controller, BAD[bit])
    assert [answer.stopping for answer in out[:3]] == [0, bit, bit], "two good ticks count little"
    assert len(out) <= 30
    assert not np.any(out[-1].force)
    assert controller.step(DEEP).stop
    assert press(controller).force == pytest.approx(first.force, abs=0.02)


def test_a_sample_in_millimetres_never_exceeds_what_is_governed(tmp_path):
    controller = Controller(stored(tmp_path / "f.h5"), max_hip_step=0, **ANY)
    press(controller)
    out = ending(controller, 1e3 * DEEP, 40)
    assert max(np.linalg.norm(answer.force) for answer in out) <= 20


def test_a_loop_in_millimetres_stops_from_its_first_tick_on(controller):
    tip = [466.0, -48.0, 20.0]
    controller.reset(tip)
    last = [controller.step(tip) for _ in range(40)][-1]
    assert (last.stop, last.stopping) == (True, Status.BAD_HIP)


def test_positions_that_are_bad_again_and_again_stop_the_loop(controller):
    for bad, good, ticks in ((1, 1, 50), (1, 3, 150), (19, 2, 40), (1, 20, None)):
        press(controller)
        pattern = (bad * [np.full(3, np.nan)] + good * [DEEP]) * 100
        stopped = [k for k, tip in enumerate(pattern) if controller.step(tip).stopping]
        assert not stopped if ticks is None else stopped[0] < ticks, (bad, good)


def test_a_request_before_the_loop_begins_is_not_forgotten(controller):
    controller.reset([20, -8000, 0])
    assert controller.step(ABOVE).stopping == Status.BAD_HIP, "a reset to no place begins nothing"
    controller.request_stop()
    controller.reset(ABOVE)
    out = controller.step(ABOVE)
    assert (out.stop, out.stopping) == (True, ASKED)
    controller.reset(ABOVE)
    assert controller.step(ABOVE).stopping == 0


def test_a_force_that_the_governor_shortens_says_so(controller):
    assert press(controller, [0.02, -14e-3, 0]).status == Status.OK
    out = press(controller, [0.02, -16e-3, 0])
    assert (out.status, out.stopping) == (Status.CAPPED, 0)
    assert np.linalg.norm(out.force) <= 20 < np.linalg.norm(out.rendered)


def test_a_reset_beyond_the_wall_says_so_and_stops(controller, tmp_path):
    """The hand pushed the tool through; what it was before the loop, nobody knows."""
    for beyond in (-3e-3, -8e-3, -30e-3):
        press(controller)
        controller.reset([0.02, beyond, 0])
        out = controller.step([0.02, beyond, 0])
        assert out.status & Status.CROSSED
        assert out.stopping == Status.CROSSED
    press(controller)
    controller.reset([20, -8000, 0])
    assert controller.step([0.02, -8e-3, 0]).proxy[1] > 0, "a reset to no place is none"
    controller.reset([0.02, -8e-3, 0])
    assert controller.step([0.02, -8e-3, 0]).status & Status.CROSSED
    controller.reset([0.02, beyond, 0])
    assert controller.step([0.02, beyond, 0]).stopping == 0, "who resets again means it"
    for same in ([0.02, 2e-3, 0], [-0.04, 5e-3, 0], [0.02, 0.4, 0.1]):
        controller = Controller(stored(tmp_path / f"{same[1]}.h5"), **ANY)
        press(controller)
        controller.reset(same)
        assert not controller.step(same).status & Status.CROSSED


@pytest.mark.parametrize("name, value", [
    *product(("max_hip_step", "max_stiffness_n_per_m"), (-1.0, np.inf, np.nan)),
    ("max_hip_step", 1e9),
])  # fmt: skip
def test_a_limit_out_of_range_is_refused_by_its_name(name, value, tmp_path):
    with pytest.raises(SettingError, match=name):
        Controller(stored(tmp_path / "f.h5"), **ANY, **{name: value})


def test_who_asks_and_an_old_pose_stop_the_loop_too(tmp_path):
    path = stored(tmp_path / "f.h5")
    controller = Controller(path, **ANY)
    press(controller)
    controller.request_stop()
    assert [answer.stopping for answer in ending(controller, DEEP)][-1] == ASKED
    controller = Controller(path, moving=(0.05, 0.25, 1.0), **ANY)
    assert not controller.pose(-1.0, np.diag([1.0, 1, 1, 1]) + 500 * np.eye(4, k=3))
    assert controller.pose(0.0, np.eye(4))
    controller.reset(ABOVE)
    answers = [controller.step(ABOVE, 1e-3 * k) for k in range(80)]
    assert answers[50].stopping == 0
    assert answers[52].stopping == Status.STALE
    assert answers[52].stop


def test_one_wall_twice_is_felt_once_and_two_walls_add_up(tmp_path):
    controller = Controller(stored(tmp_path / "a.h5"), **ANY)
    controller.add(stored(tmp_path / "b.h5"))
    assert controller.size == 1
    assert press(controller).force == pytest.approx([0, 7, 0], abs=0.1)
    controller.add(stored(tmp_path / "c.h5", up=-1e-3))
    assert (controller.size, controller.stiffness) == (2, 2000)
    assert press(controller).force == pytest.approx([0, 13, 0], abs=0.2)
    assert np.linalg.norm(press(controller, DEEP - [0, 0.02, 0]).force) <= 20


def test_a_fixture_that_takes_from_the_force_of_another_says_so(tmp_path):
    controller = Controller(stored(tmp_path / "wall.h5"), **ANY)
    controller.add(stored(tmp_path / "guide.h5", up=2e-3, guidance=Guidance(2e-3, 3000.0)))
    assert press(controller, [0.02, 3e-3, 0]).status == Status.OK  # into the tube in the wall
    out = controller.step([0.02, 4.5e-3, 0])  # 0.5 N up by the wall, 1.5 N down by the tube
    assert (out.rendered[1], out.status) == (pytest.approx(-1, abs=0.1), Status.CAPPED)


def test_torques_fade_as_the_force_does(tmp_path):
    governor = vfplan.Governor.of(vfplan.read_robot("fr3"), 1.0, torques=True)
    controller = Controller(stored(tmp_path / "f.h5"), governor=governor, **ANY)
    controller.reset(ABOVE)
    for tip in np.linspace(ABOVE, DEEP, 300):
        out = controller.step(tip, None, JACOBIAN)
    assert controller.torque_nm == pytest.approx(JACOBIAN.T @ out.force)
    while not out.stop:
        out = controller.step(DEEP, None, JACOBIAN * np.nan)
    assert not controller.torque_nm.any()
    with pytest.raises(SettingError, match="force_step_n"):
        Controller(stored(tmp_path / "stiff.h5", rendering=replace(
            bundles.small().rendering, stiffness=np.full(3, 1e6))), **ANY)  # fmt: skip


def test_the_stiffness_changes_in_small_steps_and_ramps_are_in_seconds(tmp_path):
    stiffness = np.array([1000.0, 200.0, 1000.0])
    uneven = replace(bundles.small().rendering, stiffness=stiffness, band=5e-5)
    for name, most, changes in (("g.h5", 1000, {}), ("h.h5", 200, {"rendering": uneven})):
        least = Controller(stored(tmp_path / name, **changes), **ANY)
        least.set_stiffness(most)
        with pytest.raises(SettingError, match="the bundle's"):
            least.set_stiffness(most + 1)
    path = stored(tmp_path / "f.h5")
    controller = Controller(path, max_stiffness_n_per_m=2500, **ANY)
    forces = [press(controller).force]
    controller.set_stiffness(2500)
    forces += [controller.step(DEEP).force for _ in range(1000)]
    assert controller.stiffness == 2500
    assert forces[-1] == pytest.approx([0, 17.5, 0], abs=0.2)
    steps = np.linalg.norm(np.diff(forces, axis=0), axis=1)
    assert steps.max() <= 2500 * 5e-3 / 256 * (1 + 1e-9)
    with pytest.raises(SettingError):
        controller.set_stiffness(1e6)
    for change in (controller.set_stiffness, lambda _, which: controller.exchange(path, which)):
        with pytest.raises(SettingError, match=r"which is 3\. Give .* at most 0 "):
            change(500, 3)
    seconds = []
    for rate_hz in (1000, 8000):
        governor = vfplan.Governor(
            force_step_n=1.0, force_max_n=20, stiffness_n_per_m=1, mass_kg=1, rate_hz=rate_hz
        )
        controller = Controller(stored(tmp_path / f"{rate_hz}.h5"), governor=governor, **ANY)
        controller.reset(DEEP)
        status = [controller.step(DEEP).status for _ in range(rate_hz)]
        seconds.append(np.count_nonzero(np.array(status) & Status.INSIDE) / rate_hz)
    assert seconds[0] > 0.1
    assert seconds[1] == pytest.approx(seconds[0], rel=0.1)


def test_a_reset_after_an_exchange_or_past_the_line_is_told(tmp_path):
    """What the loop knows of the tool's side, no reset loses."""
    for up, places in ((9e-3, [DEEP]), (0, [[0.02, -4e-4, 0]]), (0, [LINE[280], [0.02, -0.02, 0]])):
        controller = Controller(stored(tmp_path / "f.h5"), **ANY)
        press(controller, [0.02, 3e-3, 0])
        if up:
            controller.request_stop()
            assert ending(controller, ABOVE)[-1].stop
            controller.exchange(stored(tmp_path / "up.h5", up=up))
        for place in places:
            controller.reset(place)
        assert controller.step(places[-1]).stopping == Status.CROSSED
        (tmp_path / "f.h5").unlink()
        controller.reset(np.multiply(places[-1], 1e4))
        stopping = controller.step(places[-1]).stopping
        assert stopping == Status.CROSSED | Status.BAD_HIP, "a reset to no place"


def test_an_arm_that_takes_torques_is_let_go_when_its_jacobian_stays_away(controller):
    press(controller)
    for _ in range(50):
        controller.step(DEEP, None, JACOBIAN)
    answers = [controller.step(DEEP) for _ in range(50)]
    assert answers[-1].stop
    assert not controller.torque_nm.any()
    assert answers[-1].stopping == 256 * GovernorStatus.BAD_JACOBIAN


def test_a_moving_fixture_keeps_the_place_of_a_reset_and_a_clock_may_begin_anew(tmp_path):
    """Before its first pose a jump is told; after a reset an earlier time is the new clock."""
    path = stored(tmp_path / "a.h5")
    controller = Controller(path, **ANY, moving=(0.1, 0.25, 1.0))
    controller.reset(ABOVE)
    controller.pose(100.0, np.eye(4))
    assert controller.step(1000 * ABOVE, 100.001).status == Status.JUMPED
    assert controller.step(ABOVE, 100.002).status == Status.OK
    for begin in (50.0, 0.0):
        controller.reset(ABOVE)
        assert controller.step(ABOVE, begin).status == Status.STALE
        for tick in range(1, 6):
            controller.pose(begin + 1e-3 * tick, np.eye(4))
            out = controller.step(ABOVE, begin + 1e-3 * tick)
        assert out.status == Status.OK
    controller = Controller(path, **ANY, moving=(0.1, 0.25, 1.0))
    controller.reset(ABOVE)
    controller.pose(0.0, np.eye(4))
    out = controller.step(DEEP, 0.001)
    assert out.status == Status.OK
    assert out.proxy[1] > 4.9e-3
