"""`vfplan rehearse` and `plan --rehearse`: files, exit codes, and nothing left behind."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from conftest import ELBOW, file_with, names_in
from replays import fixture_of, write_session

import vfplan


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A wall before the arm, and a hand that presses on it."""
    folder = tmp_path_factory.mktemp("rehearse")
    x = np.arange(0.0, 0.06, 2e-4)
    points = np.stack([0.45 + x, 0 * x, 0 * x + 0.3], axis=1)
    vfplan.write_fixture(fixture_of(points), folder / "wall.h5")
    t = np.arange(0.0, 0.8, 0.01)
    hip = np.stack([0.48 + 0 * t, 0.02 - 0.02 * t / 0.8, 0.3 + 0 * t], axis=1)
    write_session(folder / "hand.csv", vfplan.Session(t, hip))
    return folder / "wall.h5", folder / "hand.csv"


def test_the_report_has_its_keys_and_the_files_appear(scene, vfplan_cli, tmp_path):
    out, page = tmp_path / "r.h5", tmp_path / "page"
    done = vfplan_cli("rehearse", *scene, "-o", out, "--report", page, "--json").sound
    found = done.json
    for key in (
        "ticks", "duration_s", "reflexes", "torque_step_max_nm", "torque_max_nm", "elapsed_s",
        "joint_margin_min_rad", "condition_max", "mass_min_kg", "force_max_n", "force_step_max_n",
        "clearance_min_m", "reachable", "governor",
    ):  # fmt: skip
        assert key in found
    assert (found["reachable"], found["reflexes"]) == (True, [])
    assert "resampled to the arm's 1000 Hz" in done.stderr
    text = (page / "index.html").read_text()
    about = text.split("What the arm said")[0]
    assert re.search(r"fixture&#x27;s SHA-256</td><td><code class=\"digest\">[0-9a-f]{64}", about)
    assert "vfplan rehearse" in about
    result, attrs = vfplan.read_result(out)
    assert len(result.time) == found["ticks"] == 791
    held = attrs["rehearsal"]
    assert (json.loads(held) if isinstance(held, str) else held)["arm"] == "panda"
    assert "PASS" in text
    assert re.search("reachable</td><td[^>]*>yes<", text)
    assert text.count("data:image/png") == 2


def test_an_arm_that_would_stop_ends_with_one(scene, vfplan_cli, tmp_path, root):
    page = tmp_path / "page"
    done = vfplan_cli("rehearse", *scene, "--base=-0.6,0,0", "--arm", "fr3", "--report",
                      page).fails(1)  # fmt: skip
    assert "NOT every place reached" in done.stdout
    assert "FAIL: fr3 does not reach" in (page / "index.html").read_text()
    weak = tmp_path / "weak.toml"
    shipped = (root / "schemas" / "robots" / "franka.toml").read_text()
    weak.write_text(shipped.replace("force_limit_n = 20.0", "force_limit_n = 2.0"))
    for output, more in (("-o", " --overwrite --report DIR"), ("--report", " less there")):
        run = vfplan_cli("rehearse", *scene, "--robot", weak, output, tmp_path / f"r{output}.h5")
        assert " N, 2 N allowed" in run.fails(1).stderr
        assert run.stdout.endswith(f"{more}\n")


def test_bad_calls(scene, vfplan_cli, tmp_path):
    model = file_with(tmp_path / "arm.xml", "<mujoco><include file='a'/></mujoco>")
    for code, words, *more in (
        (2, "Name a robot with --robot", "--arm", model),
        (3, "<include> is not allowed", "--arm", model, "--robot", "franka"),
        (3, "panda, fr3 or an MJCF file", "--arm", "kuka", "--robot", "franka"),
        (2, "Type 3 or 7", "--base", "1,2"),
    ):
        vfplan_cli("rehearse", *scene, *more, "-o", tmp_path / "r.h5").fails(code, words)
    assert not (tmp_path / "r.h5").exists()


def test_plan_rehearses_before_it_writes(vfplan_cli, tmp_path):
    out, far = tmp_path / "good.h5", tmp_path / "far.h5"
    asked = (*ELBOW, "--pixel-spacing", "0.5", "--rehearse", "panda")
    good = vfplan_cli("plan", *asked, "--base", "0.15,0,0", "-o", out, "--json").sound
    ways = [found["way"] for found in good.json["rehearsal"]]
    assert ways == ["stroke 0, left side", "stroke 0, right side"]
    assert all(found["reachable"] and not found["reflexes"] for found in good.json["rehearsal"])
    bad = vfplan_cli("plan", *asked, "--base=-0.5,0,0", "-o", far).fails(1)
    assert "arm panda, stroke 0, left side: not reached" in bad.stderr
    for lone in (("--base", "0,0,0"), ("--tool", "0,0,0.1")):
        vfplan_cli("plan", *ELBOW, *lone, "-o", far).fails(2, "without --rehearse ARM")
    assert not far.exists()


@pytest.mark.full
def test_the_experiments_on_the_simulated_arm_leave_their_pictures(tmp_path, vfplan_cli):
    found = vfplan_cli("demo", "panda", "-o", tmp_path / "demo", "--json").sound.json
    assert sorted(found["files"]) == names_in(tmp_path / "demo")
    for numbers in found["experiments"].values():
        assert numbers["reachable"]
        assert numbers["slope_n_per_m"] == pytest.approx(1000, rel=0.02)


def test_gaps_of_a_session_that_is_resampled_are_told(scene, vfplan_cli, tmp_path):
    fixture, session = scene
    lines = session.read_text().splitlines()
    with_gap = file_with(tmp_path / "gap.csv", "\n".join(lines[:20] + lines[25:]) + "\n")
    told = vfplan_cli("rehearse", fixture, with_gap, "--json").stderr
    assert "about 5 samples are missing" in told
    assert "samples are missing" not in vfplan_cli("rehearse", *scene, "--json").stderr
