"""DICOM: colour captures read, spacing the right way round, everything else read or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pydicom
import pytest
from captures import CURVE, PICTURE, SHAPE, capture
from drawing import rms_off
from pydicom.data import get_testdata_files
from refusals import refuses

import vfplan
from vfplan.errors import CurveError, ImageError

# Installed with pydicom itself; the larger files it would fetch are not asked for.
ZOO = sorted({Path(f) for f in get_testdata_files() if Path(f).is_file()})


def test_colour_capture(tmp_path):
    read = vfplan.read_image(capture(tmp_path))
    assert np.array_equal(read.rgb, PICTURE)
    assert read.pixel_spacing_mm is None
    (stroke,) = vfplan.extract_curve(read).strokes
    assert rms_off(stroke, CURVE) < 0.03


def test_sixteen_bit_and_twelve_stored_bits_fill_the_range(tmp_path):
    deep = PICTURE.astype(np.uint16) << 4
    read = vfplan.read_image(capture(tmp_path, deep, BitsStored=12, HighBit=11))
    assert np.array_equal(read.rgb, PICTURE.astype(np.uint16) << 8)


def test_ybr_becomes_rgb(tmp_path):
    from pydicom.pixels import convert_color_space

    ybr = convert_color_space(PICTURE, "RGB", "YBR_FULL")
    read = vfplan.read_image(capture(tmp_path, ybr, "YBR_FULL"))
    assert np.abs(read.rgb.astype(int) - PICTURE).max() <= 2


def test_palette(tmp_path):
    index = np.zeros(SHAPE, np.uint8)
    index[60:64] = 1
    names = ("Red", "Green", "Blue")
    table = {"Red": [90, 230], "Green": [90, 20], "Blue": [90, 40]}
    more = {f"{n}PaletteColorLookupTableDescriptor": [2, 0, 8] for n in names}
    more |= {f"{n}PaletteColorLookupTableData": bytes(table[n]) for n in names}
    read = vfplan.read_image(capture(tmp_path, index, "PALETTE COLOR", **more))
    assert np.array_equal(read.rgb[0, 0], [90, 90, 90])
    assert np.array_equal(read.rgb[61, 5], [230, 20, 40])


def test_spacing_is_along_u_first_and_the_detectors_only_when_asked(tmp_path):
    # DICOM writes the distance between rows (along v) first.
    path = capture(tmp_path, ImagerPixelSpacing=[0.1, 0.2])
    assert vfplan.read_image(path).pixel_spacing_mm is None
    assert vfplan.read_image(path, imager_spacing=True).pixel_spacing_mm == (0.2, 0.1)
    both = capture(tmp_path, ImagerPixelSpacing=[0.1, 0.2], PixelSpacing=[0.4, 0.7])
    assert vfplan.read_image(both, imager_spacing=True).pixel_spacing_mm == (0.7, 0.4)


@pytest.mark.parametrize("wrong", [[0.5, 0.5, 1.0], [0.5, 0.0], [-0.5, 0.5], [0.5]], ids=str)
def test_malformed_spacing_is_refused(tmp_path, wrong):
    with pytest.raises(ImageError, match="PixelSpacing"):
        vfplan.read_image(capture(tmp_path, PixelSpacing=wrong))


def test_place_in_the_patient(tmp_path):
    axes = [0, 1, 0, 0, 0, -1]
    path = capture(tmp_path, PixelSpacing=[0.4, 0.7], ImagePositionPatient=[10, -20, 30],
                   ImageOrientationPatient=axes)  # fmt: skip
    place = vfplan.read_image(path).T_patient_image
    # Two columns right: 2 x 0.7 mm along the row's direction; three rows down: 3 x 0.4 mm.
    assert np.allclose(place @ [2, 3, 1], [10e-3, -20e-3 + 1.4e-3, 30e-3 - 1.2e-3, 1])


def test_frames_are_chosen(tmp_path):
    path = capture(tmp_path, np.stack([PICTURE, 255 - PICTURE]))
    with pytest.raises(ImageError, match="2 frames"):
        vfplan.read_image(path)
    assert np.array_equal(vfplan.read_image(path, frame=2).rgb, 255 - PICTURE)
    with pytest.raises(ImageError, match="no frame 3"):
        vfplan.read_image(path, frame=3)


def test_grey_is_rescaled_and_windowed_for_the_overlay(tmp_path):
    stored = np.tile(np.arange(220, dtype=np.int16) * 10, (150, 1))
    given = {"RescaleSlope": 2, "RescaleIntercept": -1000, "WindowCenter": 0, "WindowWidth": 400}
    read = vfplan.read_image(capture(tmp_path, stored, "MONOCHROME2", **given))
    shown = read.rgb[0, :, 0].astype(int)
    # 2 x stored - 1000 passes -200..200 between columns 40 and 60.
    assert (shown[:40] == 0).all()
    assert (shown[61:] == 65535).all()
    assert abs(shown[50] - 32768) < 800
    # The stored values between the ends of the window stay apart.
    assert len(np.unique(shown)) == 21
    assert np.ptp(read.rgb, axis=2).max() == 0
    inverted = vfplan.read_image(capture(tmp_path, stored, "MONOCHROME1", **given))
    assert np.array_equal(65535 - read.rgb, inverted.rgb)
    with pytest.raises(CurveError, match="grey"):
        vfplan.extract_curve(read)


@pytest.mark.parametrize("kept", [140, 400, 1000, 60000])
def test_truncated_dicom_is_refused(tmp_path, kept):
    path = capture(tmp_path)
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(ImageError):
        vfplan.read_image(path)


def test_the_zoo_is_read_or_refused_with_a_reason(capfd):
    refused = []
    for path in ZOO:
        try:
            rgb = vfplan.read_image(path).rgb
        except ImageError as error:
            refused.append(error)
            continue
        assert rgb.shape[2:] == (3,)
        assert rgb.dtype in (np.uint8, np.uint16)
    assert len(ZOO) - len(refused) > 50
    assert {error.exit_code for error in refused} == {3}
    assert all(len(error.message) > 15 and "\n" not in error.message for error in refused)
    assert capfd.readouterr().err == ""


def test_a_number_of_frames_that_is_none_is_named(tmp_path):
    with refuses(ImageError, "no-frames", count=-1):
        vfplan.read_image(capture(tmp_path, NumberOfFrames=-1))


def test_frames_of_an_enhanced_file_lie_where_their_functional_groups_say(tmp_path):
    for seed in range(54):
        rng = np.random.default_rng(seed)
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        spacings, corners = rng.uniform(0.3, 1.5, (2, 2)), rng.uniform(-200, 200, (2, 3))
        frames = [pydicom.Dataset(), pydicom.Dataset()]
        for frame, spacing, corner in zip(frames, spacings, corners, strict=True):
            for group, name, values in (
                ("PlanePosition", "ImagePositionPatient", corner),
                ("PlaneOrientation", "ImageOrientationPatient", axes[:, :2].T.ravel()),
                ("PixelMeasures", "PixelSpacing", spacing),
            ):
                item = pydicom.Dataset()
                setattr(item, name, [f"{x:.10f}" for x in values])
                setattr(frame, f"{group}Sequence", [item])
        pixels = np.stack([PICTURE, PICTURE])[:, :8, :8]
        path = capture(tmp_path, pixels, PerFrameFunctionalGroupsSequence=frames)
        for k in range(2):
            T = vfplan.read_image(path, frame=k + 1).T_patient_image
            expected = np.c_[axes[:, :2] * spacings[k, ::-1], corners[k]] * 1e-3
            assert np.abs(T[:3] - expected).max() < 1e-9


def test_what_is_said_beside_the_pixels_is_obeyed_or_told(tmp_path):
    path = capture(tmp_path, PixelAspectRatio=[2, 1])
    with pytest.raises(ImageError, match="--pixel-spacing"):
        vfplan.read_image(path)
    assert vfplan.read_image(path, pixel_spacing_mm=(1.0, 2.0)).findings == ()
    square = vfplan.read_image(path, pixel_spacing_mm=(1.0, 1.0))
    assert [finding.code for finding in square.findings] == ["pixels-square"]
    grey = capture(tmp_path, PICTURE[..., 1].copy(), "MONOCHROME2")
    data = pydicom.dcmread(grey)
    data.add_new(0x60003000, "OW", bytes(150 * 220 // 8))
    data.save_as(grey)
    assert [finding.code for finding in vfplan.read_image(grey).findings] == ["overlay-left-out"]
    with pytest.raises(CurveError, match="overlay planes"):
        vfplan.extract(grey)
