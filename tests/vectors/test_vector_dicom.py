"""Lines of DICOM presentation states."""

from __future__ import annotations

import numpy as np
import pytest
from bones import item, write_dicom
from captures import capture
from drawing import normal_errors
from refusals import refuses
from vector_files import polyline

from vfplan.errors import CurveError, SettingError
from vfplan.planning.extraction import extract
from vfplan.planning.settings import ExtractSettings
from vfplan.vectors.read import read_vector_curve

GREY = np.tile(np.arange(100, dtype=np.uint8), (80, 1))
LINE = np.array([(20.5, 20.5), (60.5, 30.5), (70.5, 60.5)])  # from the first pixel's corner


def graphic(points=LINE, kind="POLYLINE", units="PIXEL"):
    return item(
        GraphicAnnotationUnits=units, GraphicDimensions=2, NumberOfGraphicPoints=len(points),
        GraphicType=kind, GraphicData=np.ravel(points).tolist(), GraphicFilled="N",
    )  # fmt: skip


def state(tmp_path, *graphics, image="1.2.3.4", **frames):
    """A presentation state with a layer of graphics on an image."""
    layer = item(GraphicLayer="CUT", GraphicObjectSequence=list(graphics))
    if image:
        named = item(ReferencedSOPClassUID="1.2", ReferencedSOPInstanceUID=image, **frames)
        layer.ReferencedImageSequence = [named]
    kind, path = "1.2.840.10008.5.1.4.1.1.11.1", tmp_path / "state.dcm"
    return write_dicom(path, kind, "1.2.3.5", "PR", GraphicAnnotationSequence=[layer])


def test_a_presentation_states_polyline_counts_from_the_first_pixels_corner(tmp_path):
    curve = read_vector_curve(state(tmp_path, graphic()))
    assert curve.points.tolist() == (LINE - 0.5).tolist()
    assert (curve.closed, curve.joined, curve.warnings) == (False, "straight", ())


def test_one_that_returns_is_closed_and_an_interpolated_one_is_a_spline_with_a_warning(tmp_path):
    ring = np.vstack([LINE, LINE[:1]])
    curve = read_vector_curve(state(tmp_path, graphic(ring, "INTERPOLATED")))
    assert (curve.closed, curve.joined, len(curve.points)) == (True, "spline", 3)
    (told,) = curve.warnings
    assert "px from straight lines" in told


@pytest.mark.parametrize("given, other, number, told", [
    ([graphic(), graphic(LINE + 5), graphic(LINE[:1], "POINT")], "POINT of 1", 2, "2 curves 2"),
    ([graphic(LINE[:2], "CIRCLE"), graphic(LINE + 5)], "CIRCLE of 2", 1, "1 curve 1"),
])  # fmt: skip
def test_of_several_graphics_a_line_is_chosen_and_named(tmp_path, given, other, number, told):
    path = state(tmp_path, *given)
    with refuses(CurveError, "vector-several", curves=number) as refused:
        read_vector_curve(path)
    assert "1: POLYLINE of 3 points" in refused.value.message
    assert f"not read: {other}" in refused.value.message
    curve = read_vector_curve(path, number=number)
    assert curve.points.tolist() == (LINE + 4.5).tolist()
    told = f"of {told}: POLYLINE of 3 points, layer 'CUT' is taken; not read: {other}"
    assert told in curve.warnings[0]
    with refuses(CurveError, "vector-number", number=number + 1):
        read_vector_curve(path, number=number + 1)


@pytest.mark.parametrize(
    "given, words",
    [
        ([], "no drawing"), ([graphic(units="DISPLAY")], "DISPLAY units"),
        ([graphic(LINE[:2], "CIRCLE")], "CIRCLE of 2 points"),
        ([graphic([(1.0, 1.0), (1.0, 1.0)])], "different points"),
        ([graphic([(1.0, np.nan), (1.0, 2.0)])], "not finite"),
        ([graphic([(1.0, 1.0), (1.0, 2.0)])] * 2, "none was chosen"),
    ],
)  # fmt: skip
def test_what_is_no_curve_is_refused_by_name(tmp_path, given, words):
    with pytest.raises(CurveError, match=words):
        read_vector_curve(state(tmp_path, *given))


def test_a_state_is_taken_on_the_image_it_names_alone(tmp_path):
    slice_ = capture(tmp_path, GREY, "MONOCHROME2")
    made = extract(slice_, ExtractSettings(), curve=state(tmp_path, graphic()))
    stroke = made.extraction.strokes[0]
    assert np.abs(normal_errors(stroke.points_px, LINE - 0.5, False)).max() < 0.03
    assert made.findings == ()
    for given, words in (({"image": "9.9"}, r"other image\(s\), the first 9\.9"),
                         ({"ReferencedFrameNumber": [2]}, "on frame 2, not 1")):  # fmt: skip
        with pytest.raises(CurveError, match=words):
            extract(slice_, ExtractSettings(), curve=state(tmp_path, graphic(), **given))
    made = extract(slice_, ExtractSettings(), curve=state(tmp_path, graphic(), image=None))
    assert made.findings == ()


def test_a_damaged_file_is_refused(tmp_path):
    path = state(tmp_path, graphic())
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(CurveError):
        read_vector_curve(path)


def test_a_number_has_no_effect_on_other_files(tmp_path):
    with pytest.raises(SettingError, match="stroke 1 has no effect"):
        read_vector_curve(polyline(tmp_path, [(1, 2), (3, 4)]), number=1)
    image = capture(tmp_path, GREY, "MONOCHROME2")
    with pytest.raises(SettingError, match="stroke 'all' has no effect"):
        extract(image, ExtractSettings(stroke="all"), curve=state(tmp_path, graphic()))


@pytest.mark.parametrize("number", [0, -1, True])
def test_what_is_no_number_from_1_takes_no_curve(tmp_path, number):
    with refuses(SettingError, "stroke-unknown"):
        read_vector_curve(state(tmp_path, graphic(), graphic(LINE + 200)), number=number)


PIXELS = [10, 10, 60, 10, 60, 40]
SPACE = [1, 2, 3, 11, 2, 3, 11, 8, 3]
IMAGE = item(ReferencedSOPInstanceUID="1.2.3.4")


KINDS = ["POLYLINE", "ring", "SCOORD3D", "POLYGON", "OPEN_PLANAR", "CLOSED_PLANAR"]


@pytest.mark.parametrize("kind", KINDS)
def test_lines_of_reports_and_structures_are_read(tmp_path, kind):
    source = item(ValueType="IMAGE", ReferencedSOPSequence=[IMAGE])
    flat = {"ValueType": "SCOORD", "GraphicType": "POLYLINE", "ContentSequence": [source]}
    space = {"ValueType": "SCOORD3D", "GraphicData": SPACE}
    if kind.endswith("PLANAR"):
        contour = item(ContourGeometricType=kind, ContourData=SPACE, NumberOfContourPoints=3)
        point = item(ContourGeometricType="POINT", ContourData=SPACE[:3], NumberOfContourPoints=1)
        roi = item(ReferencedROINumber=7, ContourSequence=[point, contour])
        content = {"ROIContourSequence": [roi]}
    else:
        mark = {
            "POLYLINE": item(GraphicData=PIXELS, **flat),
            "ring": item(GraphicData=[*PIXELS, *PIXELS[:2]], **flat),
            "SCOORD3D": item(GraphicType="POLYLINE", **space),
            "POLYGON": item(GraphicType="POLYGON", **space),
        }[kind]
        group = item(ValueType="CONTAINER", ContentSequence=[item(ValueType="NUM"), mark])
        content = {"ContentSequence": [group]}
    kind_of_report, path = "1.2.840.10008.5.1.4.1.1.88.33", tmp_path / "report.dcm"
    write_dicom(path, kind_of_report, "1.2.3.5", "SR", **content)
    curve = read_vector_curve(path, number=1)
    assert curve.closed == (kind in ("ring", "POLYGON", "CLOSED_PLANAR"))
    if curve.points.shape[1] == 2:
        assert curve.points.tolist() == (np.reshape(PIXELS, (-1, 2)) - 0.5).tolist()
        assert curve.drawn_on == {"1.2.3.4": []}
    else:
        assert np.allclose(curve.points, np.reshape(SPACE, (-1, 3)) * 1e-3, atol=1e-15)
    assert bool(curve.warnings) == kind.endswith("PLANAR")
