"""`vfplan plan`, `extract` and `register` as scripts meet them: exit codes, JSON, no litter."""

from __future__ import annotations

import os
import shlex
import sys

import numpy as np
import pytest
from conftest import ELBOW, names_in, output

import vfplan

IMAGE, PIXELS, ROBOT = ELBOW

REGISTER_KEYS = {
    "model", "markers", "T_robot_image", "fre_rms_m", "loo_rms_m", "tre_rms_m", "residuals",
    "outliers", "condition", "scale_m_per_px", "points", "spacing_m",
    "sampling_error_m", "left_out", "elapsed_s", "fle_rms_m", "shear", "anisotropy", "tre",
}  # fmt: skip
EXTRACT_KEYS = {
    "image", "mask_pixels", "strokes", "points", "spacing_mm", "density_per_mm", "elapsed_s",
}  # fmt: skip


def test_plan_writes_a_fixture_and_reports_both_steps(vfplan_cli, tmp_path):
    path = tmp_path / "f.h5"
    run = vfplan_cli("plan", *ELBOW, "-o", path, "--pixel-spacing", 0.5, "--json").sound
    assert set(run.json["extract"]) >= EXTRACT_KEYS
    report = run.json["register"]
    assert set(report) >= REGISTER_KEYS
    told = report["model"], report["markers"], len(report["tre"]["worst_source"])
    assert told == ("affine", 9, 2)
    assert {"label", "residual_m", "leverage", "loo_m", "f"} <= set(report["residuals"][0])
    assert report["tre_rms_m"] < report["tre"]["bound95_max_m"] < report["tre"]["curve95_max_m"]
    fixture = vfplan.read_fixture(path)
    record = fixture.registration
    assert record.covariance.shape == (9, 9)
    np.testing.assert_allclose(record.T_robot_image, report["T_robot_image"], rtol=1e-12)
    np.testing.assert_allclose(record.tre_rms_m, report["tre_rms_m"], rtol=0.02)
    assert (fixture.points.shape, fixture.frame) == ((report["points"], 3), "robot_base")
    assert fixture.stiffness.tolist() == [1000.0] * 3
    assert sorted(tmp_path.iterdir()) == [tmp_path / "f-sheet.png", path]


def test_plan_without_a_sheet_imports_no_more_than_it_needs(tmp_path):
    """Each of these costs more time than extracting the sample's curve."""
    words = [str(word) for word in ("plan", *ELBOW, "-o", "f.h5", "--no-sheet")]
    code = (
        "import atexit, sys; from vfplan.cli.main import cli; "
        f"atexit.register(lambda: print(*sys.modules)); cli({words!r})"
    )
    loaded = set(output(sys.executable, "-c", code, cwd=tmp_path).splitlines()[-1].split())
    assert (tmp_path / "f.h5").exists()
    assert {"numpy", "cv2", "h5py"} <= loaded
    assert not loaded & {
        "scipy", "skimage", "matplotlib", "pydicom", "jsonschema", "cryptography",
        "numpy.f2py", "numpy.polynomial", "importlib.metadata", "importlib.resources",
        "tempfile", "vfplan.cli.review",
    }  # fmt: skip


def test_plan_without_an_output_writes_into_the_working_folder(vfplan_cli, tmp_path):
    run = vfplan_cli("plan", *ELBOW, "--json", cwd=tmp_path).sound
    assert names_in(tmp_path) == ["elbow-sheet.png", "elbow.h5"]
    assert (run.json["output"], run.json["sheet"]) == ("elbow.h5", "elbow-sheet.png")
    vfplan_cli("plan", *ELBOW, "--json", cwd=tmp_path).fails(2, error="output-exists")


def test_extract_then_register_is_plan(vfplan_cli, tmp_path):
    env = {"SOURCE_DATE_EPOCH": "1700000000"}
    curve, two, one = (tmp_path / name for name in ("c.h5", "two.h5", "one.h5"))
    run = vfplan_cli("extract", IMAGE, "-o", curve, "--pixel-spacing", 0.5, "--json").sound
    assert set(run.json) >= EXTRACT_KEYS
    assert vfplan.read_fixture(curve).frame == "image"
    short = vfplan_cli("register", curve, PIXELS, ROBOT, "-o", two, env=env).sound.stdout
    long = vfplan_cli("plan", *ELBOW, "-o", one, "--pixel-spacing", 0.5, "-v", env=env).sound.stdout
    assert ("leverage" in short, "leverage" in long) == (False, True)
    a, b = vfplan.read_fixture(one), vfplan.read_fixture(two)
    assert np.array_equal(a.points, b.points)
    assert a.provenance.settings == b.provenance.settings
    assert a.provenance.created_utc == b.provenance.created_utc == "2023-11-14T22:13:20Z"


def test_options_reach_the_bundle(vfplan_cli, tmp_path):
    path = tmp_path / "f.h5"
    run = vfplan_cli(*("plan", *ELBOW, "-o", path, "--stiffness", "500,600,700"),
                     *("--contact-radius", 4, "--point-radius", 1, "--ignore-axis", "z",
                       "--density", 2, "-q"))  # fmt: skip
    assert (run.code, run.stdout) == (0, "")
    fixture = vfplan.read_fixture(path)
    assert fixture.stiffness.tolist() == [500, 600, 700]
    assert (fixture.contact_radius, fixture.point_radius) == (4e-3, 1e-3)
    assert fixture.ignore_axis.tolist() == [0, 0, 1]


def grey(tmp_path):
    import cv2

    path = tmp_path / "grey.png"
    cv2.imwrite(str(path), np.full((60, 60, 3), 128, np.uint8))
    return path


BAD = {
    "no red in the image": lambda t: (grey(t), PIXELS, ROBOT),
    "a directory for an image": lambda t: (t, PIXELS, ROBOT),
    "no image at all": lambda t: (PIXELS, PIXELS, ROBOT),
    "the same side twice": lambda t: (IMAGE, ROBOT, ROBOT),
}


@pytest.mark.parametrize("option, message", [
    (("--mask-out", "m.jpg"), "has suffix '.jpg'. End the name in .png"),
    (("-o", "curve.csv"), "End the name in .h5 or .hdf5"), (("-o", "-"), "has no suffix"),
    (("--pixel-spacing", "0.5,1e-300"), "Give 1e-05 to 1000 mm"),
    (("--contact-radius", "0.005"), "contact radius is 0.005 mm. Give 0.01 to 1000 mm"),
    (("--point-radius", "1e300"), "point radius is 1e+300 mm. Give 0 to 1000 mm"),
    (("--point-radius", "nan"), "'nan' is no number"),
    (("--stiffness", "10,1e300,10"), "stiffness is 1e+300 N/m. Give 0 to 1e+06 N/m"),
    (("--seen-from", "left"), "Type above, below"),
    (("--roi", "1e300,0,1,1"), "holds a number that no image's pixels reach"),
    (("--roi", "0.4,0,100,100"), "whole"), (("--roi", "nan,0,100,100"), "roi"),
    (("--roi", "1,2"), "roi"), (("--colour", "grey"), "colour"), (("--method", "magic"), "magic"),
    (("--stiffness", "1,2"), "Type 1 or 3"), (("--pixel-spacing", "a"), "is no number"),
    (("--tolerance", "0.01", "--density", "2"), "exclude each other"),
    (("--ignore-axis", "w"), "'w' is not one of"), (("--ignore-axis", "x"), "collapse the curve"),
    (("--stroke", "first"), "Type all, longest"), (("--no-such-option",), "no-such-option"),
    (("--guide", "0.1", "--arcs", "0.05"), "csv --guide 0.1 --arcs 0.05 -o "),
])  # fmt: skip
def test_settings_out_of_range_are_usage(vfplan_cli, tmp_path, option, message):
    vfplan_cli("plan", *ELBOW, "-o", tmp_path / "f.h5", *option).fails(2, message)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name, value, says", [
    ("--stroke", 9, ""), ("--start", "5,5", "--start 5,5 lies"), ("--settings", '{"stroke": 9}', "")
])  # fmt: skip
def test_the_page_of_a_refusal_opens_without_what_was(vfplan_cli, tmp_path, name, value, says):
    kept = ("--margin", "tre95", "-o", tmp_path / "f.h5")
    refused = vfplan_cli("plan", *ELBOW, name, value, *kept).fails(3, says)
    assert not (tmp_path / "f.h5").exists()
    page = shlex.split(refused.error_line.partition("on a page: ")[2])
    assert page == ["vfplan", "review", *map(str, (*ELBOW, *kept))]


def test_no_page_is_named_for_arcs_that_it_cannot_make_finer(vfplan_cli, tmp_path):
    run = vfplan_cli("plan", *ELBOW, "--guide", 0.015, "-o", tmp_path / "f.h5")
    assert "on a page" not in run.fails(2, "Give --arcs").error_line


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_clear_line_and_leaves_nothing(vfplan_cli, tmp_path, case):
    folder = tmp_path / "out"
    folder.mkdir()
    args = ("plan", *BAD[case](tmp_path), "-o", folder / "f.h5", "--mask-out", folder / "m.png")
    run = vfplan_cli(*args).fails(3)
    assert run.stdout == ""
    assert run.error_line.startswith("vfplan: error: ")
    assert not any(folder.iterdir())
    again = vfplan_cli(*args, "--json").fails(3)
    assert set(again.json["error"]) == {"kind", "message", "where", "code", "numbers"}


@pytest.mark.parametrize("command", ["plan", "review"])
@pytest.mark.parametrize("files", [
    (PIXELS, IMAGE), (PIXELS, IMAGE, ROBOT), (PIXELS, ROBOT, IMAGE), (ROBOT, PIXELS)])  # fmt: skip
def test_the_wrong_order_is_named_with_the_right_one(command, files, vfplan_cli, tmp_path):
    run = vfplan_cli(command, *files, "-o", tmp_path / "f.h5",
                     "--json").fails(3, error="wrong-order")  # fmt: skip
    assert run.json["error"]["where"] == str(files[0])
    assert "IMAGE MARKERS" in run.json["error"]["message"]


@pytest.mark.parametrize("name, error", [
    ("none.png", "file-missing"), ("fifo", "not-a-file"), ("curve.csv", None)])  # fmt: skip
def test_what_is_no_wrong_order_is_not_called_one(name, error, vfplan_cli, tmp_path):
    (tmp_path / "curve.csv").write_text("u_px,v_px\n100,100\n200,200\n")
    os.mkfifo(tmp_path / "fifo")
    run = vfplan_cli("plan", tmp_path / name, PIXELS, ROBOT, "-o", tmp_path / "f.h5", "--json")
    assert run.json.get("error", {}).get("code") == error


def test_a_case_that_nobody_can_read_is_refused_before_anything_is_planned(vfplan_cli, tmp_path):
    vfplan_cli("plan", *ELBOW, "--case", "a\u202eb", "-o", tmp_path / "f.h5").fails(2, "case")
    assert not list(tmp_path.iterdir())
