"""Curves drawn as vectors: Slicer's and CSV, alone and on a DICOM slice."""

from __future__ import annotations

import json

import numpy as np
import pytest
from captures import capture
from conftest import file_with, memory_below
from refusals import refuses
from scipy.spatial import cKDTree
from vector_files import RING_MM, SCHEMA, polyline, slicer

from vfplan.errors import CurveError, SettingError
from vfplan.geometry.lines import row_lengths, step_lengths
from vfplan.planning.extraction import extract
from vfplan.planning.settings import ExtractSettings
from vfplan.vectors.read import read_vector_curve


def test_closed_curve_is_a_smooth_ring_in_metres(tmp_path):
    curve = read_vector_curve(slicer(tmp_path, RING_MM, "ClosedCurve"))
    assert curve.closed
    fine = curve.stroke(1e-4).points
    assert np.abs(np.hypot(fine[:, 0], fine[:, 1]) - 0.01).max() < 5e-6
    assert np.allclose(fine[:, 2], 0.005)
    steps = step_lengths(np.vstack([fine, fine[:1]]))
    assert steps.max() < 1.05 * steps.min()


def test_ras_and_units_are_honoured(tmp_path):
    ras = RING_MM * [-1, -1, 1]
    a = read_vector_curve(slicer(tmp_path, ras, coordinateSystem="RAS"))
    b = read_vector_curve(slicer(tmp_path, RING_MM * 1e3, coordinateUnits="um"))
    assert np.allclose(a.points, RING_MM * 1e-3)
    assert np.allclose(b.points, RING_MM * 1e-3)


def test_polyline_open_and_closed(tmp_path):
    square = [(10, 10), (50, 10), (50, 50), (10, 50)]
    opened = read_vector_curve(polyline(tmp_path, square))
    ring = read_vector_curve(polyline(tmp_path, [*square, square[0]]))
    assert (opened.closed, ring.closed) == (False, True)
    assert len(opened.stroke(1.0).points) == 121
    assert len(ring.stroke(1.0).points) == 160


@pytest.mark.parametrize(
    "points, told",
    [
        ([(10, 10), (60, 10), (10, 11)], ["curve-folds"]), ([(10, 10), (60, 10), (20, 25)], []),
        ([(10, 40), (60, 40), (60, 10), (30, 10), (30, 70)], ["curve-crosses"]),
        ([(10, 40), (60, 40), (60, 10), (30, 10), (30, 36)], []),
        ([(10, 40), (60, 40), (60, 20), (10, 62)], ["curve-folds"]),
        ([(10, 40), (60, 40), (60, 20), (10, 67)], ["curve-crosses"]),
    ],
)  # fmt: skip
def test_a_curve_that_runs_back_along_itself_or_crosses_is_doubted(tmp_path, points, told):
    for given in (points, points[::-1]):
        curve = polyline(tmp_path, given)
        for made in (extract(capture(tmp_path), curve=curve), extract(curve, ExtractSettings())):
            assert [found.code for found in made.findings] == told


def test_a_curve_laid_on_itself_often_takes_little_memory(tmp_path):
    curve = polyline(tmp_path, np.tile([(10, 10), (60, 10)], (100, 1)))
    with memory_below(40e6):
        made = extract(curve, ExtractSettings())
    assert {found.code for found in made.findings} == {"curve-folds"}


def grey_slice(tmp_path):
    pixels = np.tile(np.arange(100, dtype=np.uint8), (80, 1))
    return capture(
        tmp_path, pixels, "MONOCHROME2", PixelSpacing=[0.5, 0.25],
        ImagePositionPatient=[-12.5, -20, 5], ImageOrientationPatient=[1, 0, 0, 0, 1, 0],
    )  # fmt: skip


def test_grey_dicom_together_with_a_vector_curve(tmp_path):
    image, curve = grey_slice(tmp_path), slicer(tmp_path, RING_MM, "ClosedCurve")
    made = extract(image, ExtractSettings(), curve=curve)
    points = made.fixture.points
    assert made.fixture.frame == "image"
    assert set(made.fixture.provenance.inputs) == {"image", "curve"}
    # u = (x + 12.5) / 0.25 between columns, v = (y + 20) / 0.5 between rows.
    radius = np.hypot((points[:, 0] - 50) * 0.25, (points[:, 1] - 40) * 0.5)
    assert np.abs(radius - 10).max() < 0.01
    assert "mask_pixels" not in made.report


def test_a_curve_off_the_plane_or_the_image_is_refused(tmp_path):
    image = grey_slice(tmp_path)
    with pytest.raises(CurveError, match="off the slice's plane"):
        extract(image, ExtractSettings(), curve=slicer(tmp_path, RING_MM + np.array([0, 0, 3.0])))
    with refuses(CurveError, "vector-outside-image", v_px=5):
        extract(image, ExtractSettings(), curve=polyline(tmp_path, [(5, 5), (500, 5)]))


def test_a_patients_curve_needs_a_placed_image(tmp_path):
    image = capture(tmp_path)
    with pytest.raises(CurveError, match="where it lies in the patient"):
        extract(image, ExtractSettings(), curve=slicer(tmp_path, RING_MM))
    made = extract(image, ExtractSettings(), curve=polyline(tmp_path, [(20, 20), (90, 70)]))
    assert made.report["strokes"][0]["length_px"] == pytest.approx(np.hypot(70, 50), rel=1e-6)


ONE_POINT = [{"id": "1", "position": [1, 2, 3], "positionStatus": "defined"}]
HEADER = "# Markups fiducial file version = 4.11\n# CoordinateSystem = LPS\n"
BROKEN = {
    "mrk.json": ["{", '{"@schema": "x", "markups": []}'] + [
        json.dumps({"@schema": SCHEMA, "markups": markups}) for markups in (
            [], [{"type": "Fiducial", "controlPoints": []}],
            [{"type": "Curve", "controlPoints": ONE_POINT}],
        )
    ],
    "csv": [
        "", "x,y\n1,2\n", "label,u_px,v_px\nx1,1,2\nx2,3,4\n", "u_px,v_px\n",
        "u_px,v_px\n1,2\n1,2\n", "u_px,v_px\n1,nan\n2,3\n",
        "u_px,v_px\na,b\n", 'u_px,v_px\n"1,2\n3,4\n', "u_px,v_px\n1,1\n1e300,2\n",
    ],
    "fcsv": [
        "", HEADER, HEADER.replace("LPS", "XYZ") + "n,1,2,3\nn,2,3,4\n", HEADER + "n,1,b,3\n",
    ],
}  # fmt: skip


@pytest.mark.parametrize("suffix, text", [(s, t) for s, texts in BROKEN.items() for t in texts])
def test_broken_files_are_refused(tmp_path, suffix, text):
    path = file_with(tmp_path / f"c.{suffix}", text)
    with pytest.raises(CurveError):
        read_vector_curve(path)
    if suffix == "fcsv":
        with pytest.raises(SettingError, match="no effect on Slicer"):
            read_vector_curve(path, "centre")


def test_a_curve_of_too_many_points_is_refused_before_it_takes_the_memory(tmp_path):
    with pytest.raises(CurveError, match="at most 4000000"):
        extract(polyline(tmp_path, [(0, 0), (5e8, 0)]), ExtractSettings())


def test_a_picture_is_no_drawing(tmp_path):
    with pytest.raises(CurveError, match="DICOM with no drawing"):
        read_vector_curve(capture(tmp_path))


PENS = {"colour": "blue", "method": "mask", "stroke": 2, "roi": (0, 0, 5, 5), "max_gap_px": 5.0}


@pytest.mark.parametrize("given", [{name: value} for name, value in PENS.items()], ids=str)
def test_a_setting_of_pens_is_refused_and_not_ignored(tmp_path, given):
    path = polyline(tmp_path, [(5, 5), (50, 5)])
    for image, curve in ((path, None), (capture(tmp_path), path)):
        with pytest.raises(SettingError, match="no effect on a vector curve"):
            extract(image, ExtractSettings(**given), curve=curve)


def test_a_setting_of_images_and_a_density_are_refused_for_a_curve_alone(tmp_path):
    path = polyline(tmp_path, [(5, 5), (50, 5)])
    with pytest.raises(SettingError, match="pixel_spacing_mm"):
        extract(path, ExtractSettings(pixel_spacing_mm=(0.5, 0.5)))
    with pytest.raises(SettingError, match="pixel spacing"):
        extract(path, ExtractSettings(density_per_mm=2.0))


COLUMNS = "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n"


def control_points(tmp_path, points_mm, header=HEADER + COLUMNS):
    rows = "".join(f"n,{x},{y},{z},0,0,0,1,1,1,0,F,,\n" for x, y, z in points_mm)
    return file_with(tmp_path / "c.fcsv", header + rows)


def test_a_control_point_table_is_the_curve_that_its_points_are_in_order(tmp_path):
    closed = read_vector_curve(control_points(tmp_path, [*RING_MM, RING_MM[0]]))
    as_curve = read_vector_curve(slicer(tmp_path, RING_MM, "ClosedCurve"))
    assert closed.closed
    assert np.allclose(closed.points, as_curve.points, atol=1e-12)
    assert np.allclose(closed.stroke(1e-4).points, as_curve.stroke(1e-4).points, atol=1e-12)
    ras = control_points(tmp_path, RING_MM * [-1, -1, 1], HEADER.replace("LPS", "RAS") + COLUMNS)
    opened = read_vector_curve(ras)
    assert not opened.closed
    assert np.allclose(opened.points, RING_MM * 1e-3)


def vtk_curve(points_m, closed):
    """The curve as 3D Slicer's `vtkCurveGenerator` draws it, by VTK's own classes."""
    from vtkmodules.vtkCommonComputationalGeometry import vtkCardinalSpline, vtkParametricSpline
    from vtkmodules.vtkCommonCore import vtkPoints

    spline, controls = vtkParametricSpline(), vtkPoints()
    for name in "XYZ":
        getattr(spline, f"Set{name}Spline")(vtkCardinalSpline())
    controls.SetDataTypeToDouble()
    for point in points_m:
        controls.InsertNextPoint(point)
    spline.SetPoints(controls)
    spline.SetClosed(closed)
    spline.SetParameterizeByLength(False)
    places = []
    for at in np.linspace(0, 1, 4001):
        places.append([0.0, 0.0, 0.0])
        spline.Evaluate([at, 0, 0], places[-1], [0.0] * 9)
    return np.array(places)


@pytest.mark.parametrize("kind", ["Curve", "ClosedCurve"])
def test_slicers_curves_are_those_that_slicer_draws(tmp_path, kind):
    pytest.importorskip("vtkmodules.vtkCommonComputationalGeometry")
    rng = np.random.default_rng(51)
    for number in range(75):
        points_mm = rng.normal(size=(rng.integers(4, 30), 3)) * [30, 20, 5]
        if number % 5 == 0:
            points_mm[2] = points_mm[1]
        path = slicer(tmp_path, points_mm, kind)
        curve = read_vector_curve(path)
        truth = vtk_curve(points_mm * 1e-3, kind == "ClosedCurve")
        pieces = len(points_mm) - (kind == "Curve")
        assert np.abs(curve.at(np.linspace(0, pieces, 4001)) - truth).max() < 1e-12
        fine = cKDTree(np.vstack([curve.stroke(1e-4).points, truth[-1:]]))
        assert fine.query(truth)[0].max() < 1e-4
        lines = read_vector_curve(path, curve_type="linear")
        lengths = row_lengths(np.diff(points_mm, axis=0, append=points_mm[:1]))
        assert 1e3 * lines.stroke(1e-4).length == pytest.approx(lengths[:pieces].sum(), rel=0.01)


def test_a_curve_of_slicer_that_may_be_a_spline_or_lines_is_doubted(tmp_path):
    # Between two of 12 points of a circle, the chord lies r (1 - cos 15°) inside: 0.34 mm of 10.
    coarse = slicer(tmp_path, RING_MM[::2], "ClosedCurve")
    inside = 0.01 * (1 - np.cos(np.pi / 12))
    assert read_vector_curve(coarse).type_difference_m == pytest.approx(inside, rel=0.01)
    for radius, chosen, codes in (
        (1e-3, None, ["slicer-curve-type"]), (5e-3, None, []), (1e-3, "spline", []),
        (1e-3, "linear", []),
    ):  # fmt: skip
        settings = ExtractSettings(curve_type=chosen)
        findings = extract(coarse, settings, contact_radius=radius).findings
        assert [finding.code for finding in findings] == codes
    with refuses(SettingError, "setting-without-effect"):
        read_vector_curve(polyline(tmp_path, [(1, 1), (5, 5)]), curve_type="linear")


def test_a_point_that_is_there_twice_is_one(tmp_path):
    corners = [(10, 10), (50, 10), (50, 50)]
    once = read_vector_curve(polyline(tmp_path, [*corners, corners[0]]))
    twice = read_vector_curve(polyline(tmp_path, [corners[0], *corners, corners[0]]))
    assert np.array_equal(once.points, twice.points)
    with refuses(CurveError, "too-few-points"):
        read_vector_curve(slicer(tmp_path, RING_MM[[0, 1, 0]], "ClosedCurve"))
