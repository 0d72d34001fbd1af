"""Lines and arcs as DXF and SVG: read back by ezdxf, and by SVG's own formulas."""

from __future__ import annotations

import math
from dataclasses import replace

import bundles
import numpy as np
import pytest

from vfplan.bundle.exporting import export, left_out
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


def test_what_is_no_drawing_is_said(fixture, tmp_path):
    assert "rendering" in left_out(fixture, "c.dxf")
    assert "curve/pieces" not in left_out(fixture, "c.dxf")
    assert "curve/pieces" in left_out(fixture, "c.csv")
    with pytest.raises(InputError, match="no lines and arcs"):
        export(bundles.whole(), tmp_path / "c.dxf")
    assert not (tmp_path / "c.dxf").exists()
