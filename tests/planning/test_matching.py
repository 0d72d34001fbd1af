"""A slice that knows its place in the patient is registered by the patient's markers."""

import numpy as np
import pytest
from captures import CURVE, capture
from conftest import ELBOW, file_with
from drawing import normal_errors, rms
from PIL import Image
from refusals import refuses
from slicer_files import marker_files

import vfplan
from vfplan.errors import MarkerError, SettingError
from vfplan.planning.extraction import extract
from vfplan.planning.plan import plan, register
from vfplan.planning.settings import ExtractSettings, FixtureSettings

PIXEL = 0.35
C, S = np.cos(0.3), np.sin(0.3)
AXES = np.array([[1, 0, 0], [0, C, S]])
CORNER = np.array([-40.0, 12.5, 130.25])
PLACED = {"PixelSpacing": [PIXEL, PIXEL],
          "ImageOrientationPatient": [f"{x:.10f}" for x in AXES.ravel()],
          "ImagePositionPatient": [float(x) for x in CORNER]}  # fmt: skip
MARKS = np.array([[-30, 20, 120], [40, 15, 160], [0, 70, 135], [20, 30, 100], [-35, 60, 170.0]])
TURN = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
SHIFT = np.array([0.5, 0.2, 0.1])
RIGID = FixtureSettings(model="rigid")


def robot(points_mm):
    return 1e-3 * points_mm @ TURN.T + SHIFT


@pytest.fixture
def markers(tmp_path):
    rng = np.random.default_rng(1)
    touched = robot(MARKS) + rng.normal(0, 1e-9, MARKS.shape)
    return marker_files(tmp_path, [f"m{k}" for k in range(len(MARKS))], MARKS, touched)


def test_a_slice_is_planned_by_the_patients_markers(markers, tmp_path):
    made = plan(capture(tmp_path, **PLACED), *markers, settings=RIGID)
    fixture = made.fixture
    assert fixture.frame == "robot_base"
    assert fixture.registration.source_frame == "patient_lps"
    # Back through the slice's own geometry, by hand: the drawn curve, to a few hundredths of a px.
    patient = (fixture.points - SHIFT) @ TURN * 1e3
    pixels = (patient - CORNER) @ AXES.T / PIXEL

    assert rms(normal_errors(pixels, CURVE, False)) < 0.05
    assert np.abs((patient - CORNER) @ np.cross(*AXES)).max() < 1e-3
    # Extruded along the slice's normal, as a drawn slice is.
    assert abs(fixture.ignore_axis @ (np.cross(*AXES) @ TURN.T)) == pytest.approx(1, abs=1e-6)
    assert made.fixture.sigma.max() < 1e-4


def test_register_takes_the_slice_beside_the_curve(markers, tmp_path):
    path = capture(tmp_path, **PLACED)
    curve = extract(path).fixture
    assert curve.frame == "image"
    with refuses(MarkerError, "slice-without-place"):
        register(curve, *markers, RIGID)
    both = register(curve, *markers, RIGID, image=vfplan.read_image(path)).fixture.points
    assert np.array_equal(both, plan(path, *markers, settings=RIGID).fixture.points)


def test_what_does_not_place_the_slice_is_refused(markers, tmp_path):
    skew = PLACED | {"ImageOrientationPatient": [1, 0, 0, 0.1, 1, 0]}
    with refuses(MarkerError, "slice-without-place"):
        plan(capture(tmp_path, **skew), *markers, settings=RIGID)
    path = capture(tmp_path, **PLACED)
    other = ExtractSettings(pixel_spacing_mm=(0.4, 0.4))
    with pytest.raises(SettingError, match=r"0\.4 mm, that of the slice .* 0\.35, 0\.35 mm"):
        plan(path, *markers, settings=RIGID, extraction=other)


def test_pixels_of_another_program_are_asked_about_where_exif_turns_the_picture(tmp_path):
    slice_image = Image.open(ELBOW[0]).convert("RGB")
    stored = tmp_path / "stored.png"
    exif = Image.Exif()
    exif[0x0112] = 3
    slice_image.save(stored, exif=exif)
    curve = file_with(tmp_path / "c.csv", "u_px,v_px\n100,100\n200,150\n")
    truth = plan(*ELBOW).fixture.points
    as_given = FixtureSettings(markers_as_given=True)
    for pixels, drawn, doubted in (
        (None, None, 1), ("as-shown", None, 0), ("as-stored", None, 0), (None, curve, 2),
    ):  # fmt: skip
        settings = ExtractSettings(pixels=pixels)
        made = plan(stored, *ELBOW[1:], extraction=settings, curve=drawn, settings=as_given)
        codes = [finding.code for finding in made.findings]
        assert codes.count("pixels-unturned") == doubted
        is_turned = made.extracted.report["image"].get("orientation") == 3
        assert is_turned == ("picture-turned" in codes) == (pixels != "as-stored")
        if pixels == "as-stored":
            assert np.array_equal(made.fixture.points, truth)
