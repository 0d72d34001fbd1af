"""Strokes as RTSTRUCT and a mesh's inside as SEG: read back by us, by pydicom and by SimpleITK."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import bundles
import numpy as np
import pydicom
import pytest
from bones import write_dicom
from meshes import sphere
from pydicom.uid import CTImageStorage
from refusals import refuses

import vfplan
from vfplan.bundle.exporting import export
from vfplan.errors import InputError, SettingError
from vfplan.fixture import RegistrationRecord
from vfplan.surface.build import surface
from vfplan.surface.sources import read_contours
from vfplan.vectors.read import read_vector_curve

TURN = 0.3
SPACING_MM = (0.8, 0.5)  # between rows, between columns
ORIGIN_MM = np.array([-10.0, 20.0, -500.0])
ACROSS = np.array([[np.cos(TURN), np.sin(TURN), 0.0], [-np.sin(TURN), np.cos(TURN), 0.0]])


@pytest.fixture
def study(tmp_path):
    """A slice of somebody's study."""
    return write_dicom(
        tmp_path / "slice.dcm", CTImageStorage, "1.2.3.4", "CT", StudyInstanceUID="1.2.3",
        SeriesInstanceUID="1.2.3.5", FrameOfReferenceUID="1.2.3.6", PatientName="Doe^Jane",
        PatientID="7", PixelSpacing=list(SPACING_MM), SliceThickness=1.0,
        ImageOrientationPatient=ACROSS.ravel().tolist(), ImagePositionPatient=ORIGIN_MM.tolist(),
    )  # fmt: skip


def in_study(study, **changes):
    """The whole fixture, as if it was planned on the slice."""
    whole = bundles.whole()
    inputs = {"image": hashlib.sha256(study.read_bytes()).hexdigest()}
    return replace(whole, provenance=replace(whole.provenance, inputs=inputs), **changes)


@pytest.mark.parametrize("is_closed", [False, True])
def test_strokes_come_back_from_an_rtstruct(tmp_path, study, is_closed):
    curve = replace(bundles.whole().curve, closed=np.array([is_closed, not is_closed]))
    fixture = in_study(study, curve=curve)
    path = tmp_path / "c.rtstruct.dcm"
    export(fixture, path, study=study)
    read = pydicom.dcmread(path)
    assert (str(read.PatientName), read.StudyInstanceUID) == ("Doe^Jane", "1.2.3")
    T = fixture.registration.T_robot_image
    contours = read.ROIContourSequence[0].ContourSequence
    assert len(contours) == len(fixture.strokes)
    for number, (stroke, contour) in enumerate(zip(fixture.strokes, contours, strict=True), 1):
        points_mm = np.array(contour.ContourData, float).reshape(-1, 3)
        steps = (points_mm - ORIGIN_MM) @ ACROSS.T / SPACING_MM[::-1]
        assert np.allclose(np.c_[steps, np.ones(len(steps))] @ T.T, stroke.points, atol=2e-9)
        assert contour.ContourGeometricType.startswith("CLOSED" if stroke.closed else "OPEN")
        ours = read_vector_curve(path, number=number)
        assert ours.closed == stroke.closed
        assert np.allclose(ours.points, 1e-3 * points_mm, rtol=0, atol=1e-12)


def test_the_frame_that_is_printed_is_that_of_the_file(vfplan_cli, tmp_path, study):
    fixture = in_study(study)
    marks = np.vstack([np.zeros(3), 0.1 * np.eye(3)])
    carried = RegistrationRecord(
        "rigid", "patient_lps", np.eye(4), tuple("abcd"), marks, marks, np.zeros(4), 0, 0, 0
    )
    vfplan.write_fixture(fixture, tmp_path / "a.h5")
    vfplan.write_fixture(replace(fixture, registration=carried), tmp_path / "b.h5")
    for name, output, *words in (
        ("a", "a.rtstruct.dcm", "--study", study), ("b", "b.mrk.json"), ("a", "a.mrk.json"),
        ("b", "b.ply"),
    ):  # fmt: skip
        run = vfplan_cli("export", tmp_path / f"{name}.h5", "-o", tmp_path / output, *words)
        is_patient = output in ("a.rtstruct.dcm", "b.mrk.json")
        assert f"of frame {'patient_lps' if is_patient else 'robot_base'} to" in run.stdout


def ball(radius_mm=12.0, height_m=-0.48):
    """A closed mesh in the patient."""
    points, mesh = sphere(radius_mm, 3)
    points = 1e-3 * points + (0.02, 0.04, height_m)
    return replace(bundles.small(), frame="patient_lps", points=points, mesh=mesh)


def test_the_inside_of_a_mesh_comes_back_from_a_seg(tmp_path, study):
    fixture = ball()
    path = tmp_path / "m.seg.dcm"
    export(fixture, path, study=study)
    a, b, c = np.moveaxis(fixture.points[fixture.mesh], 1, 0)
    volume_mm3 = 1e9 * abs((np.cross(a, b) * c).sum() / 6)
    read = pydicom.dcmread(path)
    voxel_mm3 = SPACING_MM[0] * SPACING_MM[1]
    assert abs(read.pixel_array.sum() * voxel_mm3 / volume_mm3 - 1) < 0.05
    sitk = pytest.importorskip("SimpleITK")
    image = sitk.ReadImage(str(path))
    places = [
        image.TransformIndexToPhysicalPoint(place)
        for place in np.argwhere(sitk.GetArrayFromImage(image))[:, ::-1].tolist()
    ]
    assert np.allclose(np.mean(places, axis=0), 1e3 * fixture.points.mean(axis=0), atol=0.5)
    rings = np.concatenate(read_contours([path]).rings)
    assert np.allclose(np.ptp(rings, axis=0), 24e-3, rtol=0, atol=2.1e-3), "a slice at each end"
    assert abs(surface(path).report["volume_mm3"] / volume_mm3 - 1) < 0.05


def test_what_no_study_can_hold_is_refused(tmp_path, study):
    without = pydicom.dcmread(study)
    del without.FrameOfReferenceUID
    lost = tmp_path / "lost.dcm"
    without.save_as(lost)
    for fixture, name, options, error, code in (
        (bundles.whole(), "c.rtstruct.dcm", {}, SettingError, "study-missing"),
        (bundles.whole(), "c.ply", {"study": study}, SettingError, "study-unused"),
        (bundles.whole(), "c.rtstruct.dcm", {"study": study}, InputError, "frame-not-patient"),
        (ball(), "c.seg.dcm", {"study": lost}, InputError, "study-incomplete"),
        (ball(0.2, -0.4805), "c.seg.dcm", {"study": study}, InputError, "between-slices"),
        (ball(2e4), "c.seg.dcm", {"study": study}, InputError, "too-many-voxels"),
    ):  # fmt: skip
        with refuses(error, code):
            export(fixture, tmp_path / name, **options)
