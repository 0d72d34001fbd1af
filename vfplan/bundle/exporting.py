"""Points and curves for people's other tools: PLY, STL, CSV, Slicer's .mrk.json and DXF."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np

from vfplan.bundle import dicom
from vfplan.bundle.content import UNITS_OF_FRAME
from vfplan.bundle.dicom import in_patient
from vfplan.bundle.importing import STL_FACET
from vfplan.errors import InputError, SettingError
from vfplan.fixture import Fixture
from vfplan.io.files import FilePath
from vfplan.io.writing import write_whole

MRK_SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/"
    "Schema/markups-schema-v1.0.3.json#"
)


def export(
    fixture: Fixture, path: FilePath, *, overwrite: bool = False, study: FilePath | None = None
) -> None:
    """Write points as .ply or .csv, a mesh as .stl, strokes as .mrk.json, lines and arcs as .dxf.

    For a PACS, strokes as .rtstruct.dcm and the inside of a closed mesh as .seg.dcm, in the patient
    and study of `study`, a DICOM slice.

    PLY and CSV keep the bundle's unit (m; px in the frame image). STL and .mrk.json are in mm, in
    the patient's axes where the registration tells them. Slicer knows no others: points of the
    frame robot_base are then written as they are, and .mrk.json calls them LPS all the same.

    Raises
    ------
    InputError
        Another ending, pixels or a cloud without strokes as .mrk.json, no mesh, or no lines and
        arcs.
    OutputError
        The path exists and `overwrite` is false, or cannot be written.
    """
    suffix = suffix_of(path)
    make, _ = FORMS[suffix]
    is_dicom = suffix.endswith(".dcm")
    if study is not None and not is_dicom:
        raise SettingError("Only .dcm is of a study. Leave --study out.", code="study-unused")
    data = make(fixture, study) if is_dicom else make(fixture)
    write_whole(Path(path), [data], overwrite=overwrite)


PARTS = ("sigma", "curve", "mesh", "image", "rendering", "registration", "stability")


def left_out(fixture: Fixture, path: FilePath) -> list[str]:
    """The parts of a fixture that a file of this name does not hold; provenance is in none."""
    suffix = suffix_of(path)
    _, held = FORMS[suffix]
    parts = [p for p in PARTS if getattr(fixture, p) is not None and p not in held]
    curve = fixture.curve
    if curve is None or "curve" not in held:
        return parts
    if suffix == ".csv" and np.any(curve.closed):
        parts.append("curve/closed")
    if curve.bridged is not None:
        parts.append("curve/bridged")
    if suffix == ".dxf":
        # It holds the lines and arcs in place of the points.
        parts.append("points")
    elif curve.pieces is not None:
        parts.append("curve/pieces")
    return parts


def suffix_of(path: FilePath) -> str:
    """The ending of a name, which says what form the file has."""
    for suffix in FORMS:
        if Path(path).name.lower().endswith(suffix):
            return suffix
    raise InputError(
        f"The name ends in none of {', '.join(FORMS)}. Choose one of these endings.",
        where=path,
    )


def ply(fixture: Fixture) -> bytes:
    """The points, and the triangles of a mesh, as binary PLY."""
    head = ["ply", "format binary_little_endian 1.0"]
    space = " SPACE=LPS" if fixture.frame == "patient_lps" else ""
    head.append(f"comment frame {fixture.frame}, unit {UNITS_OF_FRAME[fixture.frame]}{space}")
    head.append(f"element vertex {len(fixture.points)}")
    head += [f"property double {axis}" for axis in "xyz"]
    body = np.ascontiguousarray(fixture.points, dtype="<f8").tobytes()
    if fixture.mesh is not None:
        head += [f"element face {len(fixture.mesh)}", "property list uchar int vertex_indices"]
        faces = np.empty(len(fixture.mesh), dtype=[("n", "u1"), ("v", "<i4", 3)])
        faces["n"] = 3
        faces["v"] = fixture.mesh
        body += faces.tobytes()
    return "\n".join([*head, "end_header", ""]).encode() + body


def stl(fixture: Fixture) -> bytes:
    """The triangles as binary STL, whose header names the patient's axes as 3D Slicer does."""
    if fixture.mesh is None:
        raise InputError("It has no triangles, which an .stl would hold. Write it as .ply.")
    points, frame = in_patient(fixture, fixture.points)
    facets = np.zeros(len(fixture.mesh), STL_FACET)
    facets["corners"] = 1000 * points[fixture.mesh]
    head = f"vfplan, mm, frame {frame}{' SPACE=LPS' if frame == 'patient_lps' else ''}"
    return head.encode().ljust(80) + struct.pack("<I", len(facets)) + facets.tobytes()


def csv(fixture: Fixture) -> bytes:
    """The points, their deviations and strokes as a table with a header."""
    unit = UNITS_OF_FRAME[fixture.frame]
    names = [f"{axis}_{unit}" for axis in "xyz"]
    columns = fixture.points.T.tolist()
    if fixture.sigma is not None:
        names.append(f"sigma_{unit}")
        columns.append(fixture.sigma.tolist())
    if fixture.curve is not None:
        names.append("stroke")
        columns.append(fixture.curve.stroke.tolist())
    rows = [",".join(map(repr, row)) for row in zip(*columns, strict=True)]
    return ("\n".join([",".join(names), *rows]) + "\n").encode()


def slicer_markups(fixture: Fixture) -> bytes:
    """The strokes as curves of 3D Slicer."""
    if fixture.frame == "image":
        raise InputError(
            "Pixels cannot be written as .mrk.json, which holds millimetres. Register first."
        )
    if fixture.curve is None:
        raise InputError(
            "A cloud without strokes cannot be written as .mrk.json. Write it as .ply."
        )
    markups = []
    for number, stroke in enumerate(fixture.strokes):
        points, frame = in_patient(fixture, stroke.points)
        control_points = [
            {"id": str(i), "label": f"stroke{number}-{i}", "position": point,
             "positionStatus": "defined"}
            for i, point in enumerate((1000 * points).tolist(), start=1)
        ]  # fmt: skip
        markups.append({
            "type": "ClosedCurve" if stroke.closed else "Curve",
            "coordinateSystem": "LPS", "coordinateUnits": "mm",
            "controlPoints": control_points, "description": f"frame {frame}",
        })  # fmt: skip
    return (json.dumps({"@schema": MRK_SCHEMA, "markups": markups}, indent=1) + "\n").encode()


def dxf(fixture: Fixture) -> bytes:
    """An R12 drawing: one polyline a stroke, in space, extruded along the ignored axis."""
    pieces = fixture.pieces
    axis = None if fixture.rendering is None else fixture.ignore_axis
    if pieces is None or axis is None:
        raise InputError(
            "It has no lines and arcs, which a .dxf would hold. Write its points as .ply or .csv."
        )
    # The axes that DXF gives to what is extruded; by its rule for those that are almost along z.
    is_upright = max(abs(axis[0]), abs(axis[1])) < 1 / 64
    x = np.cross([0.0, 1.0, 0.0] if is_upright else [0.0, 0.0, 1.0], axis)
    x /= np.linalg.norm(x)
    frame = np.stack([x, np.cross(axis, x), axis])
    rows = [(0, "SECTION"), (2, "HEADER"), (9, "$ACADVER")]
    rows += [(1, "AC1009"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES")]
    for number, is_closed in enumerate(pieces.closed):
        in_stroke = pieces.stroke == number
        x, y, z = 1e3 * frame @ pieces.vertices[in_stroke].T
        height = float(z.mean())
        rows += [(0, "POLYLINE"), (8, "0"), (66, 1), (70, int(is_closed)), (10, 0.0), (20, 0.0)]
        rows += [(30, height), *zip((210, 220, 230), axis.tolist(), strict=True)]
        for x_mm, y_mm, bulge in np.column_stack((x, y, pieces.bulges[in_stroke])).tolist():
            rows += [(0, "VERTEX"), (8, "0"), (10, x_mm), (20, y_mm), (30, height), (42, bulge)]
        rows.append((0, "SEQEND"))
    rows += [(0, "ENDSEC"), (0, "EOF")]
    return "".join(f"{code:3}\n{value}\n" for code, value in rows).encode()


# Ending -> what makes such a file, and the parts of a fixture that it holds besides the points.
FORMS = {
    ".rtstruct.dcm": (dicom.rtstruct, ("curve",)),
    ".seg.dcm": (dicom.segmentation, ("mesh",)),
    ".ply": (ply, ("mesh",)),
    ".stl": (stl, ("mesh",)),
    ".csv": (csv, ("sigma", "curve")),
    ".mrk.json": (slicer_markups, ("curve",)),
    ".dxf": (dxf, ("curve",)),
}
