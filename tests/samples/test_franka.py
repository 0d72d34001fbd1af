"""A Franka's own protocol: raw, its limits stop the arm; governed, they do not.

Needs the environment of `make franka-env`: the protocol's simulator and Franka's own binding.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import bundles
import numpy as np
import pytest
from conftest import ROOT, missing, output, quick_compiler
from motion import INCLUDE, SHEET, compiled

import vfplan
from vfplan import Status
from vfplan import fixture as fixtures
from vfplan.errors import SignatureError
from vfplan.findings import doubt

pytestmark = pytest.mark.slow

PYTHON = ROOT / ".venv-franka" / "bin" / "python"
FOLDER = ROOT / "samples" / "franka"
RUN = """
import dataclasses, json, sys
sys.path.insert(0, sys.argv[1])
import study
rows = study.study(2, (2000.0,), (sys.argv[2],))
print(json.dumps([[governed, dataclasses.asdict(run)] for *_, governed, run in rows]))
"""


def need_environment():
    if not PYTHON.exists():
        missing("no .venv-franka: `make franka-env` makes it")


def stored(folder, fixture, name="f"):
    path = str(folder / f"{name}.h5")
    vfplan.write_fixture(fixture, path)
    return path


def runs(scene):
    """One raw run and two governed ones over the protocol."""
    need_environment()
    for attempt in range(3):  # a busy machine loses packets; what counts are the arm's limits
        rows = json.loads(output(PYTHON, "-P", "-c", RUN, FOLDER, scene, timeout=300))
        errors = [run["error"] or "" for _, run in rows]
        if attempt == 2 or not any("communication" in error for error in errors):
            break
    return [[run for is_governed, run in rows if is_governed == wanted] for wanted in (False, True)]


def test_the_governor_keeps_the_arm_from_stopping():
    raw, held = runs("edge of a sheet")
    assert all("controller_torque_discontinuity" in run["error"] for run in raw)
    assert [run["error"] for run in held] == [None, None]
    assert all(run["force_step_n"] > 3 for run in held)


@pytest.fixture
def simulator():
    """The address of an arm's simulator, as docs/howto/franka.md starts it."""
    need_environment()
    model = ROOT / "vfplan" / "arm" / "models" / "fr3.xml"
    address = f"127.0.0.{2 + os.getpid() % 250}"
    words = [PYTHON, FOLDER / "simulator.py", model, address]
    server = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    yield address
    server.terminate()
    server.wait(30)


def test_over_the_protocol_the_loop_starts_free_and_not_inside(simulator, tmp_path):
    def run_loop(name, points):
        path = stored(tmp_path, replace(bundles.large(len(points)), points=points), name)
        words = [PYTHON, "-P", FOLDER / "loop.py", path, "--robot", simulator, "--unsigned"]
        words += ["--no-real-time", "--seconds", "0.2", "--log", tmp_path / f"{name}.csv"]
        for _ in range(60):
            done = subprocess.run(words, capture_output=True, text=True, timeout=60)
            if "the arm is not ready" not in done.stderr:
                break
            time.sleep(0.5)
        return done

    ring = bundles.large(400).points + np.array([5.0, 0, 0])
    free = run_loop("free", ring)
    assert free.returncode == 0, free.stderr
    assert "status: all well" in free.stdout
    session = vfplan.read_session(tmp_path / "free.csv")
    assert len(session.hip) == 201
    assert np.ptp(session.hip, axis=0).max() < 0.01

    beside = ring - ring[0] + session.hip[-1] + [0.002, 0, 0]
    inside = run_loop("inside", beside)
    assert inside.returncode == 1
    assert "is inside the fixture" in inside.stderr
    assert not (tmp_path / "inside.csv").exists()


def test_the_simulator_says_how_it_is_called():
    words = [sys.executable, str(FOLDER / "simulator.py")]
    assert output(*words, "--help").startswith("usage: ")
    output(*words, code=2)


class FakeArm:
    """An arm for the loop alone, at rest unless `lives`; it keeps the torques it is given.

    lives: changes the arm before a tick, from the tick's number
    """

    def __init__(self, tip):
        transform = np.eye(4)
        transform[:3, 3] = tip
        self.state = SimpleNamespace(O_T_EE=transform.T.ravel().tolist(), dq=[0.0] * 7)
        self.torques = []
        self.jacobian = np.eye(6, 7)
        self.lives = lambda tick: None

    def press(self, depth):
        """Move the tip towards the curve, from where it is [m]."""
        self.state.O_T_EE[13] -= depth

    def load_model(self):
        return SimpleNamespace(zero_jacobian=lambda state: self.jacobian.T.ravel().tolist())

    def read_once(self):
        return self.state

    def start_torque_control(self):
        return SimpleNamespace(
            readOnce=self.read_in_loop,
            writeOnce=lambda command: self.torques.append(command.torque),
        )

    def read_in_loop(self):
        self.lives(len(self.torques))
        return self.state, 0.001

    def automatic_error_recovery(self):
        pass

    def set_collision_behavior(self, *thresholds):
        self.thresholds = thresholds

    def use(self, config):
        self.config = config
        return self


@pytest.fixture
def loop(monkeypatch):
    """The module loop.py, with a binding of Franka's that knows one arm."""
    arm = FakeArm(bundles.small().points[3] + [0, 0.006, 0])
    library = SimpleNamespace(
        Robot=lambda host, config: arm.use(config),
        RealtimeConfig=SimpleNamespace(kIgnore="ignore", kEnforce="enforce"),
        Torques=lambda torque: SimpleNamespace(torque=torque, motion_finished=False),
        ControlException=RuntimeError,
        CommandException=RuntimeError,
    )
    monkeypatch.setitem(sys.modules, "pylibfranka", library)
    monkeypatch.syspath_prepend(str(FOLDER))
    import loop

    loop.arm = arm
    before = {number: signal.getsignal(number) for number in STOP_SIGNALS}
    yield loop
    for number, handler in before.items():
        signal.signal(number, handler)


STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
SHORT = ("--seconds", "0.02")


@pytest.fixture
def call(loop, capsys):
    """Call the loop, which ends with this code: what it says, and the torques it gave."""

    def run(*words, code=0, told=("--unsigned",)):
        loop.arm.torques.clear()
        try:
            ended = loop.main([*map(str, words), "--robot", "arm", *told])
        except SystemExit as stopped:  # how argparse ends
            ended = stopped.code
        out, err = capsys.readouterr()
        assert ended == code, err
        assert code in (0, 1) or code > 128 or not loop.arm.torques
        return out + err, np.array(loop.arm.torques)

    return run


def test_the_loop_refuses_open_findings_unless_told(call, tmp_path):
    open_one = doubt("end-other-colour", "extract", "The end lies under other ink.")
    path = stored(tmp_path, replace(bundles.small(), findings=(open_one,)))
    assert "end-other-colour" in call(path, *SHORT, code=4)[0]
    assert len(call(path, *SHORT, "--despite-findings")[1]) == 20


def test_the_loop_demands_a_signature_unless_told(call, tmp_path):
    from vfplan.bundle.seal import keygen, sign

    path, signed = stored(tmp_path, bundles.small()), str(tmp_path / "signed.h5")
    keys = str(keygen(tmp_path / "k")[0])
    sign(path, signed, tmp_path / "k", case="17", despite_findings=True)
    for words in (
        SHORT,
        (*SHORT, "--unsigned", "--case", "17"),
        (*SHORT, "--unsigned", "--max-age", "60s"),
        (*SHORT, "--require-signature", keys, "--max-age", "43200"),
        ("--unsigned", "--seconds", "0"),
        (*SHORT, "--unsigned", "--require-signature", keys),
    ):
        call(path, *words, told=(), code=2)
    demands = (*SHORT, "--keys", keys, "--max-age", "2d")
    call(path, *demands, told=(), code=SignatureError.exit_code)
    call(signed, *demands, "--case", "18", told=(), code=SignatureError.exit_code)
    assert len(call(signed, *demands, "--case", "17", told=())[1]) == 20


def test_the_loop_takes_no_guide_no_other_frame_and_no_bare_points(call, tmp_path):
    patient = replace(bundles.small(), frame="patient_lps", rendering=None, registration=None)
    for name, fixture in {
        "guide": bundles.guided(), "bare": bundles.minimal(), "patient": patient,
    }.items():  # fmt: skip
        path = stored(tmp_path, fixture, name)
        said, _ = call(path, *SHORT, "--despite-findings", code=3)
    assert said.splitlines()[-1].startswith(f"{path}: the fixture is in the frame")


def press_until_tick_5(loop, then):
    """Let the tip press, and call `then` in tick 5."""

    def live(tick):
        loop.arm.press(0.0006 if tick < 5 else 0)
        if tick == 5:
            then()

    loop.arm.lives = live


def fades(torques, ticks):
    """Whether torques pressed in tick 4, and ended with none before that many ticks."""
    return 6 <= len(torques) < ticks and torques[4].any() and not torques[-1].any()


def test_a_bad_bundle_is_told_before_a_missing_binding(call, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pylibfranka", None)
    whole, broken = stored(tmp_path, bundles.small()), tmp_path / "broken.h5"
    broken.write_bytes(Path(whole).read_bytes()[:-5])
    for code, path in ((3, tmp_path / "none.h5"), (4, broken)):
        assert call(path, *SHORT, code=code)[0].startswith(f"{path}: ")
    assert "pylibfranka is not installed. " in call(whole, *SHORT, code=2)[0]


def test_an_arm_that_does_not_answer_ends_with_a_line(call, monkeypatch, tmp_path):
    def refuse(host, config):
        raise RuntimeError("libfranka: Connection refused.")

    monkeypatch.setattr(sys.modules["pylibfranka"], "Robot", refuse)
    said, _ = call(stored(tmp_path, bundles.small()), *SHORT, code=1)
    assert said.splitlines()[-1].startswith("arm: the arm is not ready: ")


@pytest.mark.parametrize("number", STOP_SIGNALS)
def test_a_signal_ends_the_loop_and_its_torque(number, loop, call, tmp_path):
    """The tip presses, and in tick 5 somebody presses Ctrl-C."""

    press_until_tick_5(loop, lambda: signal.raise_signal(number))
    path = stored(tmp_path, bundles.small())
    said, torques = call(path, "--seconds", "1", code=128 + number)
    assert "in tick 5" in said
    assert fades(torques, 100)


def stop_at_tick_5(loop, engine, governor, *more):
    """Of an arm that presses for 100 ticks, with something bad from tick 5 on: run, torques."""
    engine.reset(loop.read_tip(loop.arm.state))
    run = loop.render(loop.arm, loop.arm.load_model(), engine, governor, 100, *more)
    return run, np.array(loop.arm.torques)


def small_governor():
    return vfplan.Governor.of(vfplan.read_robot("fr3"), 1000.0, torques=True)


class Pushing:
    """An engine that pushes along y, with a force [N] and a status a tick."""

    def __init__(self, force, status=lambda tick: vfplan.Status.OK):
        self.ticks, self.force, self.status = 0, force, status

    def reset(self, hip):
        pass

    def step(self, hip):
        force, status = np.array([0.0, self.force(self.ticks), 0.0]), self.status(self.ticks)
        self.ticks += 1
        return vfplan.Step(np.array(hip), np.array([0.0, 1.0, 0.0]), force, 1, status)


@pytest.mark.parametrize("is_governed", [True, False])
@pytest.mark.parametrize("bit", list(vfplan.Status))
def test_the_loop_stops_at_the_bits_of_the_page_and_lets_the_torque_fade(bit, is_governed, loop):
    """An engine that pushes by 8 N, and sets one bit from tick 5 on."""
    pushing = Pushing(lambda tick: 8.0, lambda tick: bit if tick >= 5 else vfplan.Status.OK)
    run, torques = stop_at_tick_5(loop, pushing, small_governor() if is_governed else None)
    assert np.abs(torques[4]).max() > 1
    stops = Status.BAD_HIP | Status.STALE | Status.CROSSED | Status.JUMPED
    if bit & stops:
        assert "In tick 5 " in run.error
        assert not torques[-1].any()
        # One tick if nothing limits the step, and else 8 N at 0.95 N m a tick or less.
        assert (run.ticks == 6) != is_governed
        assert run.ticks < 40
    else:
        assert run.error is None
        assert run.ticks == 100
    assert run.bits == {bit.name.lower(): run.ticks - 5}
    if is_governed:
        assert run.torque_step_nm <= 0.95 + 1e-9


@pytest.mark.parametrize("is_governed", [True, False])
def test_the_loop_stops_at_a_bad_jacobian(is_governed, loop):
    def lose():
        loop.arm.jacobian = np.full((6, 7), np.nan)

    press_until_tick_5(loop, lose)
    engine = vfplan.ProxyEngine.of(bundles.small())
    run, torques = stop_at_tick_5(loop, engine, small_governor() if is_governed else None)
    assert "In tick 5 the arm's Jacobian" in run.error
    assert np.isfinite(torques).all()
    assert fades(torques, 100)
    assert run.ticks < 100
    if is_governed:
        assert run.bits["bad_jacobian"] == run.ticks - 5


@pytest.mark.parametrize("bad", ["position", "jump", "hook", "signal"])
def test_what_a_hook_adds_does_not_keep_the_loop_alive(bad, loop):
    """The hook holds 2 N m all the time; the fixture's torque fades, and the motion is finished."""
    signals, hook = [], np.full(7, 2.0)

    def lose():
        if bad == "signal":
            signals.append(signal.SIGINT)
        elif bad == "hook":
            hook[3] = np.nan
        else:
            loop.arm.state.O_T_EE[12] = {"position": np.nan, "jump": 1.0}[bad]

    press_until_tick_5(loop, lose)
    engine = vfplan.ProxyEngine.of(bundles.small(), max_hip_step=loop.MAX_TIP_STEP)
    more = small_governor(), lambda *_: hook.copy(), signals
    run, torques = stop_at_tick_5(loop, engine, *more)
    assert "tick 5" in run.error
    assert 6 <= run.ticks == len(torques) < 40
    assert (torques[4] != 2).any()
    assert (torques[-1] == 2).all()
    assert np.abs(np.diff(torques, axis=0)).max() <= 0.95 + 1e-9


def test_the_loop_of_the_panda_stops_as_the_other(loop, call, monkeypatch, tmp_path):
    """Over a stand-in of panda-python 1.1.1, with the names of its stubs that the loop calls."""
    arm, stand_in = loop.arm, Mock(spec=["Panda", "controllers", "libfranka"])
    names = "recover get_robot get_model get_state start_controller stop_controller create_context"
    panda = stand_in.Panda.return_value = Mock(spec=names.split())
    panda.get_robot.return_value = arm
    panda.get_state.side_effect = lambda: arm.read_in_loop()[0]
    panda.get_model().zero_jacobian = lambda frame, state: arm.jacobian.T.ravel().tolist()
    stand_in.controllers.AppliedTorque.return_value.set_control.side_effect = arm.torques.append
    monkeypatch.setitem(sys.modules, "panda_py", stand_in)
    import panda_loop

    monkeypatch.setattr(loop, "ARM", "franka")
    monkeypatch.setitem(sys.modules, "pylibfranka", panda_loop)
    press_until_tick_5(loop, lambda: arm.state.O_T_EE.__setitem__(12, float("nan")))
    said, torques = call(stored(tmp_path, bundles.small()), *SHORT, code=1)
    assert "the arm's position was not finite" in said
    assert fades(torques, 21)
    panda.stop_controller.assert_called_once_with()
    assert max(max(row) for row in arm.thresholds) == 40


def test_thresholds_tip_and_kernel_are_options_with_safe_defaults(loop, call, tmp_path):
    path = stored(tmp_path, bundles.small())
    call(path, *SHORT)
    assert loop.arm.config == "enforce"
    assert max(max(row) for row in loop.arm.thresholds) <= 40
    words = ["--collision-force", "15", "--collision-torque", "12", "--tool-tip", "0,0,0.1"]
    call(path, *SHORT, "--no-real-time", *words)
    assert loop.arm.config == "ignore"
    assert loop.arm.thresholds == ([12.0] * 7, [12.0] * 7, [15.0] * 6, [15.0] * 6)
    offset, state = np.array([0, 0, 0.1]), loop.arm.state
    assert loop.read_tip(state, offset) == pytest.approx(loop.read_tip(state) + offset)
    jacobian = loop.tip_jacobian(state, loop.arm.load_model(), offset)
    assert jacobian[:3, 3] == pytest.approx([0, -0.1, 0]), "a turn about x moves the tip along -y"
    call(path, *SHORT, "--tool-tip", "0,0,100", code=2)


def test_the_loop_stops_at_a_bad_force(loop):
    run, torques = stop_at_tick_5(loop, Pushing(lambda tick: np.nan), small_governor())
    assert "In tick 0 the force was not finite" in run.error
    assert run.ticks == 1
    assert not torques.any()


@pytest.mark.parametrize("beside", [0.002, -0.002, 0.0])
def test_the_loop_does_not_start_inside(beside, loop, call, tmp_path):
    loop.arm.press(0.006 - beside)
    log = tmp_path / "log.csv"
    said, torques = call(stored(tmp_path, bundles.small()), *SHORT, "--log", log, code=1)
    assert "is inside the fixture" in said
    assert len(torques) == 0
    assert not log.exists()


@pytest.mark.parametrize("is_governed", [True, False])
def test_the_log_is_a_session_that_a_replay_repeats_to_the_bit(is_governed, loop, call, tmp_path):
    path, log = stored(tmp_path, bundles.small()), tmp_path / "log.csv"
    loop.arm.lives = lambda tick: loop.arm.press(0.0002)
    words = [path, *SHORT, *([] if is_governed else ["--no-governor"]), "--log"]
    said, torques = call(*words, log)
    assert "status: all well" in said
    assert len(torques) == 20
    rows = np.genfromtxt(log, delimiter=",", names=True)
    assert np.array_equal(rows["t"], np.arange(21) / 1000)
    again = vfplan.ProxyEngine.of(vfplan.read_fixture(path))
    session = vfplan.read_session(log)
    again.reset(session.hip[0])
    trace = again.run(session.hip)
    columns = {
        name: np.stack([rows[f"{name}_{axis}"] for axis in "xyz"], axis=1)
        for name in ("proxy", "force", *["engine"] * is_governed)
    }
    assert np.array_equal(columns["proxy"], trace.proxy)
    assert np.array_equal(columns["engine" if is_governed else "force"], trace.force)
    assert np.array_equal(rows["state"], trace.state)
    assert np.array_equal(rows["status"], trace.status)
    assert np.abs(trace.force).max() > 1
    assert np.array_equal(columns["force"][:, 1], [0, *torques[:, 1]])

    assert "the log is there already" in call(*words, log, code=2)[0]
    call(*words, tmp_path / "none" / "log.csv", code=2)


@pytest.fixture(scope="module")
def loop_in_cpp(tmp_path_factory):
    """samples/franka/loop.cpp against tests/native/franka, a stub of libfranka, and a wall."""
    folder = tmp_path_factory.mktemp("franka")
    flags = ("-O1", "-DVFPLAN_NARROW", "-DVFPLAN_COMPILED", str(INCLUDE / "vfplan" / "engine.cpp"))
    program = compiled(folder, FOLDER / "loop.cpp", *flags, compiler=quick_compiler())
    rendering = fixtures.Rendering(np.full(3, 1000.0), contact_radius=5e-3, band=5e-5)
    wall = stored(folder, replace(bundles.small(), points=SHEET, rendering=rendering))
    return [program, wall]


@pytest.mark.parametrize("options, code, says", [
    ("signal --unsigned", 130, "enforce torque 40 force 40 cutoff 1000 tick 50"),
    ("signal --unsigned --collision-force 25 --no-real-time", 130, "ignore torque 40 force 25 "),
    ("nan --unsigned", 1, "stopped by itself: bits 1"), ("press --unsigned", 1, "the arm stopped"),
    ("start-inside --unsigned", 1, "the tip is inside"), ("signal --bad", 2, "unknown: --bad"),
    ("signal", 4, "without keys")])  # fmt: skip
def test_the_loop_in_cpp_asks_for_safety_fades_and_says_why(options, code, says, loop_in_cpp):
    words = [*map(str, loop_in_cpp), "--tool-tip", "0,0,-0.1", *options.split()]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert says in done.stdout + done.stderr
    if "cutoff" in done.stdout:
        step, most, last = map(float, done.stdout.split()[-5::2])
        assert 1.8 < most < 2.2
        assert step <= 0.95
        assert last == 0
