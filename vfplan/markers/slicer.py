"""3D Slicer's point files: `.mrk.json` and `.fcsv`, into LPS metres.

Sources: Slicer's markups JSON schema v1 and its "Markups fiducial file" text format. Slicer keeps
RAS in memory and states in each file which of RAS and LPS the file holds; the two differ in the
signs of x and y.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MarkerError
from vfplan.io.table import parse_number, split_rows
from vfplan.markers.correspondences import MarkerPoints, label_of

SCHEMA = re.compile(r".*markups-schema-v1\.[0-9]+\.[0-9]+\.json#*$", re.IGNORECASE)
RAS_TO_LPS = np.array([-1.0, -1.0, 1.0])
FCSV_COLUMNS = [
    *("id", "x", "y", "z", "ow", "ox", "oy", "oz", "vis", "sel", "lock"),
    *("label", "desc", "associatedNodeID"),
]
SLICER3_COLUMNS = ["label", "x", "y", "z", "sel", "vis"]


def parse_mrk_json(text: str, where: str) -> MarkerPoints:
    """The defined control points of every Fiducial markup in a Slicer `.mrk.json`.

    Positions in `coordinateSystem` (LPS unless stated) and `coordinateUnits` (mm unless stated);
    points whose `positionStatus` is not "defined" (undefined, preview, missing) are no markers.

    Raises MarkerError: not JSON, another schema, an unknown unit or coordinate system, a position
        that is not three finite numbers
    """
    labels, positions, types = [], [], []
    for markup in markups_of(text, where):
        types.append(repr(markup.get("type")))
        if markup.get("type") != "Fiducial":
            continue
        for point, position in defined_points(markup, where):
            name = f"control point {point.get('id')!r}"
            labels.append(label_of(point.get("label"), name, where))
            positions.append(position)
    if "'Fiducial'" not in types:
        raise MarkerError(
            f"holds {', '.join(types) or 'nothing'}. Give a markup of type Fiducial",
            where=where,
            code="no-fiducials",
        )
    array = np.array(positions).reshape(-1, 3)
    return MarkerPoints("patient_lps", tuple(labels), array, where=where)


def markups_of(text: str, where: str) -> list[dict[str, Any]]:
    """The markups of a Slicer `.mrk.json`, of whatever type; raises `MarkerError` if it is none."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MarkerError(
            f"is not JSON ({error}). Save it again in Slicer", where=where, code="not-json"
        ) from None
    if not isinstance(document, dict):
        raise MarkerError(
            f"holds a {type(document).__name__} and no markups. Save it again in Slicer",
            where=where,
            code="no-markups",
        )
    schema = document.get("@schema")
    if not isinstance(schema, str) or not SCHEMA.match(schema):
        raise MarkerError(
            f"@schema is {schema!r}. Give a file of Slicer's markups schema v1",
            where=where,
            code="schema-unknown",
        )
    return _objects(document, "markups", where)


def lps_points(markup: dict[str, Any], where: str) -> NDArray[np.float64]:
    """(P, 3) defined control points of one markup, in LPS [m]; labels do not matter."""
    positions = [position for _, position in defined_points(markup, where)]
    return np.array(positions).reshape(-1, 3)


def defined_points(
    markup: dict[str, Any], where: str
) -> Iterator[tuple[dict[str, Any], NDArray[np.float64]]]:
    """The defined control points, and their positions in LPS [m]."""
    # A unit stands as its code, or as a list of the code, "UCUM" and its name.
    metres = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9}
    unit = markup.get("coordinateUnits", "mm")
    if isinstance(unit, list) and len(unit) == 3 and unit[1] == "UCUM":
        unit = unit[0]
    if not isinstance(unit, str) or unit not in metres:
        raise MarkerError(
            f"coordinateUnits is {unit!r}. It may be {', '.join(metres)}",
            where=where,
            code="unit-unknown",
        )
    system = markup.get("coordinateSystem", "LPS")
    if system not in ("LPS", "RAS"):
        raise MarkerError(
            f"coordinateSystem is {system!r}. It may be LPS or RAS",
            where=where,
            code="coordinate-system-unknown",
        )
    scale = np.full(3, metres[unit])
    if system == "RAS":
        scale = scale * RAS_TO_LPS
    for point in _objects(markup, "controlPoints", where):
        if point.get("positionStatus", "defined") != "defined":
            continue
        what = f"position of marker {str(point.get('label') or point.get('id'))!r}"
        position = point.get("position")
        if not isinstance(position, list) or len(position) != 3:
            raise MarkerError(
                f"{what} is {position!r}. Give three numbers",
                where=where,
                code="no-position",
            )
        xyz = [parse_number(value, what, where, MarkerError) for value in position]
        yield point, np.array(xyz) * scale


def _objects(parent: dict[str, Any], key: str, where: str) -> list[dict[str, Any]]:
    """The list of objects under a key."""
    entries = parent.get(key)
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise MarkerError(
            f"{key!r} is not a list of objects. Save the file again in Slicer",
            where=where,
            code="no-markups",
        )
    return entries


def parse_fcsv(text: str, where: str) -> MarkerPoints:
    """The points of a Slicer `.fcsv` as markers, each with its label; raises as `fcsv_points`."""
    labels, positions = [], []
    for number, (label, position) in enumerate(fcsv_points(text, where), start=1):
        labels.append(label_of(label, "it", f"{where}, point {number}"))
        positions.append(position)
    array = np.array(positions).reshape(-1, 3)
    return MarkerPoints("patient_lps", tuple(labels), array, where=where)


def fcsv_points(text: str, where: str) -> list[tuple[str | None, NDArray[np.float64]]]:
    """Label and (3,) position in LPS [m] of each point of a Slicer `.fcsv`, in the file's order.

    Positions are in mm, in the coordinate system that the header names. With a `# Markups fiducial
    file version` line the columns are Slicer 4's, at fixed places; without one they are Slicer 3's
    `label,x,y,z,sel,vis` in RAS.

    Raises MarkerError: an unknown coordinate system, other columns, a position that is not three
        finite numbers
    """
    header: dict[str, str] = {}
    lines = []
    for line in text.splitlines():
        stripped = line.strip()
        if stripped.startswith("#"):
            key, _, value = stripped[1:].partition("=")
            header[key.strip().lower()] = value.strip()
        else:
            lines.append(stripped)

    columns, system = SLICER3_COLUMNS, header.get("coordinatesystem", "RAS")
    if "markups fiducial file version" in header:
        columns, system = FCSV_COLUMNS, header.get("coordinatesystem")
    stated = header.get("columns")
    if stated is not None:
        names = [name.strip() for name in stated.split(",")]
        if names[: len(columns)] != columns:
            raise MarkerError(
                f"columns are {stated!r}. They may be {','.join(columns)!r}",
                where=where,
                code="column-unknown",
            )
    if system in ("LPS", "1"):
        sign = np.ones(3)
    elif system in ("RAS", "0"):
        sign = RAS_TO_LPS
    else:
        raise MarkerError(
            f"CoordinateSystem is {system!r}. It may be RAS, LPS, 0 (RAS) or 1 (LPS)",
            where=where,
            code="coordinate-system-unknown",
        )

    points = []
    rows = split_rows("\n".join(lines), where, MarkerError)
    for number, (_, row) in enumerate(rows, start=1):
        cells = dict(zip(columns, row, strict=False))
        label = cells.get("label")
        what = f"of marker {label.strip()!r}" if label else "of it"
        position = np.empty(3)
        for k, axis in enumerate("xyz"):
            place = f"{where}, point {number}"
            position[k] = parse_number(cells.get(axis), f"{axis} {what}", place, MarkerError)
        points.append((label, position * sign * 1e-3))
    return points
