"""A Franka's own protocol: raw, its limits stop the arm; governed, they do not.

Needs the environment of `make franka-env`: the protocol's simulator and Franka's own binding.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import bundles
import numpy as np
import pytest
from conftest import ROOT, missing

import vfplan
from vfplan.arm import Arm, ArmHand, run_loop, safety_stops
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


def runs(scene):
    """One raw run and two governed ones over the protocol."""
    if not PYTHON.exists():
        missing("no .venv-franka: `make franka-env` makes it")
    for attempt in range(3):  # a busy machine loses packets; what counts are the arm's limits
        done = subprocess.run(
            [PYTHON, "-P", "-c", RUN, FOLDER, scene], capture_output=True, text=True, timeout=300
        )
        assert done.returncode == 0, done.stderr
        rows = json.loads(done.stdout)
        errors = [run["error"] or "" for _, run in rows]
        if attempt == 2 or not any("communication" in error for error in errors):
            break
    return [run for governed, run in rows if not governed], [
        run for governed, run in rows if governed
    ]


def test_the_governor_keeps_the_arm_from_stopping():
    raw, held = runs("edge of a sheet")
    assert all("controller_torque_discontinuity" in run["error"] for run in raw)
    assert [run["error"] for run in held] == [None, None]
    assert all(run["force_step_n"] > 3 for run in held)


@pytest.mark.full
@pytest.mark.parametrize("scene", ["it moves", "it is exchanged", "it is edited", "all three"])
def test_nothing_that_moves_or_changes_stops_the_arm(scene):
    """Neither governed nor raw: the pace alone holds it."""
    raw, held = runs(scene)
    assert [run["error"] for run in raw + held] == [None] * 3
    assert all(run["force_max_n"] > 2 for run in held)


@pytest.mark.full
def test_a_new_engine_and_a_reset_do():
    raw, held = runs("a new engine and a reset")
    assert "controller_torque_discontinuity" in raw[0]["error"]
    assert [run["error"] for run in held] == [None, None]


class FakeArm:
    """An arm that lies still at a place, for the loop alone; it keeps the torques it is given."""

    def __init__(self, tip):
        transform = np.eye(4)
        transform[:3, 3] = tip
        self.state = SimpleNamespace(O_T_EE=transform.T.ravel().tolist(), dq=[0.0] * 7)
        self.torques = []

    def load_model(self):
        jacobian = np.eye(6, 7)
        return SimpleNamespace(zero_jacobian=lambda state: jacobian.T.ravel().tolist())

    def read_once(self):
        return self.state

    def start_torque_control(self):
        return SimpleNamespace(
            readOnce=lambda: (self.state, 0.001),
            writeOnce=lambda command: self.torques.append(command.torque),
        )

    def automatic_error_recovery(self):
        pass

    def set_collision_behavior(self, *thresholds):
        pass


@pytest.fixture
def loop(monkeypatch):
    """The module loop.py, with a binding of Franka's that knows one arm."""
    arm = FakeArm(bundles.small().points[0] + [0, 0.004, 0])
    library = SimpleNamespace(
        Robot=lambda host, config: arm,
        RealtimeConfig=SimpleNamespace(kIgnore=0),
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
SHORT = ("--robot", "arm", "--seconds", "0.02")


def test_the_loop_refuses_open_findings_unless_told(loop, tmp_path, capsys):
    open_one = doubt("end-other-colour", "extract", "The end lies under other ink.")
    path = str(tmp_path / "open.h5")
    vfplan.write_fixture(replace(bundles.small(), findings=(open_one,)), path)
    assert loop.main([path, *SHORT, "--unsigned"]) == 4
    assert "end-other-colour" in capsys.readouterr().err
    assert loop.arm.torques == []
    assert loop.main([path, *SHORT, "--unsigned", "--despite-findings"]) == 0
    assert len(loop.arm.torques) == 20


def test_the_loop_demands_a_signature_unless_told(loop, tmp_path, capsys):
    from vfplan.bundle import keygen, sign

    path, signed = tmp_path / "plain.h5", str(tmp_path / "signed.h5")
    vfplan.write_fixture(bundles.small(), path)
    keys = str(keygen(tmp_path / "k")[0])
    sign(path, signed, tmp_path / "k", case="17", despite_findings=True)
    for words in (
        [str(path), *SHORT],
        [str(path), *SHORT, "--unsigned", "--case", "17"],
        [str(path), *SHORT, "--unsigned", "--max-age", "60s"],
        [str(path), *SHORT, "--require-signature", keys, "--max-age", "43200"],
        [str(path), "--robot", "arm", "--unsigned", "--seconds", "0"],
        [str(path), *SHORT, "--unsigned", "--require-signature", keys],
    ):
        with pytest.raises(SystemExit) as stopped:
            loop.main(words)
        assert stopped.value.code == 2
    demands = ["--keys", keys, "--max-age", "2d"]
    refused = SignatureError.exit_code
    assert loop.main([str(path), *SHORT, *demands]) == refused
    assert loop.main([signed, *SHORT, *demands, "--case", "18"]) == refused
    assert loop.arm.torques == []
    assert loop.main([signed, *SHORT, *demands, "--case", "17"]) == 0
    assert len(loop.arm.torques) == 20


def test_the_loop_refuses_a_fixture_in_another_frame(loop, tmp_path, capsys):
    path = str(tmp_path / "patient.h5")
    fixture = replace(bundles.small(), frame="patient_lps", rendering=None, registration=None)
    vfplan.write_fixture(fixture, path)
    assert loop.main([path, *SHORT, "--unsigned"]) == 3
    assert (
        capsys.readouterr().err.splitlines()[-1].startswith(f"{path}: the fixture is in the frame")
    )
    assert loop.arm.torques == []


def test_the_loop_takes_no_guide_and_no_fixture_without_rendering(loop, tmp_path, capsys):
    for name, fixture in (("guide", bundles.guided()), ("bare", bundles.minimal())):
        vfplan.write_fixture(fixture, tmp_path / f"{name}.h5")
        words = [str(tmp_path / f"{name}.h5"), *SHORT, "--unsigned", "--despite-findings"]
        assert loop.main(words) == 3, name
    assert loop.arm.torques == []


@pytest.mark.parametrize("governed", [True, False])
def test_a_bad_position_ends_the_loop_and_its_torque(governed, loop, tmp_path, capsys):
    """The tip presses, and from tick 5 on its position is not a number."""
    path = str(tmp_path / "f.h5")
    vfplan.write_fixture(bundles.small(), path)
    control = loop.arm.start_torque_control()
    start = list(loop.arm.state.O_T_EE)
    ticks = iter(range(100))

    def read_once():
        tick = next(ticks)
        loop.arm.state.O_T_EE = list(start)
        loop.arm.state.O_T_EE[13] -= 0.0002 * tick
        if tick >= 5:
            loop.arm.state.O_T_EE[12] = float("nan")
        return loop.arm.state, 0.001

    loop.arm.start_torque_control = lambda: SimpleNamespace(
        readOnce=read_once, writeOnce=control.writeOnce
    )
    words = [] if governed else ["--no-governor"]
    assert loop.main([path, *SHORT, "--unsigned", *words]) == 1
    assert "In tick 5 the arm's position was not finite" in capsys.readouterr().err
    torques = np.array(loop.arm.torques)
    assert 6 <= len(torques) < 20
    assert not torques[-1].any()
    assert torques[4].any()


def test_a_bad_bundle_is_told_before_a_missing_binding(loop, monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "pylibfranka", None)
    whole, broken = tmp_path / "whole.h5", tmp_path / "broken.h5"
    vfplan.write_fixture(bundles.small(), whole)
    broken.write_bytes(whole.read_bytes()[:-5])
    for code, path in ((3, tmp_path / "none.h5"), (4, broken)):
        assert loop.main([str(path), *SHORT, "--unsigned"]) == code
        assert capsys.readouterr().err.startswith(f"{path}: ")
    assert loop.main([str(whole), *SHORT, "--unsigned"]) == 2
    assert "pylibfranka is not installed. " in capsys.readouterr().err


def test_an_arm_that_does_not_answer_ends_with_a_line(loop, monkeypatch, tmp_path, capsys):
    def refuse(host, config):
        raise RuntimeError("libfranka: Connection refused.")

    monkeypatch.setattr(sys.modules["pylibfranka"], "Robot", refuse)
    vfplan.write_fixture(bundles.small(), tmp_path / "f.h5")
    assert loop.main([str(tmp_path / "f.h5"), *SHORT, "--unsigned"]) == 1
    assert capsys.readouterr().err.splitlines()[-1].startswith("arm: the arm is not ready: ")


@pytest.mark.parametrize("number", STOP_SIGNALS)
def test_a_signal_ends_the_loop_and_its_torque(number, loop, tmp_path, capsys):
    """The tip presses, and in tick 5 somebody presses Ctrl-C."""
    vfplan.write_fixture(bundles.small(), tmp_path / "f.h5")
    loop.arm.state.O_T_EE[13] -= 0.002
    control = loop.arm.start_torque_control()
    ticks = iter(range(1000))

    def read_once():
        if next(ticks) == 5:
            signal.raise_signal(number)
        return loop.arm.state, 0.001

    loop.arm.start_torque_control = lambda: SimpleNamespace(
        readOnce=read_once, writeOnce=control.writeOnce
    )
    words = [str(tmp_path / "f.h5"), "--robot", "arm", "--seconds", "1", "--unsigned"]
    assert loop.main(words) == 128 + number
    assert "in tick 5" in capsys.readouterr().err
    torques = np.array(loop.arm.torques)
    assert 6 <= len(torques) < 100
    assert torques[4].any()
    assert not torques[-1].any()


class Rendering:
    """A scene as the rehearsal's loop takes an engine."""

    def __init__(self, scene):
        self.native, self.reset, self.scene = self, scene.reset, scene

    def step(self, hip):
        s = self.scene.step(hip)
        return (s.proxy, s.normal, s.force), s.state, s.status


@pytest.mark.parametrize("governed", [True, False])
def test_nothing_that_moves_or_changes_stops_the_rehearsals_arm(governed, monkeypatch):
    """All three at once, on MuJoCo's arm without the protocol; made anew, the raw arm stops."""
    monkeypatch.syspath_prepend(str(FOLDER))
    import study

    arm = Arm("fr3")
    arm.hold(arm.ready)
    home = arm.read_tip()[0].copy()
    stops = np.array(study.PRESSING_STOPS) - study.PRESSING_STOPS[0] + home
    share = np.linspace(0, 2, 1500)
    wanted = np.stack([np.interp(share, [0, 1, 2], column) for column in stops.T], axis=1)
    errors = {}
    for what in ("all three", "a new engine and a reset"):
        engine = Rendering(study.ChangingSheet(what, home - study.PRESSING_STOPS[0], 2000.0))
        limits = vfplan.Governor.of(arm.robot, 2000.0, torques=True) if governed else None
        motion = run_loop(
            arm,
            engine,
            limits,
            wanted,
            arm.ready,
            ArmHand(study.HAND_STIFFNESS_N_PER_M, study.HAND_DAMPING_NS_PER_M),
        )
        errors[what] = {reflex["kind"] for reflex in safety_stops(arm, motion)}
        assert np.abs(motion.rendered).max() > 2
    raw = set() if governed else {"controller_torque_discontinuity"}
    assert errors == {"all three": set(), "a new engine and a reset": raw}
