"""A Franka's own protocol: raw, its limits stop the arm; governed, they do not.

Needs the environment of `make franka-env`: the protocol's simulator and Franka's own binding.
"""

from __future__ import annotations

import json
import subprocess

import numpy as np
import pytest
from conftest import ROOT, missing

import vfplan
from vfplan.arm import Arm
from vfplan.arm.loop import Hand, run_loop
from vfplan.arm.safety_stops import safety_stops

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
    stops = np.array(study.PRESSED) - study.PRESSED[0] + home
    share = np.linspace(0, 2, 1500)
    wanted = np.stack([np.interp(share, [0, 1, 2], column) for column in stops.T], axis=1)
    errors = {}
    for what in ("all three", "a new engine and a reset"):
        engine = Rendering(study.Changing(what, home - study.PRESSED[0], 2000.0))
        limits = vfplan.Governor.of(arm.robot, 2000.0, torques=True) if governed else None
        motion = run_loop(arm, engine, limits, wanted, arm.ready, Hand(study.HAND, study.DAMPER))
        errors[what] = {reflex["kind"] for reflex in safety_stops(arm, motion)}
        assert np.abs(motion.rendered).max() > 2
    raw = set() if governed else {"controller_torque_discontinuity"}
    assert errors == {"all three": set(), "a new engine and a reset": raw}
