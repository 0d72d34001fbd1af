"""Points and curves for people's other tools: PLY, CSV, Slicer's .mrk.json, DXF and SVG."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError
from vfplan.fixture import Fixture, Pieces
from vfplan.io.staging import write_whole

MRK_SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/"
    "Schema/markups-schema-v1.0.3.json#"
)
SUFFIXES = (".ply", ".csv", ".mrk.json", ".dxf")


def export(fixture: Fixture, path: str | Path, *, overwrite: bool = False) -> None:
    """Write points as .ply or .csv, strokes as .mrk.json, lines and arcs as .dxf.

    PLY and CSV keep the bundle's unit (m; px in the frame image). Slicer knows millimetres and
    patient axes only: points of the frame robot_base are written as they are, in mm, labelled LPS.

    Raises
    ------
    InputError
        Another ending, pixels or a cloud without strokes as .mrk.json, or no lines and arcs.
    OutputError
        The path exists and `overwrite` is false, or cannot be written.
    """
    forms = {".ply": _ply, ".csv": _csv, ".mrk.json": _mrk, ".dxf": dxf}
    text = forms[_suffix(path)](fixture)
    write_whole(Path(path), [text], overwrite=overwrite)


# What of a fixture each form holds besides its points; a mesh's corners are points.
DRAWN = {".dxf": {"curve"}}
HELD = {".ply": {"mesh"}, ".csv": {"sigma", "curve"}, ".mrk.json": {"curve"}} | DRAWN
PARTS = ("sigma", "curve", "mesh", "image", "rendering", "registration", "stability")


def left_out(fixture: Fixture, path: str | Path) -> list[str]:
    """The parts of a fixture that a file of this name does not hold; provenance goes with none."""
    held = HELD[_suffix(path)]
    there = [part for part in PARTS if getattr(fixture, part) is not None and part not in held]
    curve = fixture.curve
    if curve is not None and "curve" in held:
        closed = _suffix(path) == ".csv" and bool(np.any(curve.closed))
        there += ["curve/closed"] * closed + ["curve/bridged"] * (curve.bridged is not None)
        drawn = _suffix(path) in DRAWN
        there += ["points"] * drawn + ["curve/pieces"] * (curve.pieces is not None and not drawn)
    return there


def _suffix(path: str | Path) -> str:
    name = Path(path).name.lower()
    suffix = next((s for s in SUFFIXES if name.endswith(s)), None)
    if suffix is None:
        raise InputError(f"ends in none of {', '.join(SUFFIXES)}.", where=str(path))
    return suffix


def _ply(fixture: Fixture) -> bytes:
    unit = "px" if fixture.frame == "image" else "m"
    head = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment frame {fixture.frame}, unit {unit}",
        f"element vertex {len(fixture.points)}",
        *(f"property double {axis}" for axis in "xyz"),
    ]
    if fixture.mesh is not None:
        head += [f"element face {len(fixture.mesh)}", "property list uchar int vertex_indices"]
    body = np.ascontiguousarray(fixture.points, dtype="<f8").tobytes()
    if fixture.mesh is not None:
        faces = np.empty(len(fixture.mesh), dtype=[("n", "u1"), ("v", "<i4", 3)])
        faces["n"], faces["v"] = 3, fixture.mesh
        body += faces.tobytes()
    return "\n".join([*head, "end_header", ""]).encode() + body


def _csv(fixture: Fixture) -> bytes:
    unit = "px" if fixture.frame == "image" else "m"
    columns: dict[str, Any] = {f"{a}_{unit}": fixture.points[:, i] for i, a in enumerate("xyz")}
    if fixture.sigma is not None:
        columns[f"sigma_{unit}"] = fixture.sigma
    if fixture.curve is not None:
        columns["stroke"] = fixture.curve.stroke
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
    return ("\n".join(lines) + "\n").encode()


def _mrk(fixture: Fixture) -> bytes:
    if fixture.frame == "image":
        raise InputError("pixels cannot be written as .mrk.json, which holds mm: register first.")
    if fixture.curve is None:
        raise InputError("a cloud without strokes cannot be written as .mrk.json; .ply can.")
    markups = [
        _markup(fixture.points[fixture.curve.stroke == number] * 1000, number, bool(closed))
        for number, closed in enumerate(fixture.curve.closed)
    ]
    for markup in markups:
        markup["description"] = f"frame {fixture.frame}"
    return (json.dumps({"@schema": MRK_SCHEMA, "markups": markups}, indent=1) + "\n").encode()


def _markup(points_mm: np.ndarray, number: int, closed: bool) -> dict[str, Any]:
    return {
        "type": "ClosedCurve" if closed else "Curve",
        "coordinateSystem": "LPS",
        "coordinateUnits": "mm",
        "controlPoints": [
            {
                "id": str(i + 1),
                "label": f"stroke{number}-{i + 1}",
                "position": point,
                "positionStatus": "defined",
            }
            for i, point in enumerate(points_mm.tolist())
        ],
    }


Vector = NDArray[np.float64]


def dxf(fixture: Fixture) -> bytes:
    """An R12 drawing: one polyline a stroke, in space, extruded along the ignored axis."""
    pieces, axis = _pieces(fixture)
    frame = _arbitrary_axes(axis)
    rows: list[tuple[int, object]] = [(0, "SECTION"), (2, "HEADER"), (9, "$ACADVER")]
    rows += [(1, "AC1009"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES")]
    for points, bulges, closed in _strokes(pieces):
        x, y, z = 1e3 * frame @ points.T
        rows += [(0, "POLYLINE"), (8, "0"), (66, 1), (70, int(closed)), (10, 0.0), (20, 0.0)]
        rows += [(30, z.mean()), *zip((210, 220, 230), axis, strict=True)]
        for vertex in zip(x, y, np.full(len(z), z.mean()), bulges, strict=True):
            rows += [(0, "VERTEX"), (8, "0"), *zip((10, 20, 30, 42), vertex, strict=True)]
        rows.append((0, "SEQEND"))
    rows += [(0, "ENDSEC"), (0, "EOF")]
    return "".join(f"{code:3}\n{_text(value)}\n" for code, value in rows).encode()


def _pieces(fixture: Fixture) -> tuple[Pieces, Vector]:
    if fixture.pieces is None or fixture.rendering is None or fixture.ignore_axis is None:
        raise InputError(
            "a fixture without lines and arcs has no .dxf. Its points have the other forms."
        )
    return fixture.pieces, fixture.ignore_axis


def _strokes(pieces: Pieces) -> Iterator[tuple[Vector, Vector, bool]]:
    for number, closed in enumerate(pieces.closed):
        own = pieces.stroke == number
        yield pieces.vertices[own], pieces.bulges[own], bool(closed)


def _arbitrary_axes(axis: Vector) -> Vector:
    """(3, 3) rows x, y and z of the coordinates that DXF gives to what is extruded along z."""
    steep = max(abs(axis[0]), abs(axis[1])) < 1 / 64
    x = np.cross([0.0, 1.0, 0.0] if steep else [0.0, 0.0, 1.0], axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis])


def _text(value: object) -> str:
    return repr(float(value)) if isinstance(value, float) else str(value)
