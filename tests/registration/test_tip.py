"""The tip of a tool: closed form without noise, coverage of its 95 % error, and refusals."""

from __future__ import annotations

import json
import shlex

import numpy as np
import pytest
from conftest import ELBOW
from refusals import refuses
from scipy.spatial.transform import Rotation

import vfplan
from vfplan.errors import MarkerError
from vfplan.registration.tip import calibrate_tip

TIP, PIVOT = np.array([0.003, -0.005, -0.2]), np.array([0.5, 0.1, 0.05])


def pivoted(rng, n, tilt_deg, noise_m=0.0, noise_deg=0.0):
    """(n, 4, 4) poses of a tool whose tip stands on the pivot, tilted up to `tilt_deg`."""
    about = rng.uniform(0, 2 * np.pi, n)
    tilts = np.radians(tilt_deg) * np.sqrt(rng.random(n))
    axes = np.column_stack([np.cos(about), np.sin(about), np.zeros(n)])
    spins = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi, (n, 1)))
    turned = Rotation.from_rotvec(tilts[:, None] * axes) * spins
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, 3] = PIVOT - turned.apply(TIP) + noise_m * rng.normal(size=(n, 3))
    shaken = Rotation.from_rotvec(np.radians(noise_deg) * rng.normal(size=(n, 3)))
    poses[:, :3, :3] = (turned * shaken).as_matrix()
    return poses


def test_exact_poses_give_the_tip_and_the_pivot():
    tip = calibrate_tip(pivoted(np.random.default_rng(1), 12, 40))
    np.testing.assert_allclose(tip.offset_m, TIP, atol=1e-12)
    np.testing.assert_allclose(tip.pivot_m, PIVOT, atol=1e-12)
    assert max(tip.error95_m, tip.residual_rms_m) < 1e-12


@pytest.mark.parametrize("noise_m, noise_deg", [(3e-4, 0), (1e-4, 0.2), (3e-4, 0.3)])
def test_the_error_holds_in_95_of_100_sets(noise_m, noise_deg):
    rng = np.random.default_rng(7)
    inside = []
    for _ in range(1000):
        sets = pivoted(rng, rng.integers(8, 60), rng.uniform(30, 60), noise_m, noise_deg)
        tip = calibrate_tip(sets)
        inside.append(np.linalg.norm(tip.offset_m - TIP) <= tip.error95_m)
    assert 0.93 <= np.mean(inside) <= 0.98


def test_poses_that_do_not_determine_it_are_refused():
    rng = np.random.default_rng(2)
    about_one = np.tile(np.eye(4), (20, 1, 1))
    turned = Rotation.from_euler("x", np.linspace(-60, 60, 20)[:, None], degrees=True)
    shaken = Rotation.from_rotvec(np.radians(0.3) * rng.normal(size=(20, 3)))
    about_one[:, :3, :3] = (turned * shaken).as_matrix()
    with refuses(MarkerError, "tip-not-determined"):
        calibrate_tip(about_one)


def quaternions(poses):
    xyzw = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    return np.column_stack([poses[:, :3, 3], xyzw[:, 3:], xyzw[:, :3]])


NAMES = "t,x,y,z,qw,qx,qy,qz"
LAYOUTS = {
    "7 numbers": (quaternions, "", ()),
    "with names": (lambda p: np.column_stack([np.arange(len(p)), quaternions(p)]), NAMES, ()),
    "columns": (lambda p: p.transpose(0, 2, 1).reshape(-1, 16), "", ()),
    "rows": (lambda p: p.reshape(-1, 16), "", ("--row-major",)),
}


@pytest.mark.parametrize("rows, header, words", LAYOUTS.values(), ids=LAYOUTS)
def test_every_layout_gives_the_same_tip(rows, header, words, vfplan_cli, tmp_path):
    poses = pivoted(np.random.default_rng(3), 20, 40, 1e-4)
    poses[:, :3, 3] *= 1e3
    np.savetxt(tmp_path / "p.csv", rows(poses), "%.17g", ",", header=header, comments="")
    words = ("tip", tmp_path / "p.csv", "--units", "mm", *words, "--json")
    found = vfplan_cli(*words).sound.json
    assert np.linalg.norm(found["tip_m"] - TIP) < found["error95_m"] < 2e-4
    assert shlex.split(found["next"])[-1] == f"tre95+{1e3 * found['error95_m']:.3f}"


def test_a_bundle_names_the_tool_that_touched_its_markers(vfplan_cli, tmp_path):
    poses = pivoted(np.random.default_rng(3), 20, 40, 1e-4)
    np.savetxt(tmp_path / "p.csv", quaternions(poses), "%.17g", ",")
    vfplan_cli("tip", tmp_path / "p.csv", "--tool", "probe 1", "-o", tmp_path / "tip.json")
    path = tmp_path / "f.h5"
    vfplan_cli("plan", *ELBOW, "-o", path, "--no-sheet", "--tip", tmp_path / "tip.json")
    record = vfplan.read_fixture(path).registration
    assert record.tool == "probe 1"
    assert np.abs(record.tip - TIP).max() < 2e-4
    words = ("plan", *ELBOW, "-o", path, "--overwrite", "--tip", tmp_path / "p.csv", "--json")
    vfplan_cli(*words).fails(3, error="tip-file")
    tip = json.loads((tmp_path / "tip.json").read_text())
    tip["tip_m"] = [1e-3 * x for x in tip["tip_m"]]
    (tmp_path / "p.csv").write_text(json.dumps(tip))
    vfplan_cli(*words).fails(1, error="tip-unit")


@pytest.mark.parametrize(
    "row, code",
    [("1,2,3,0,0,0,2", "pose-invalid"), ("1,2,3,1", "pose-columns"),
     (5 * "1,2,3,1,0,0,0\n", "tip-few-poses"), (6 * "1,2,3,1,0,0,0\n", "tip-not-determined")],
)  # fmt: skip
def test_what_is_no_pose_is_refused(row, code, vfplan_cli, tmp_path):
    (tmp_path / "p.csv").write_text(f"{row}\n")
    assert vfplan_cli("tip", tmp_path / "p.csv", "--json").fails(3, "p.csv: ", error=code)


@pytest.mark.parametrize(
    "words, spoil, code",
    [((), lambda rows: rows * [1e3, 1e3, 1e3, 1, 1, 1, 1], "tip-unit"),
     (("--units", "mm"), lambda rows: rows, "tip-unit"),
     ((), lambda rows: rows[:, [0, 1, 2, 4, 5, 6, 3]], "tip-error-large"),
     ((), lambda rows: rows + 0.008 * (np.arange(140).reshape(20, 7) == 28), "tip-pose-off"),
     (("--max-error", "0.01"), lambda rows: rows, "tip-error-large")],
)  # fmt: skip
def test_a_wrong_unit_a_wrong_order_and_a_bad_pose_are_refused(
    words, spoil, code, vfplan_cli, tmp_path
):
    rows = quaternions(pivoted(np.random.default_rng(3), 20, 40, 1e-4))
    np.savetxt(tmp_path / "p.csv", spoil(rows), "%.9g", ",")
    vfplan_cli("tip", tmp_path / "p.csv", *words, "--json").fails(1, error=code)
