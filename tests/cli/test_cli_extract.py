"""`vfplan extract`: JSON, files, exit codes, and nothing left behind."""

from __future__ import annotations

import os

import cv2
import numpy as np
import pytest
from conftest import names_in
from drawing import blend, coverage, flat, rms_off, to_uint8, unit, wavy
from vector_files import RING_MM, polyline, slicer

import vfplan

SHAPE = (240, 320)
CURVE = wavy(SHAPE, 4, margin=0.2)
RING = 30 + 18 * unit(np.linspace(0, 6.2, 99))


@pytest.fixture
def image(tmp_path):
    return draw(tmp_path / "slice.png", [CURVE])


def draw(path, parts):
    share = np.max([coverage(SHAPE, part, 3) for part in parts], axis=0)
    cv2.imwrite(str(path), to_uint8(blend(flat(SHAPE), share, (255, 0, 0)))[..., ::-1])
    return path


def test_json_files_and_the_curve_bundle(vfplan_cli, image, tmp_path):
    out, mask, overlay = (tmp_path / name for name in ("c.h5", "mask.png", "overlay.png"))
    done = vfplan_cli("extract", image, "-o", out, "--mask-out", mask, "--overlay-out", overlay,
                      "--pixel-spacing", "0.5,0.4", "--json").sound  # fmt: skip
    report = done.json
    assert report["image"] == {"width_px": 320, "height_px": 240, "pixel_spacing_mm": [0.5, 0.4]}
    (stroke,) = report["strokes"]
    assert stroke["points"] == report["points"]
    assert not stroke["closed"]
    assert len(stroke["ends_px"]) == 2
    arc = np.diff(CURVE, axis=0)
    assert stroke["length_px"] == pytest.approx(np.hypot(*arc.T).sum(), rel=0.01)
    assert stroke["length_mm"] == pytest.approx(np.hypot(*(arc * [0.5, 0.4]).T).sum(), rel=0.01)
    assert report["spacing_mm"] * report["density_per_mm"] == pytest.approx(1)
    assert report["elapsed_s"] > 0
    assert cv2.imread(str(mask), cv2.IMREAD_GRAYSCALE).shape == SHAPE
    assert np.count_nonzero(cv2.imread(str(mask), 0)) == report["mask_pixels"]
    assert min(cv2.imread(str(overlay)).shape[:2]) > 500
    fixture = vfplan.read_fixture(out)
    assert (fixture.frame, fixture.points.shape) == ("image", (report["points"], 3))
    assert (fixture.points[:, 2] == 0).all()
    found = type("S", (), {"points_px": fixture.points[:, :2], "sigma_px": fixture.sigma,
                           "length": stroke["length_px"]})  # fmt: skip
    assert rms_off(found, CURVE) < 0.03


def test_what_a_person_says_of_the_line_and_the_account_of_the_ink(vfplan_cli, tmp_path):
    image = draw(tmp_path / "two.png", [CURVE, [[40, 20], [90, 26]]])
    first, last = (f"{u:.1f},{v:.1f}" for u, v in CURVE[[-1, 0]])
    done = vfplan_cli(*("extract", image, "-o", tmp_path / "c.h5", "--exclude", "30,10,80,24"),
                      *("--start", first, "--end", last, "--accept-width",
                        "--json")).sound  # fmt: skip
    (begin, _) = done.json["strokes"][0]["ends_px"]
    assert np.hypot(*(np.array(begin) - CURVE[-1])) < 2
    assert done.json["account"] == []
    (entry,) = vfplan_cli("extract", image, "-o", tmp_path / "e.h5", "--json").json["account"]
    assert (entry["number"], entry["what"]) == (1, "ink")
    assert (entry["u"], entry["v"]) == pytest.approx((65, 23), abs=2)
    assert entry["pixels"] == pytest.approx(160, abs=30)
    assert 0 < entry["share"] < 0.5


@pytest.mark.parametrize("spacing, noted", [("1,5", True), ("1,2", False), ("0.5", False)])
def test_a_decimal_comma_in_a_pixel_spacing_is_noted(spacing, noted, vfplan_cli, image, tmp_path):
    words = "--pixel-spacing", spacing, "--json"
    done = vfplan_cli("extract", image, "-o", tmp_path / "c.h5", *words)
    codes = [finding["code"] for finding in done.json["findings"]]
    assert ("pixel-spacing-uneven" in codes) == noted


def test_several_candidates_exit_3_and_leave_nothing(vfplan_cli, tmp_path):
    image = draw(tmp_path / "two.png", [CURVE, RING])
    out, mask = tmp_path / "c.h5", tmp_path / "m.png"
    done = vfplan_cli("extract", image, "-o", out, "--mask-out", mask, "--json").fails(3)
    assert done.json["error"]["kind"] == "CurveError"
    assert "2: " in done.error_line
    assert names_in(tmp_path) == ["two.png"]
    numbers = tmp_path / "o.png"
    vfplan_cli("extract", image, "-o", out, "--overlay-out", numbers).fails(3, str(numbers))
    assert names_in(tmp_path) == ["o.png", "two.png"]
    chosen = vfplan_cli("extract", image, "-o", out, "--stroke", "longest", "--json").sound
    assert [entry["what"] for entry in chosen.json["account"]] == ["ink"]
    everything = vfplan_cli("extract", image, "-o", out, "--stroke", "all", "--overwrite", "--json")
    assert len(everything.json["strokes"]) == 2


def test_outputs_that_cannot_be_written_are_exit_2_in_one_line(vfplan_cli, image, tmp_path):
    """No output takes a device's place either."""
    pipe = tmp_path / "pipe.h5"
    os.mkfifo(pipe)
    for out in ("/proc/curve.h5", tmp_path / ("x" * 300 + ".h5"), pipe):
        done = vfplan_cli("extract", image, "-o", out, "--overwrite", "--json", "-q").fails(2)
        assert (done.json["error"]["kind"], done.stderr.count("\n")) == ("OutputError", 1)
    assert pipe.is_fifo()
    assert names_in(tmp_path) == ["pipe.h5", image.name]


def test_vector_curves(vfplan_cli, image, tmp_path):
    ring = slicer(tmp_path, RING_MM, "ClosedCurve")
    alone = vfplan_cli("extract", ring, "-o", tmp_path / "a.h5", "--json").sound.json
    assert (alone["frame"], "image" in alone) == ("patient_lps", False)
    assert alone["strokes"][0]["length_mm"] == pytest.approx(20 * np.pi, rel=1e-3)
    assert vfplan.read_fixture(tmp_path / "a.h5").sigma is None
    line = polyline(tmp_path, [(10, 10), (100, 40)])
    beside = vfplan_cli("extract", image, "--curve", line, "-o", tmp_path / "b.h5", "--overlay-out",
                        tmp_path / "o.png", "--json").sound  # fmt: skip
    assert beside.json["points"] == 96
    assert (tmp_path / "o.png").exists()
    vfplan_cli("extract", image, "--curve", line, "-o", tmp_path / "c.h5", "--mask-out",
               tmp_path / "m.png").fails(2)  # fmt: skip
    assert not (tmp_path / "c.h5").exists()
