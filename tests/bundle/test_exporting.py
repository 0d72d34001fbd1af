"""Lines and arcs as DXF and SVG: read back by ezdxf, and by SVG's own formulas."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import bundles
import numpy as np
import pytest

from vfplan.bundle import export, left_out
from vfplan.errors import InputError
from vfplan.fixture import Pieces


@pytest.fixture(scope="module")
def fixture():
    """Two strokes, one closed by half circles, in the tilted plane of `bundles.whole`."""
    whole = bundles.whole()
    axis = whole.ignore_axis
    x = np.cross(axis, [0.0, 1, 0])
    x /= np.linalg.norm(x)
    flat = 1e-3 * np.array([[0, 0], [10, 0], [17, 5], [30, 0], [40, 0]])
    vertices = flat @ np.stack([x, np.cross(axis, x)]) + 0.07 * axis
    pieces = Pieces(
        vertices, np.array([0, 0.4, 0, 1, 1.0]), np.array([0, 0, 0, 1, 1], np.int32),
        whole.curve.closed,
    )  # fmt: skip
    return replace(whole, curve=replace(whole.curve, pieces=pieces))


def middles(pieces, axis):
    """(P, 3) the middle of each piece [m]: bulge · half a chord to the right of the chord's."""
    found = []
    for number, closed in enumerate(pieces.closed):
        v, b = pieces.vertices[pieces.stroke == number], pieces.bulges[pieces.stroke == number]
        for i in range(len(v) - (not closed)):
            chord = v[(i + 1) % len(v)] - v[i]
            found.append(v[i] + chord / 2 - b[i] / 2 * np.cross(axis, chord))
    return np.array(found)


def test_ezdxf_reads_the_same_arcs_in_space(fixture, tmp_path):
    ezdxf = pytest.importorskip("ezdxf")
    path = tmp_path / "c.dxf"
    export(fixture, path)
    document = ezdxf.readfile(path)
    assert not document.audit().errors
    found = []
    for line in document.modelspace().query("POLYLINE"):
        for piece in line.virtual_entities():
            if piece.dxftype() == "LINE":
                found.append((piece.dxf.start + piece.dxf.end) / 2)
            else:
                half = math.radians((piece.dxf.end_angle - piece.dxf.start_angle) % 360 / 2)
                at = math.radians(piece.dxf.start_angle) + half
                place = piece.dxf.center + ezdxf.math.Vec3.from_angle(at, piece.dxf.radius)
                found.append(piece.ocs().to_wcs(place))
    wanted = middles(fixture.pieces, fixture.ignore_axis)
    assert 1e-3 * np.array([list(v) for v in found]) == pytest.approx(wanted, abs=1e-12)


def arc_middle(a, b, radius, sweep):
    """The middle of an SVG arc below a half circle: on the left of a to b where sweep is 1."""
    chord = b - a
    side = np.array([chord[1], -chord[0]]) / np.hypot(*chord) * (1 if sweep else -1)
    return (a + b) / 2 + side * (radius - math.sqrt(max(radius**2 - chord @ chord / 4, 0)))


def test_svg_draws_the_same_arcs(fixture, tmp_path):
    path = tmp_path / "c.svg"
    export(fixture, path)
    text = path.read_text()
    assert text.count("<path") == 2
    assert text.count("Z") == 1
    found = []
    for drawn in re.findall(r'd="([^"]*)"', text):
        at = None
        for kind, rest in re.findall(r"([MLA])([^MLAZ]*)", drawn):
            numbers = [float(v) for v in rest.split()]
            end = np.array(numbers[-2:])
            if kind == "L":
                found.append((at + end) / 2)
            if kind == "A":
                found.append(arc_middle(at, end, numbers[0], numbers[4]))
            at = end
    axis = fixture.ignore_axis
    x = np.cross([0.0, 1, 0] if max(abs(axis[:2])) < 1 / 64 else [0.0, 0, 1], axis)
    x /= np.linalg.norm(x)
    wanted = 1e3 * middles(fixture.pieces, axis)
    wanted = np.column_stack([wanted @ x, -wanted @ np.cross(axis, x)])
    assert np.array(found) == pytest.approx(wanted, abs=2e-3)  # half circles: root of a rounding


def test_what_is_no_drawing_is_said(fixture, tmp_path):
    assert "rendering" in left_out(fixture, "c.svg")
    assert "curve/pieces" not in left_out(fixture, "c.dxf")
    assert "curve/pieces" in left_out(fixture, "c.csv")
    with pytest.raises(InputError, match="without lines and arcs"):
        export(bundles.whole(), tmp_path / "c.dxf")
    assert not (tmp_path / "c.dxf").exists()
