"""Curves drawn in ImageJ: selections (`.roi`) and tables of their X,Y coordinates."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from captures import capture
from conftest import file_with
from refusals import refuses
from vector_files import polyline

from vfplan.errors import CurveError, MissingExtra, SettingError
from vfplan.planning.extraction import extract
from vfplan.planning.settings import ExtractSettings
from vfplan.vectors.read import onto_slice, read_vector_curve

roifile = pytest.importorskip("roifile", reason="needs pip install 'vfplan[imagej]'")

LINE = [(10.25, 20.5), (40.0, 24.75), (60.5, 30.0)]
LINE_PX = [(10, 20), (40, 24), (60, 30)]
SQUARE = [(10, 10), (50, 10), (50, 50), (10, 50)]


def selection(tmp_path, kind, points, version=229, name="c.roi", **more):
    """A selection as the package roifile writes it; parts of a pixel are kept where there are."""
    roi = roifile.ImagejRoi.frompoints(np.array(points))
    roi.roitype, roi.version = roifile.ROI_TYPE[kind], version
    for key, value in more.items():
        setattr(roi, key, value)
    return file_with(tmp_path / name, roi.tobytes())


def by_hand(points, kind=5, count=None):
    """A selection of whole pixels, byte by byte: the format as ImageJ's RoiDecoder reads it."""
    x, y = np.array(points).T
    left, top = x.min(), y.min()
    count = len(points) if count is None else count
    head = struct.pack(">4shBxhhhhH", b"Iout", 229, kind, top, left, y.max(), x.max(), count)
    return head.ljust(64, b"\0") + struct.pack(f">{2 * len(x)}h", *(x - left), *(y - top))


@pytest.mark.parametrize("kind", ["POLYLINE", "FREELINE"])
def test_a_line_counts_from_pixels_centres(tmp_path, kind):
    curve = read_vector_curve(selection(tmp_path, kind, LINE))
    assert (curve.closed, curve.joined, curve.warnings) == (False, "straight", ())
    assert np.allclose(curve.points, LINE, atol=1e-5)


@pytest.mark.parametrize("kind", ["POLYGON", "FREEHAND", "TRACED"])
def test_an_area_counts_from_pixels_corners_and_is_closed(tmp_path, kind):
    for points in (SQUARE, [*SQUARE, SQUARE[0]]):
        curve = read_vector_curve(selection(tmp_path, kind, points, version=228))
        assert curve.closed
        assert curve.points.tolist() == [[u - 0.5, v - 0.5] for u, v in SQUARE]
        assert len(curve.stroke(1.0).points) == 160
        assert curve.warnings == ()


def test_the_format_is_read_byte_by_byte(tmp_path):
    path = file_with(tmp_path / "c.roi", by_hand([(300, 7), (10, 90), (40000 - 20000, 500)]))
    assert read_vector_curve(path).points.tolist() == [[300, 7], [10, 90], [20000, 500]]
    path.write_bytes(by_hand(SQUARE, kind=0))
    assert read_vector_curve(path).points.tolist() == [[u - 0.5, v - 0.5] for u, v in SQUARE]


def test_what_a_line_of_an_older_format_counts_from_is_warned_of_or_asked_for(tmp_path):
    unsure = selection(tmp_path, "POLYLINE", LINE, version=228, name="a.roi")
    curve = read_vector_curve(unsure)
    assert np.allclose(curve.points, LINE, atol=1e-5)
    assert "half a pixel off" in curve.warnings[0]
    assert read_vector_curve(unsure, "centre").warnings == ()
    old = selection(tmp_path, "POLYLINE", LINE, version=227, name="b.roi")
    with pytest.raises(CurveError, match=r"before 1\.52i.*--curve-origin centre or corner"):
        read_vector_curve(old)
    assert np.allclose(read_vector_curve(old, "corner").points, np.array(LINE) - 0.5, atol=1e-5)


def test_an_origin_where_the_file_tells_it_is_refused(tmp_path):
    lines = selection(tmp_path, "POLYLINE", LINE, name="l.roi")
    for path in (selection(tmp_path, "POLYGON", SQUARE), lines, polyline(tmp_path, SQUARE)):
        with pytest.raises(SettingError, match="has no effect"):
            read_vector_curve(path, "corner")
    with pytest.raises(SettingError, match="without a vector curve"):
        extract(capture(tmp_path), ExtractSettings(curve_origin="centre"))
    with refuses(SettingError, "origin-unknown"):
        read_vector_curve(path, "middle")


@pytest.mark.parametrize(
    "given, told",
    [
        ({"kind": "RECT"}, "RECT"), ({"kind": "OVAL"}, "OVAL"), ({"kind": "POINT"}, "POINT"),
        ({"kind": "ANGLE"}, "ANGLE"), ({"kind": "LINE"}, "LINE"),
        ({"kind": "FREEHAND", "subtype": roifile.ROI_SUBTYPE.ELLIPSE}, "ELLIPSE"),
        ({"kind": "POLYLINE", "options": roifile.ROI_OPTIONS.SPLINE_FIT}, "Interpolate"),
    ],
    ids=str,
)  # fmt: skip
def test_other_selections_are_refused_by_name(tmp_path, given, told):
    with pytest.raises(CurveError, match=told):
        read_vector_curve(selection(tmp_path, points=SQUARE, **given))


def test_a_composite_is_refused(tmp_path):
    data = by_hand(SQUARE, kind=1)
    (tmp_path / "c.roi").write_bytes(data[:36] + struct.pack(">i", 2) + data[40:])
    with pytest.raises(CurveError, match="composite"):
        read_vector_curve(tmp_path / "c.roi")


def test_damaged_selections_are_refused_and_take_no_memory(tmp_path):
    whole = selection(tmp_path, "POLYLINE", LINE).read_bytes()
    path = tmp_path / "d.roi"
    none = by_hand(LINE_PX, count=0)
    many, minus = (none[:18] + struct.pack(">i", n) + none[22:] for n in (2**31 - 1, -5))
    nan = whole.replace(struct.pack(">f", 10.25), struct.pack(">f", np.nan))
    assert nan != whole
    cut = [whole[:n] for n in (0, 3, 10, 63, 64, 70, 90)]
    for data in (*cut, b"Iout" * 30, by_hand(LINE_PX, count=60000), many, minus, nan):
        path.write_bytes(data)
        with pytest.raises(CurveError):
            read_vector_curve(path)


def test_without_the_package_its_name_is_told(tmp_path, monkeypatch):
    path = selection(tmp_path, "POLYLINE", LINE)
    monkeypatch.setitem(__import__("sys").modules, "roifile", None)
    with pytest.raises(MissingExtra, match=r"vfplan\[imagej\]"):
        read_vector_curve(path)


def table(tmp_path, text):
    return file_with(tmp_path / "t.csv", text)


@pytest.mark.parametrize("text", ["X,Y\n1,2\n3.5,4\n", " ,X,Y\n1,1,2\n2,3.5,4\n"], ids=repr)
def test_coordinates_of_a_table_count_from_where_is_said(tmp_path, text):
    path = table(tmp_path, text)
    assert read_vector_curve(path, "centre").points.tolist() == [[1, 2], [3.5, 4]]
    assert read_vector_curve(path, "corner").points.tolist() == [[0.5, 1.5], [3, 3.5]]
    with pytest.raises(CurveError, match="--curve-origin centre or corner"):
        read_vector_curve(path)


@pytest.mark.parametrize(
    "text, told",
    [
        ("X,Y,Value\n1,2,7\n2,2,7\n", "every pixel of an area"),
        ("X,Y\n1\n", "has 1 cells"), ("X,Y\n1,b\n2,3\n", "Give a number"),
        (" ,X,Y\n1,2\n2,3\n", "has 2 cells"), ("X,Y\n", "0 different points"),
        ("Y,X\n1,2\n3,4\n", "u_px,v_px or ImageJ's X,Y"),
    ],
    ids=repr,
)  # fmt: skip
def test_other_tables_are_refused(tmp_path, text, told):
    with pytest.raises(CurveError, match=told):
        read_vector_curve(table(tmp_path, text), "centre")


@pytest.mark.parametrize("header", ["X (mm),Y (mm)", "X_mm,Y_mm", "x [cm],y [cm]"])
@pytest.mark.parametrize("origin", ["centre", "corner"])
def test_a_calibrated_table_is_measured_on_the_image_that_has_a_spacing(tmp_path, header, origin):
    pixels = np.array([(10.0, 20.0), (40.5, 24.0), (60.0, 90.25)])
    from_corner = 0.5 * (origin == "corner")
    lengths = (pixels + from_corner) * (0.4, 0.25) / (10.0 if "cm" in header else 1.0)
    path = tmp_path / "c.csv"
    np.savetxt(path, lengths, header=header, delimiter=",", comments="", fmt="%.12g")
    curve = read_vector_curve(path, origin)
    placed = onto_slice(curve, None, "c.csv", (0.4, 0.25))
    assert np.allclose(placed.points, pixels, rtol=0, atol=1e-9)
    with refuses(CurveError, "curve-without-spacing"):
        extract(path, ExtractSettings(curve_origin=origin))
    with refuses(CurveError, "origin-unknown"):
        read_vector_curve(path)
