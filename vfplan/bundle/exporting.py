"""Points and curves for people's other tools: PLY, CSV, Slicer's .mrk.json, DXF and SVG."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.bundle.drawing import dxf, svg
from vfplan.errors import InputError
from vfplan.fixture import Fixture
from vfplan.io.disk import write_whole

MRK_SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/"
    "Schema/markups-schema-v1.0.3.json#"
)
SUFFIXES = (".ply", ".csv", ".mrk.json", ".dxf", ".svg")


def export(fixture: Fixture, path: str | Path, *, overwrite: bool = False) -> None:
    """Write points as .ply or .csv, strokes as .mrk.json, lines and arcs as .dxf or .svg.

    PLY and CSV keep the bundle's unit (m; px in the frame image). Slicer knows millimetres and
    patient axes only: points of the frame robot_base are written as they are, in mm, labelled LPS.

    Raises
    ------
    InputError
        Another ending, pixels or a cloud without strokes as .mrk.json, or no lines and arcs.
    OutputError
        The path exists and `overwrite` is false, or cannot be written.
    """
    forms = {".ply": _ply, ".csv": _csv, ".mrk.json": _mrk, ".dxf": dxf, ".svg": svg}
    text = forms[_suffix(path)](fixture)
    write_whole(Path(path), [text], overwrite=overwrite)


# What of a fixture each form holds besides its points; a mesh's corners are points.
DRAWN = {".dxf": {"curve"}, ".svg": {"curve"}}
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
        raise InputError(f"ends in none of {', '.join(SUFFIXES)}", where=str(path))
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
        raise InputError("pixels cannot be written as .mrk.json, which holds mm: register first")
    if fixture.curve is None:
        raise InputError("a cloud without strokes cannot be written as .mrk.json; .ply can")
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
