"""`vfplan register` and the registration options of `plan`: gates, margins, markers, pictures."""

from __future__ import annotations

import json
import shlex

import cv2
import numpy as np
import pytest
from conftest import ELBOW, names_in
from review_slices import miss, photographed
from slicer_files import mrk

import vfplan
from vfplan.images.raster import with_made_flat
from vfplan.images.read import read_image
from vfplan.planning.settings import FixtureSettings
from vfplan.settings import flat, recalled

IMAGE, PIXELS, ROBOT = ELBOW


@pytest.fixture(scope="module")
def curve(vfplan_cli, tmp_path_factory):
    path = tmp_path_factory.mktemp("curve") / "c.h5"
    assert vfplan_cli("extract", IMAGE, "-o", path, "--pixel-spacing", 0.5).sound
    return path


def rows(path):
    head, *lines = path.read_text().split()
    return head, [line.split(",") for line in lines]


def write(path, head, lines):
    path.write_text("\n".join([head, *(",".join(map(str, line)) for line in lines)]) + "\n")
    return path


def scaled(folder, factor):
    """The robot's markers in another unit, in a file of their own."""
    head, lines = rows(ROBOT)
    lines = [[label, *(factor * float(x) for x in xyz)] for label, *xyz in lines]
    return write(folder / "bad.csv", head, lines)


@pytest.mark.parametrize("spacing, severity", [
    ((), "doubt"), (("--pixel-spacing", 0.5), "note")])  # fmt: skip
def test_a_concluded_unit_is_a_doubt_where_no_scale_checks_it(
    vfplan_cli, tmp_path, spacing, severity
):
    named = write(tmp_path / "named.csv", "label,x,y,z", rows(ROBOT)[1])
    words = ("plan", IMAGE, PIXELS, named, "-o", tmp_path / "f.h5", "--no-sheet", *spacing)
    found = vfplan_cli(*words, "--json").sound.json["findings"]
    assert {f["code"]: f["severity"] for f in found}["unit-concluded"] == severity


@pytest.mark.parametrize("name, severity", [("label", "note"), ("Counter", "doubt")])
@pytest.mark.parametrize("height", [300, 400])
def test_a_symmetric_pattern_is_a_doubt_where_the_program_numbered_the_points(
    vfplan_cli, curve, tmp_path, name, severity, height
):
    points = [[k, 300 + 300 * (k % 2), 250 + height * (k > 2)] for k in range(1, 5)]
    touched = [[k, 6e-4 * u, 6e-4 * v, 2e-4 * k] for k, u, v in points]
    named = write(tmp_path / "i.csv", f"{name},X,Y", points)
    robot = write(tmp_path / "r.csv", "label,x_m,y_m,z_m", touched)
    run = vfplan_cli("register", curve, named, robot, "-o", tmp_path / "f.h5", "--json").sound
    found = {finding["code"]: finding["severity"] for finding in run.json["findings"]}
    assert found["layout-symmetric"] == severity


def test_gate(vfplan_cli, curve, tmp_path):
    out, picture = tmp_path / "f.h5", tmp_path / "p.png"
    common = ("register", curve, PIXELS, ROBOT, "-o", out, "--picture-out", picture)
    run = vfplan_cli(*common, "--max-tre", 0.1, "--json").fails(1, "--max-tre", error="tre-large")
    assert list(tmp_path.iterdir()) == []
    error = run.json["error"]
    assert (error["kind"], error["numbers"]["max_tre_m"]) == ("CheckFailed", pytest.approx(1e-4))
    vfplan_cli(*common, "--contact-radius", 0.1).fails(1, "0.1 mm (the contact radius)")
    assert vfplan_cli(*common, "--max-tre", 5).sound
    assert names_in(tmp_path) == ["f.h5", "p.png"]
    assert vfplan_cli("register", curve, PIXELS, ROBOT, "-o", out, "--max-tre", 0).code == 2


def test_a_robust_registration_names_what_it_leaves_out(vfplan_cli, curve, tmp_path):
    head, lines = rows(ROBOT)
    lines[3][1] = float(lines[3][1]) + 0.006
    bad, out = write(tmp_path / "bad.csv", head, lines), tmp_path / "a.h5"
    run = vfplan_cli("register", curve, PIXELS, bad, "-o", out, "--robust", "--json").sound
    assert (run.json["outliers"], run.json["robust"]) == (["x4"], {"used": 8})
    assert vfplan.read_fixture(out).provenance.settings["markers_left_out"] == "x4"


def test_markers_are_found_in_the_slice(vfplan_cli, curve, tmp_path):
    head, lines = rows(PIXELS)
    rough = write(tmp_path / "rough.csv", head,
                  [[a, round(float(u)) + 2, round(float(v)) - 2] for a, u, v in lines])  # fmt: skip
    out = tmp_path / "f.h5"
    exact = vfplan_cli("register", curve, PIXELS, ROBOT, "-o", out, "--json").json
    common = ("register", curve, rough, ROBOT, "-o", out, "--overwrite", "--json")
    run = vfplan_cli(*common, "--find-markers", "--image", IMAGE).sound
    found = run.json["markers_found"]
    assert len(found) == 9
    assert all(2 < marker["moved_px"] < 4 for marker in found)
    np.testing.assert_allclose(run.json["T_robot_image"], exact["T_robot_image"], atol=2e-4)
    assert vfplan_cli(*common, "--find-markers").code == 2
    vfplan_cli(*common, "--find-markers", "--image", IMAGE.with_name("none.png")).fails(3)
    words = ("plan", IMAGE, rough, ROBOT, "-o", tmp_path / "g.h5", "--find-markers")
    assert "px away" in vfplan_cli(*words).sound.stdout


def test_markers_in_centimetres_taken_for_metres_are_refused(vfplan_cli, curve, tmp_path):
    words = (curve, PIXELS, scaled(tmp_path, 100), "-o", tmp_path / "f.h5")
    vfplan_cli("register", *words).fails(3, "m (rms) from their centre")
    assert not (tmp_path / "f.h5").exists()


def test_a_fixture_larger_than_a_patient_is_doubted(vfplan_cli, tmp_path):
    """An affine registration fits any scale; without a known spacing the size alone tells."""
    bad = scaled(tmp_path, 20)
    drawn, out = tmp_path / "c.h5", tmp_path / "f.h5"
    assert vfplan_cli("extract", IMAGE, "-o", drawn).sound
    words = ["--density", "0.5", "--contact-radius", "100", "--max-residual", "none"]
    run = vfplan_cli("register", drawn, PIXELS, bad, "-o", out, *words).sound
    assert "Is a unit wrong?" in run.stderr
    assert "Is a unit wrong?" in vfplan_cli("validate", out).stdout


def test_slicer_target_markers_lead_into_the_patients_frame(vfplan_cli, curve, tmp_path):
    """The same map whether Slicer's file says LPS or RAS, and a fixture that no robot renders."""
    in_robot = vfplan_cli("register", curve, PIXELS, ROBOT, "-o", tmp_path / "r.h5", "--json").json
    points = [(label, [1e3 * float(x) for x in xyz], "defined") for label, *xyz in rows(ROBOT)[1]]
    flipped = [(label, [-x, -y, z], status) for label, (x, y, z), status in points]
    for name, text in (("lps", mrk(points)), ("ras", mrk(flipped, coordinateSystem="RAS"))):
        slicer, out = tmp_path / f"{name}.mrk.json", tmp_path / f"{name}.h5"
        slicer.write_text(text)
        run = vfplan_cli("register", curve, PIXELS, slicer, "-o", out, "--json").sound
        assert run.json["target_frame"] == "patient_lps"
        assert [f["code"] for f in run.json["findings"]] == ["target-not-robot"]
        T = run.json["T_robot_image"]
        np.testing.assert_allclose(T, in_robot["T_robot_image"], rtol=1e-9, atol=1e-12)
        fixture = vfplan.read_fixture(out)
        assert (fixture.frame, fixture.image, fixture.registration) == ("patient_lps", None, None)
        same = vfplan.read_fixture(tmp_path / "r.h5").points
        np.testing.assert_allclose(fixture.points, same, atol=1e-12)
        assert vfplan_cli("validate", out).sound
        vfplan_cli("stability", out, "--part", "closed-loop").fails(3, "robot_base")


def test_the_report_ends_with_a_verdict_and_the_next_step(vfplan_cli, tmp_path):
    curve, fixture = tmp_path / "curve.h5", tmp_path / "fixture.h5"
    run = vfplan_cli("extract", IMAGE, "-o", curve, "--pixel-spacing", "0.5", "--json")
    assert run.json["verdict"] == "extracted; no finding wants an answer"
    carried = tmp_path / "curve-fixture.h5"
    assert run.json["next"] == f"vfplan register {curve} MARKERS --image {IMAGE} -o {carried}"
    run = vfplan_cli("register", curve, PIXELS, ROBOT, "-o", fixture, "--image", IMAGE)
    verdict, following = run.stdout.strip().splitlines()[-2:]
    assert verdict == "verdict: registered; no finding wants an answer"
    approved = tmp_path / "fixture-approved.h5"
    assert following == f"next: vfplan review {fixture} --slice {IMAGE} -o {approved}"


def test_a_photograph_is_made_flat_and_planned_by_the_next_step(vfplan_cli, tmp_path):
    truth = json.loads(IMAGE.with_name("elbow_truth.json").read_text())["curve_px"]
    for seed in range(4):
        photo, marks, seen_by = photographed(tmp_path, seed)
        photo = photo.rename(tmp_path / f"my photo {seed}.png")
        # Of five markers too the refusal names the whole command.
        some = write(tmp_path / "five.csv", rows(marks)[0], rows(marks)[1][::2]) if seed else marks
        refused = vfplan_cli("plan", photo, some, ROBOT, "--common", cwd=tmp_path)
        words = refused.error_line[refused.error_line.rindex("vfplan rectify") :].split(" && ")[0]
        assert (refused.code, "on a page (vfplan review" in refused.error_line) == (1, True)
        made = vfplan_cli(*shlex.split(words)[1:], "--json", cwd=tmp_path).sound.json
        out = tmp_path / f"my photo {seed}-flat.png"
        assert made["residual_rms_m"] < made["marker_error_m"] < 5e-4
        planned = vfplan_cli(*shlex.split(made["next"])[1:], "--json", cwd=tmp_path).sound.json
        assert planned["output"] == f"my photo {seed}-flat-plan.h5"
        assert abs(planned["register"]["spacing_departure"][0]) < 2e-3
        assert "picture-made-flat" in [finding["code"] for finding in planned["findings"]]
        assert vfplan_cli("extract", out, "-o", tmp_path / f"c{seed}.h5").sound
        measured = vfplan.read_fixture(tmp_path / f"c{seed}.h5").points[:, :2]
        seen = cv2.perspectiveTransform(np.array([truth]), made["homography"] @ seen_by)[0]
        assert miss(measured, seen) < 0.3


def test_a_photograph_is_made_flat_and_planned_with_every_option_that_was_typed(
    vfplan_cli, tmp_path
):
    photo, marks, _ = photographed(tmp_path)
    typed = ["--contact-radius=4", "--guide", "1", "--case", "K1", "--colour", "red", "--no-sheet"]
    typed += ["--picture-out", "seen.png", "--max-residual", "0.9"]
    refused = vfplan_cli("plan", photo, marks, ROBOT, *typed, "-o", "x.h5", cwd=tmp_path)
    page, here = refused.error_line.split("on a page (")[1].split(") or with two commands: ")
    assert page.startswith("vfplan keygen -o planner.key && vfplan review ")
    assert page.endswith("--case K1 --colour red --max-residual 0.9 --key planner.key -o x.h5")
    for command in here.split(" && "):
        assert vfplan_cli(*shlex.split(command)[1:], cwd=tmp_path).sound
    fixture = vfplan.read_fixture(tmp_path / "x.h5")
    assert (fixture.contact_radius, fixture.guidance.radius, fixture.case) == (4e-3, 1e-3, "K1")
    assert (tmp_path / "seen.png").exists()
    assert not (tmp_path / "x-sheet.png").exists()
    assert fixture.image.pixel_spacing_mm[0] > 0

    # The same with the options in a settings file, of which each command takes its own.
    settings = {"contact_radius": 4e-3, "guide_m": 1e-3, "max_residual_m": 0.9 * 1e-3,
                "colour": "red", "common": True, "pixel_spacing_mm": [0.6, 0.6],
                "guide_pull": [1.5, 0.03], "max_tre_m": None, "stiffness": [300.0]}  # fmt: skip
    (tmp_path / "s.json").write_text(json.dumps(settings))
    typed = ["--settings", "s.json", "--contact-radius=3", "-o", "y.h5"]
    refused = vfplan_cli("plan", photo, marks, ROBOT, *typed, cwd=tmp_path)
    here = refused.error_line.split(") or with two commands: ")[1].split(" && ")
    assert '"common": true' in here[0]
    (tmp_path / "s.json").unlink()
    for command in here:
        assert vfplan_cli(*shlex.split(command)[1:], cwd=tmp_path).sound, command
    known = recalled(FixtureSettings, vfplan.read_fixture(tmp_path / "y.h5").provenance.settings)
    settings |= {"contact_radius": 3e-3, "common": False}
    for name in vars(known).keys() & settings.keys():
        assert flat(getattr(known, name)) == flat(settings[name]), name

    # A place on the photograph is another one on the flat picture.
    whole = ["--roi", "0,0,871,786", "--exclude=0,0,1,1", "--pixel-spacing", "0.6"]
    refused = vfplan_cli("plan", photo, marks, ROBOT, *whole, cwd=tmp_path)
    assert "_markers.csv --roi U,V,W,H --exclude=U,V,W,H -o " in refused.error_line


def test_a_marker_that_spoils_a_photograph_is_named_before_it_is_made_flat(vfplan_cli, tmp_path):
    photo, marks, _ = photographed(tmp_path)
    head, lines = rows(marks)
    lines[3] = [lines[3][0], float(lines[3][1]) + 6, float(lines[3][2]) - 4]
    words = (photo, write(tmp_path / "off.csv", head, lines), ROBOT, "--json")
    vfplan_cli("plan", *words, cwd=tmp_path).fails(1, f"without {lines[3][0]}")
    flat = tmp_path / "flat.png"
    vfplan_cli("rectify", *words, "-o", flat).fails(1, f"Without {lines[3][0]} it leaves")


def test_a_strong_angle_is_told_and_a_spoilt_word_of_it_is_refused(vfplan_cli, tmp_path):
    path = tmp_path / "flat.png"
    for text, codes in (
        ("0.2 2.9", ["picture-made-flat"]),
        ("0.2 3.1", ["picture-made-flat", "picture-enlarged"]),
    ):
        path.write_bytes(with_made_flat(IMAGE.read_bytes(), text))
        assert [finding.code for finding in read_image(path).findings] == codes
    path.write_bytes(with_made_flat(IMAGE.read_bytes(), "nan"))
    run = vfplan_cli("extract", path, "-o", tmp_path / "c.h5", "--json")
    run.fails(3, error="made-flat-invalid")


def test_a_photograph_is_not_made_flat_by_markers_that_do_not_determine_it(vfplan_cli, tmp_path):
    photo, marks, _ = photographed(tmp_path)
    head, lines = rows(marks)
    on_line = [[lines[k][0], 100 + 60 * k, 100 + 40 * k] for k in range(5)] + lines[8:]
    for name, some, code in (
        ("too-few-markers", lines[:4], 3), ("homography-undetermined", on_line, 3),
        ("labels-mistaken", [lines[1], lines[0], *lines[2:]], 1),
    ):  # fmt: skip
        if name == "labels-mistaken":
            some = [[row[0], *other[1:]] for row, other in zip(lines, some, strict=True)]
        table = write(tmp_path / "some.csv", head, some)
        words = ("rectify", photo, table, ROBOT, "--common", "-o", tmp_path / "no.png", "--json")
        vfplan_cli(*words).fails(code, error=name)
    words = ("rectify", photo, marks, ROBOT, "-o", tmp_path / "no.png", "--json")
    in_space = tmp_path / "space.mrk.json"
    points = [(line[0], [0, 10.0 * k, 0], "defined") for k, line in enumerate(lines)]
    in_space.write_text(mrk(points))
    vfplan_cli(*words[:2], in_space, *words[3:]).fails(3, error="rectify-in-space")
    vfplan_cli(*words, "--max-residual", 0.1).fails(1, error="residual-large")
    vfplan_cli(*words, "--max-megapixels", 0.69).fails(1, error="flat-picture-large")
