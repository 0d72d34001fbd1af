"""`vfplan review` and the sheet that `vfplan plan` writes: the same digest, nothing by halves."""

from __future__ import annotations

import json

import cv2
import pytest
from review_slices import MARKERS
from review_slices import SLICE as IMAGE

from vfplan.review.paper import PAGE_HEIGHT, PAGE_WIDTH

PLAN = ("plan", IMAGE, *MARKERS, "--pixel-spacing", 0.5)


@pytest.fixture(scope="module")
def folder(vfplan_cli, tmp_path_factory):
    """A folder with a curve, a fixture, its sheet, and what `plan` reported."""
    folder = tmp_path_factory.mktemp("planned")
    run = vfplan_cli(*PLAN, "-o", folder / "elbow.h5", "--json").sound
    (folder / "report.json").write_text(run.stdout)
    assert vfplan_cli("extract", IMAGE, "--pixel-spacing", 0.5, "-o", folder / "curve.h5").sound
    return folder


@pytest.fixture
def report(folder):
    return json.loads((folder / "report.json").read_text())


def test_sheet_that_exists_is_not_overwritten(vfplan_cli, tmp_path):
    sheet = tmp_path / "f-sheet.png"
    sheet.write_bytes(b"mine")
    vfplan_cli(*PLAN, "-o", tmp_path / "f.h5").fails(2)
    assert (sheet.read_bytes(), list(tmp_path.iterdir())) == (b"mine", [sheet])
    assert vfplan_cli(*PLAN, "-o", tmp_path / "f.h5", "--overwrite").sound
    assert cv2.imread(str(sheet)).shape == (PAGE_HEIGHT, PAGE_WIDTH, 3)


def test_sheet_and_overlay_need_two_names(vfplan_cli, tmp_path):
    vfplan_cli(*PLAN, "-o", tmp_path / "f.h5", "--overlay-out", tmp_path / "f-sheet.png").fails(2)
    assert not list(tmp_path.iterdir())


def test_same_plan_has_the_same_sheet_at_any_time(vfplan_cli, tmp_path):
    digests, pictures = set(), set()
    for epoch in ("1700000000", "1800000000"):
        folder = tmp_path / epoch
        folder.mkdir()
        env = {"SOURCE_DATE_EPOCH": epoch}
        digests.add(vfplan_cli(*PLAN, "-o", folder / "f.h5", "--json", env=env).json["digest"])
        pictures.add((folder / "f-sheet.png").read_bytes())
    assert len(digests) == len(pictures) == 1


def test_review_of_slice_and_markers_is_that_of_the_plan(vfplan_cli, report, tmp_path):
    sheet = tmp_path / "s.png"
    run = vfplan_cli("review", *PLAN[1:], "--sheet-out", sheet, "--json").sound
    assert (run.json["digest"], run.json["findings"]) == (report["digest"], report["findings"])
    assert list(tmp_path.iterdir()) == [sheet]


@pytest.mark.parametrize("source", ["elbow.h5", "curve.h5"])
def test_review_of_a_bundle_takes_its_slice_back_in(vfplan_cli, report, folder, tmp_path, source):
    with_slice, without = (
        vfplan_cli("review", folder / source, *more, "--sheet-out", tmp_path / name, "--json")
        for name, more in (("a.png", ("--slice", IMAGE)), ("b.png", ()))
    )
    assert with_slice.code == without.code == 0, with_slice.stderr + without.stderr
    if source == "elbow.h5":
        assert with_slice.json["digest"] == report["digest"]
    assert with_slice.json["digest"] != without.json["digest"]
    assert "missing" in without.json["verdict"]
    assert "missing" not in with_slice.json["verdict"]


def test_curve_bundle_with_markers_is_registered_for_the_sheet(vfplan_cli, folder, tmp_path):
    for source, code in (("curve.h5", 0), ("elbow.h5", 2)):
        words = (*MARKERS, "--slice", IMAGE, "--sheet-out", tmp_path / f"{source}.png")
        assert vfplan_cli("review", folder / source, *words).code == code


def test_settings_of_extraction_are_refused_for_a_bundle_unless_it_has_them(vfplan_cli, folder,
                                                                            tmp_path):  # fmt: skip
    command = ("review", folder / "elbow.h5", "--slice", IMAGE, "--sheet-out", tmp_path / "s.png")
    run = vfplan_cli(*command, "--max-gap", "5", "--method", "mask",
                     "--json").fails(2, error="extracted-already")  # fmt: skip
    assert run.json["error"]["numbers"]["settings"] == ["method", "max_gap_px"]
    assert vfplan_cli(*command, "--colour", "red", "--max-gap", "20").sound


def test_a_picture_of_another_size_is_refused_for_registration(vfplan_cli, folder, tmp_path):
    picture = cv2.imread(str(IMAGE))[100:, 80:]
    cv2.imwrite(str(tmp_path / "other.png"), picture)
    run = vfplan_cli(
        "register", folder / "curve.h5", *MARKERS, "--image", tmp_path / "other.png",
        "-o", tmp_path / "f.h5", "--json",
    ).fails(3, error="image-size-differs")  # fmt: skip
    assert run.json["error"]["numbers"]["width_px"] == picture.shape[1]
    assert not (tmp_path / "f.h5").exists()


@pytest.mark.parametrize("option", [("--margin", "tre95"), ("--contact-radius", 8)])
@pytest.mark.parametrize("output, name", [("--sheet-out", "s.png"), ("-o", "o.h5")])
def test_options_of_planning_are_refused_for_a_fixture(
    output, name, option, vfplan_cli, folder, tmp_path
):
    words = ("--slice", IMAGE, *option, output, tmp_path / name, "--no-browser", "--json")
    vfplan_cli("review", folder / "elbow.h5", *words).fails(2, error="planned-already")
    assert list(tmp_path.iterdir()) == []
