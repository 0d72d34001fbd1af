"""Marker files: every form read, every ambiguity refused by name."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import file_with
from numpy.testing import assert_allclose, assert_array_equal
from refusals import refuses
from slicer_files import mrk

import vfplan
from vfplan.errors import MarkerError
from vfplan.markers.correspondences import read_markers, read_sides

IMAGE = "label,u_px,v_px\nx1,10,20\nx2,30,25\nx3,12,60\n"
ROBOT = "label,x_m,y_m,z_m\nx3,0.3,0,0\nx1,0.1,0,0.5\nx2,0.2,0,0\n"
BOTH = "label,u_px,v_px,x_m,y_m,z_m\nx1,10,20,0.1,0,0.5\nx2,30,25,0.2,0,0\nx3,12,60,0.3,0,0\n"


@pytest.fixture
def write(tmp_path):
    return lambda name, text: file_with(tmp_path / name, text)


POINTS = [(f"x{i}", [10.0 * i, -5.0, 2.0 * i * i], "defined") for i in (1, 2, 3)]
LPS_M = np.array([xyz for _, xyz, _ in POINTS]) * 1e-3


def test_one_file_and_two_files_in_any_order_are_the_same(write):
    image, robot = write("i.csv", IMAGE), write("r.csv", ROBOT)
    for found in (
        read_markers(write("b.csv", BOTH)),
        read_markers(image, robot),
        read_markers(robot, image),
        vfplan.read_markers(str(image), str(robot)),
    ):
        assert found.labels == ("x1", "x2", "x3")
        assert found.source_frame == "image"
        assert found.target_frame == "robot_base"
        assert found.sigma is None
        assert_array_equal(found.source, [[10, 20], [30, 25], [12, 60]])
        assert_array_equal(found.target, [[0.1, 0, 0.5], [0.2, 0, 0], [0.3, 0, 0]])


def test_column_order_and_notes_do_not_matter(write):
    text = " v_px , note,label, u_px\n20,near,x1,10\n25,,x2,30\n60,far,x3,12\n"
    found = read_markers(write("i.csv", text), write("r.csv", ROBOT))
    assert_array_equal(found.source, [[10, 20], [30, 25], [12, 60]])


@pytest.mark.parametrize(
    "header, rows",
    [
        ("x_m,y_m,z_m,sigma", "x3,3,0,0,0.003\nx1,1,0,0,0.001\nx2,2,0,0,0.002\n"),
        ("x_m,y_m,z_m,sigma_m", "x3,3,0,0,0.003\nx1,1,0,0,0.001\nx2,2,0,0,0.002\n"),
        ("x_mm,y_mm,z_mm,sigma_mm", "x1,1,2,3,1\nx2,4,5,6,2\nx3,7,8,9,3\n"),
        ("x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m",
         "x1,1,0,0,7,8,0.001\nx2,2,0,0,7,8,0.002\nx3,3,0,0,7,8,0.003\n"),
    ],
)  # fmt: skip
def test_sigma_follows_its_label_and_unit(write, header, rows):
    found = read_markers(write("i.csv", IMAGE), write("r.csv", f"label,{header}\n{rows}"))
    last = found.sigma if found.sigma.ndim == 1 else found.sigma[:, 2]
    assert_allclose(last, [0.001, 0.002, 0.003], rtol=1e-15)


@pytest.mark.parametrize(
    "units, factor", [("mm", 1), ("um", 1e3), (["mm", "UCUM", "millimeter"], 1), ("m", 1e-3)]
)
@pytest.mark.parametrize("system", [None, "LPS", "RAS"])
def test_mrk_json_units_and_frames(write, units, factor, system):
    sign = np.array([-1, -1, 1]) if system == "RAS" else np.ones(3)
    points = [(label, (np.array(xyz) * factor * sign).tolist(), "defined")
              for label, xyz, _ in POINTS]  # fmt: skip
    markup = {"coordinateUnits": units} | ({} if system is None else {"coordinateSystem": system})
    found = read_markers(write("p.mrk.json", mrk(points, **markup)), write("r.csv", ROBOT))
    assert found.source_frame == "patient_lps"
    assert_allclose(found.source, LPS_M, rtol=1e-15)
    assert_array_equal(found.target[:, 0], [0.1, 0.2, 0.3])


def test_mrk_json_leaves_undefined_points_out(write):
    points = [*POINTS, ("x4", [0, 0, 0], "undefined"), ("x5", [0, 0, 0], "preview")]
    found = read_markers(write("r.csv", ROBOT), write("p.mrk.json", mrk(points)))
    assert found.labels == ("x1", "x2", "x3")


@pytest.mark.parametrize("system, sign", [("0", -1), ("RAS", -1), ("1", 1), ("LPS", 1)])
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_fcsv_of_slicer_4(write, system, sign, ending):
    lines = [
        "# Markups fiducial file version = 4.11",
        f"# CoordinateSystem = {system}",
        "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID",
        *(f"{i},{sign * x},{sign * y},{z},0,0,0,1,1,1,0,{label},,vtk,2,0"
          for i, (label, (x, y, z), _) in enumerate(POINTS)),
    ]  # fmt: skip
    found = read_markers(write("p.fcsv", ending.join(lines) + ending), write("r.csv", ROBOT))
    assert_allclose(found.source, LPS_M, rtol=1e-15)


def test_fcsv_of_slicer_3_is_ras(write):
    text = "# name = a\n" + "".join(f"{k},{-x},{-y},{z},1,1\n" for k, (x, y, z), _ in POINTS)
    found = read_markers(write("p.fcsv", text), write("r.csv", ROBOT))
    assert_allclose(found.source, LPS_M, rtol=1e-15)


def test_two_slicer_files_the_first_is_the_source(write):
    moved = [(label, [x + 1, y, z], status) for label, (x, y, z), status in POINTS]
    found = read_markers(write("a.mrk.json", mrk(POINTS)), write("b.mrk.json", mrk(moved)))
    assert (found.source_frame, found.target_frame) == ("patient_lps", "patient_lps")
    assert_allclose(found.target - found.source, [[1e-3, 0, 0]] * 3, atol=1e-15)


def test_real_slicer_files(shared_data):
    folder = shared_data / "markers_slicer"
    (l1,) = read_sides(folder / "L1.fcsv")
    assert l1.labels == ("L1-P1", "L1-P2")
    assert_allclose(l1.positions[1] * 1e3, [-49.8834, 4.33769, 0], rtol=1e-12)
    (afid,) = read_sides(folder / "afid_sub-087.fcsv")
    assert len(afid.labels) == 32
    first = [1.7233007926589394, -29.939802490250948, -15.162710714603704]
    assert_allclose(afid.positions[0] * 1e3, first)
    (f5,) = read_sides(folder / "F_5.json")
    assert len(f5.labels) == 20  # F_5-16 was deleted in Slicer
    assert_allclose(f5.positions[0, 0] * 1e3, -104.41897583007813)


BAD_TABLES = {
    "column-missing": [
        "label,u_px\nx1,1\n", "label,u_px,v_px,x_m,y_m\nx1,1,1,1,1\n", "who,u_px,v_px\nx1,1,1\n",
        "label,left,top\nx1,1,1\n", "x1;0.4;0.1;0.02\nx2;0.5;0.1;0.02\n",
    ],
    "columns-ambiguous": ["label,x_m,y_mm,z_m\nx1,1,1,1\n",
                          "label,x_m,y_m,z_m,x_mm,y_mm,z_mm\nx1,1,1,1,1,1,1\n"],
    "column-doubled": ["label,u_px,U_px,v_px\nx1,1,1,1\n"],
    "column-unknown": ["label,u_px,v_px,x_inch\nx1,1,1,1\n",
                       "label,x_m,y_m,z_m,sigma_inch\nx1,1,1,1,1\n"],
    "no-number": [
        "label,u_px,v_px\nx1,1,1\nx2,nan,1\n", "label,u_px,v_px\nx1,1,inf\n",
        "label,u_px,v_px\nx1,,1\n", "label,u_px,v_px\nx1,1;2,1\n", "label,u_px,v_px\nx1,1_0,2\n",
    ],
    "number-too-large": ["label,u_px,v_px\nx1,1e10,2\n"],
    "label-doubled": ["label,u_px,v_px\nx1,1,1\nx2,3,4\nx1,2,2\n"],
    "label-missing": ["label,u_px,v_px\nx1,1,1\n ,1,2\n"],
    "label-control-character": ["label,u_px,v_px\nx1\0,1,1\n"],
    "row-length": ["label,u_px,v_px\nx1,1\n", "label,u_px,v_px\nx1,1,5,2,5\n"],
    "sigma-without-positions": ["label,u_px,v_px,sigma_m\nx1,1,1,1\n"],
    "no-markers": ["label,u_px,v_px\n"],
    "table-empty": ["\n"],
    "table-broken": ['label,u_px,v_px\n"x1,1,2\nx2,1,2\n',
                     "label,u_px,v_px\n" + "a" * 200_000 + ",1,2\n"],
    "separator-ambiguous": ["label;u_px,v_px\nx1;1,2\n"],
    "decimal-ambiguous": ["label;u_px;v_px\nx1;1,5;2,5\nx2;1.5;2.5\n",
                          "label;u_px;v_px\nx1;1.234,5;2\n", "label;u_px;v_px\nx1;1,234,5;2\n"],
    "unit-unclear": ["Name;X;Y;Z\nx1;1;2;3\nx2;2;3;1\nx3;5;1;9\n"],
}  # fmt: skip


@pytest.mark.parametrize(
    "code, text", [(code, text) for code, texts in BAD_TABLES.items() for text in texts]
)
def test_bad_tables_are_refused(write, code, text):
    path = write("i.csv", text)
    with refuses(MarkerError, code) as caught:
        read_markers(path, write("r.csv", ROBOT))
    assert caught.value.where.startswith(str(path))
    assert caught.value.exit_code == 3


@pytest.mark.parametrize(
    "text, line",
    [
        ("label,u_px,v_px\nx1,1,1\n\nx2,nan,1\n", 4), ("label,u_px,v_px\nx1,1,1\nx2,1\n", 3),
        ("\nlabel;u_px,v_px\nx1;1,2\n", 2), ("x1;0.4;0.1;0.02\n", 1),
        ("label;u_px;v_px\nx1;1,5;2,5\nx2;1.5;2.5\n", 3),
    ],
)  # fmt: skip
def test_the_line_is_named(write, text, line):
    path = write("i.csv", text)
    with pytest.raises(MarkerError) as caught:
        read_markers(path, write("r.csv", ROBOT))
    assert caught.value.where == f"{path}, line {line}"


# The same three markers, as people's programs write them.
FORMS = {
    "millimetres": "label,x_mm,y_mm,z_mm\nx1,100,0,500\nx2,200,0,0\nx3,300,0,0\n",
    "centimetres": "label,x_cm,y_cm,z_cm\nx1,10,0,50\nx2,20,0,0\nx3,30,0,0\n",
    "units in brackets": "Label,X [mm],Y [mm],Z [mm]\nx1,100,0,500\nx2,200,0,0\nx3,300,0,0\n",
    "a tracker's, in millimetres": "Name,X,Y,Z\nx1,100,0,500\nx2,200,0,0\nx3,300,0,0\n",
    "a tracker's, in metres": "Name;X;Y;Z\nx1;0,1;0;0,5\nx2;0,2;0;0\nx3;0,3;0;0\n",
}


@pytest.mark.parametrize("form", FORMS)
def test_the_files_that_people_have_are_read(write, form):
    pairs = read_markers(write("i.csv", IMAGE), write("r.csv", FORMS[form]))
    assert_allclose(pairs.target, [[0.1, 0, 0.5], [0.2, 0, 0], [0.3, 0, 0]], rtol=1e-15)
    concluded = [finding.code for finding in pairs.findings]
    assert concluded == (["unit-concluded"] if "tracker" in form else [])


# Three points as ImageJ 1.54 writes them (Analyzer.savePoints, Roi Properties > List coordinates).
IN_IMAGEJ = {
    "results": " ,Label,Area,Mean,Min,Max,X,Y\n"
    "1,s.png,0,7,7,7,10,20\n2,s.png,0,9,9,9,30,25\n3,s.png,0,8,8,8,12,60\n",
    "multi-point results": " ,Area,Mean,X,Y,Counter,Count\n1,0,7,10,20,0,3\n2,0,9,30,25,0,3\n"
    "3,0,8,12,60,0,3\n",
    "centres of mass": " ,X,Y,XM,YM\n1,10,20,9,9\n2,30,25,9,9\n3,12,60,9,9\n",
    "a list": "X\tY\n10\t20\n30\t25\n12\t60\n",
    "centroids of areas": " ,Area,X,Y\n1,40,10.5,20.5\n2,41,30.5,25.5\n3,39,12.5,60.5\n",
    "in millimetres": " ,X (mm),Y (mm)\n1,4,5\n2,12,6.25\n3,4.8,15\n",
    "in centimetres": " ,Area,X_cm,Y_cm\n1,0,0.4,0.5\n2,0,1.2,0.625\n3,0,0.48,1.5\n",
    "areas in millimetres": " ,Area,X[mm],Y[mm]\n1,4,4.2,5.125\n2,4,12.2,6.375\n3,4,5,15.125\n",
}


@pytest.mark.parametrize("form", IN_IMAGEJ)
def test_imagejs_tables_are_markers_by_the_numbers_of_their_points(write, form):
    image, robot = write("i.csv", IN_IMAGEJ[form]), write("r.csv", ROBOT.replace("\nx", "\n"))
    is_calibrated = "metres" in form
    if is_calibrated:
        with refuses(MarkerError, "markers-without-spacing"):
            read_markers(image, robot)
    pairs = read_markers(image, robot, spacing_mm=(0.4, 0.25))
    assert (pairs.labels, pairs.source_frame) == (("1", "2", "3"), "image")
    assert_allclose(pairs.source, [[10, 20], [30, 25], [12, 60]], atol=1e-12)
    found = [(finding.code, finding.severity) for finding in pairs.findings]
    unit_doubt = [] if is_calibrated else [("imagej-table", "doubt")]
    assert found == [*unit_doubt, ("points-numbered", "note")]


def test_names_that_a_person_gave_in_imagejs_table_stay(write):
    text = "Name,X,Y\nx3,12,60\nx1,10,20\nx2,30,25\n"
    pairs = read_markers(write("i.csv", text), write("r.csv", ROBOT))
    assert pairs.labels == ("x3", "x1", "x2")
    assert "points-numbered" not in {finding.code for finding in pairs.findings}
    with refuses(MarkerError, "label-doubled"):
        read_markers(write("i.csv", text.replace("x3", "x1")), write("r.csv", ROBOT))
    with refuses(MarkerError, "column-unknown"):
        image = write("i.csv", "label,X (\u0131n),Y (\u0131n)\na,1,2\n")
        read_markers(image, write("r.csv", ROBOT))


def test_common_takes_the_labels_that_both_sides_have(write):
    image = write("i.csv", IMAGE + "x9,1,1\n")
    robot = write("r.csv", ROBOT + "M6,1,1,1\n")
    with refuses(MarkerError, "labels-differ", labels=["x9"]) as caught:
        read_markers(image, robot)
    assert "delete x9" in caught.value.message
    assert "--common" in caught.value.message
    pairs = read_markers(image, robot, common=True)
    assert pairs.labels == ("x1", "x2", "x3")
    assert [finding.code for finding in pairs.findings] == ["markers-not-common"] * 2
    assert_array_equal(pairs.target[:, 0], [0.1, 0.2, 0.3])


HEAD = "# Markups fiducial file version = 4.11\n"
BAD_SLICER_FILES = [
    ("json", "is not JSON", "{"),
    ("json", "holds a list", "[]"),
    ("json", "@schema is None", "{}"),
    ("json", "'markups' is not a list", '{"@schema": "markups-schema-v1.0.0.json"}'),
    ("json", "holds 'Curve'", mrk(POINTS, type="Curve")),
    ("json", "coordinateUnits is 'inch'", mrk(POINTS, coordinateUnits="inch")),
    ("json", "coordinateSystem is 'IJK'", mrk(POINTS, coordinateSystem="IJK")),
    ("json", "Give three numbers", mrk([("x1", [1, 2], "defined")])),
    ("json", "Give a finite number", mrk([("x1", [1, 2, float("nan")], "defined")])),
    ("json", "Give a number", mrk([("x1", [1, 2, "a"], "defined")])),
    ("json", r"True\. Give a number", mrk([("x1", [True, 0, 0], "defined")])),
    ("json", "has no label", mrk([("", [1, 2, 3], "defined")])),
    ("json", "holds no marker", mrk([])),
    ("xlsx", "suffix '.xlsx'", IMAGE),
    ("fcsv", "CoordinateSystem is None", HEAD),
    ("fcsv", "CoordinateSystem is '2'", HEAD + "# CoordinateSystem = 2\n"),
    ("fcsv", "columns are", HEAD + "# CoordinateSystem = 0\n# columns = label,x,y,z\n"),
    ("fcsv", "Give a number", HEAD + "# CoordinateSystem = 0\n1,1,2,z,0,0,0,1,1,1,0,x1,,\n"),
    ("fcsv", "has no label", HEAD + "# CoordinateSystem = 0\n1,1,2,3\n"),
]


@pytest.mark.parametrize("suffix, message, text", BAD_SLICER_FILES)
def test_other_bad_files_are_refused_by_name(write, suffix, message, text):
    with pytest.raises(MarkerError, match=message):
        read_markers(write(f"p.{suffix}", text), write("r.csv", ROBOT))


def test_two_files_for_one_side_and_one_file_for_two(write):
    image, robot, both = write("i.csv", IMAGE), write("r.csv", ROBOT), write("b.csv", BOTH)
    for files, words in (((image, image), "both files hold image positions"),
                         ((robot,), "holds only robot_base positions"),
                         ((both, robot), "one holds both sides already")):  # fmt: skip
        with pytest.raises(MarkerError, match=words):
            read_markers(*files)


def test_a_table_may_end_its_lines_with_cr_alone(write):
    table = "label,u_px,v_px,x_m,y_m,z_m\ra,1,2,3,4,5\rb,6,7,8,9,10\r"
    pairs = read_markers(write("old.csv", table))
    assert pairs.labels == ("a", "b")
    assert pairs.target[1].tolist() == [8, 9, 10]
