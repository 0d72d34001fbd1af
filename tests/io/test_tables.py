"""Every small table is read by one reader: separators, decimals, encodings, remarks, blank ends."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from refusals import refuses

from vfplan.errors import InputError, MarkerError, SessionError
from vfplan.io.files import open_number_table
from vfplan.markers.correspondences import read_sides
from vfplan.session.events import POSE_COLUMNS, read_poses
from vfplan.session.read import read_session
from vfplan.vectors.read import read_vector_curve

NUMBERS = np.array([[40.5, 60.25], [44, 64.75], [48.125, 69]])
ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-be")
# Separator and decimal mark, as spreadsheets pair them.
MARKS = ((",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","))
FORMS = list(product(MARKS, ENCODINGS, ("\n", "\r\n"), ("", "remarks", "blank ends")))


def written(path, header, rows, marks, encoding, newline, extra):
    separator, decimal = marks
    lines = [[*header], *([str(cell).replace(".", decimal) for cell in row] for row in rows)]
    if extra == "blank ends":
        lines = [[*line, ""] for line in lines]
    lines = [separator.join(line) for line in lines]
    if extra == "remarks":
        lines = ["# by hand, on Monday", *lines[:2], "# the rest is sure", *lines[2:], ""]
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    path.write_bytes((mark + newline.join(lines)).encode(encoding))
    return path


@pytest.mark.parametrize("form", FORMS, ids=repr)
def test_a_table_reads_alike_in_every_form(tmp_path, form):
    rows = NUMBERS.tolist()
    curve = written(tmp_path / "c.csv", ("u_px", "v_px"), rows, *form)
    assert np.array_equal(read_vector_curve(curve).points, NUMBERS)
    labelled = [[f"#{k}", *row] for k, row in enumerate(rows)]
    marks = written(tmp_path / "m.csv", ("label", "u_px", "v_px"), labelled, *form)
    (side,) = read_sides(marks)
    assert side.labels == ("#0", "#1", "#2")
    assert np.array_equal(side.positions, NUMBERS)
    session = written(tmp_path / "s.csv", ("a", "b"), rows, *form)
    table = open_number_table(lambda: session.open("rb"), "s", InputError, ("a", "b"))
    assert np.array_equal(np.concatenate(list(table.blocks(("a", "b")))), NUMBERS)
    moves = [[k, *row, 0.0, 1, 0, 0, 0] for k, row in enumerate(rows)]
    poses = read_poses(written(tmp_path / "p.csv", POSE_COLUMNS, moves, *form))
    assert np.array_equal(poses.pose[:, :2], NUMBERS)


# Of a session: its header, each row's form, and the refusal if there is one.
FREE_CELLS = (
    ("t,x,y,z,note", "{},{},{},{},ok", None),
    ("t,x,y,z,note,", "{},{},{},{},,", None),
    ("t,x,y,z,at", "{},{},{},{},2026-01-02T03:04:05", None),
    ("t,x,y,z,f", "{},{},{},{},NA", None),
    ('"","t","x","y","z"', '"1",{},{},{},{}', None),
    ("t,x,y,z,n", '{},{},{},{},"a, b"', None),
    ("sep=,\nt,x,y,z", "{},{},{},{}", None),
    ("t,x_m,y_m,z [m]", "{},{},{},{}", None),
    ("t,x,x_wanted,y,z", "{},{},7,{},{}", None),
    ("t;x;y;z;version", "{};{};{};{};1,2.3", None),
    ("t,x,y,z,note", "{},{},{},{},gr\xfc\xdf", None),
    ("t,x_mm,y_mm,z_mm", "{},{},{},{}", "units-differ"),
    ("t,x_ft,y_ft,z_ft", "{},{},{},{}", "column-missing"),
    ("t,x,x_m,y,z", "{},{},7,{},{}", "column-doubled"),
    ("t,x,y,z_wanted", "{},{},{},{}", "column-missing"),
)


@pytest.mark.parametrize("header, form, code", FREE_CELLS)
def test_columns_that_are_not_used_may_hold_anything(tmp_path, header, form, code):
    wanted = [[0, 1, 2, 3], [0.5, 1, 2.25, 3], [1, 1, 2, -3]]
    text = "\n".join([header, *(form.format(*row) for row in wanted), "# end"])
    (tmp_path / "s.csv").write_bytes(text.encode("latin-1"))
    if code is None:
        session = read_session(tmp_path / "s.csv")
        assert np.array_equal(np.c_[session.time, session.hip], wanted)
    else:
        with refuses(SessionError, code):
            read_session(tmp_path / "s.csv")


def test_a_row_whose_label_begins_like_a_remark_is_no_remark(tmp_path):
    (tmp_path / "m.csv").write_text("label,u_px,v_px\n# x1,one,2\nx2,1,2")
    with refuses(MarkerError, "no-number"):
        read_sides(tmp_path / "m.csv")
