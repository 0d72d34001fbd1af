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

from vfplan.errors import MarkerError
from vfplan.io.table import parse_number, split_rows
from vfplan.markers.correspondences import MarkerPoints, label_of

SCHEMA = re.compile(r".*markups-schema-v1\.[0-9]+\.[0-9]+\.json#*$", re.IGNORECASE)
# Metres in one unit, by the code that a file may hold (plain, or as a UCUM code).
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9}
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
    found = [
        (label_of(point.get("label"), f"control point {point.get('id')!r}", where), position)
        for markup in _fiducials(markups_of(text, where), where)
        for point, position in _defined(markup, where)
    ]
    return _points(found, where)


def _points(found: list[tuple[str, np.ndarray]], where: str) -> MarkerPoints:
    positions = np.array([position for _, position in found]).reshape(-1, 3)
    return MarkerPoints("patient_lps", tuple(label for label, _ in found), positions, where=where)


def markups_of(text: str, where: str) -> list[dict[str, Any]]:
    """The markups of a Slicer `.mrk.json`, of whatever type; raises `MarkerError` if it is none."""
    document = _json(text, where)
    schema = document.get("@schema")
    if not isinstance(schema, str) or not SCHEMA.match(schema):
        raise MarkerError(
            f"@schema is {schema!r}; Slicer's markups schema v1 is wanted", where=where
        )
    return _list(document, "markups", where)


def lps_points(markup: dict[str, Any], where: str) -> np.ndarray:
    """(P, 3) defined control points of one markup, in LPS [m]; labels do not matter."""
    return np.array([position for _, position in _defined(markup, where)]).reshape(-1, 3)


def _defined(markup: dict[str, Any], where: str) -> Iterator[tuple[dict[str, Any], np.ndarray]]:
    """The defined control points, and their positions in LPS [m]."""
    scale = _metres(markup.get("coordinateUnits", "mm"), where) * _lps(markup, where)
    for point in _list(markup, "controlPoints", where):
        if point.get("positionStatus", "defined") == "defined":
            name = str(point.get("label") or point.get("id"))
            yield point, _position(point.get("position"), name, where) * scale


def _fiducials(markups: list[dict[str, Any]], where: str) -> list[dict[str, Any]]:
    fiducials = [markup for markup in markups if markup.get("type") == "Fiducial"]
    if not fiducials:
        types = ", ".join(repr(markup.get("type")) for markup in markups) or "nothing"
        raise MarkerError(f"holds {types}; markers are a markup of type Fiducial", where=where)
    return fiducials


def _json(text: str, where: str) -> dict[str, Any]:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MarkerError(f"is not JSON: {error}", where=where) from None
    if not isinstance(document, dict):
        raise MarkerError(f"holds a {type(document).__name__}; an object is wanted", where=where)
    return document


def _list(holder: dict[str, Any], key: str, where: str) -> list[dict[str, Any]]:
    entries = holder.get(key)
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise MarkerError(f"{key!r} is not a list of objects", where=where)
    return entries


def _metres(units: Any, where: str) -> float:
    code = units[0] if isinstance(units, list) and units else units
    coded = isinstance(units, str) or (
        isinstance(units, list) and len(units) == 3 and units[1] == "UCUM"
    )
    if not coded or not isinstance(code, str) or code not in METRES:
        allowed = ", ".join(METRES)
        raise MarkerError(f"coordinateUnits is {units!r}; allowed: {allowed}", where=where)
    return METRES[code]


def _lps(markup: dict[str, Any], where: str) -> np.ndarray:
    system = markup.get("coordinateSystem", "LPS")
    if system == "LPS":
        return np.ones(3)
    if system == "RAS":
        return RAS_TO_LPS
    raise MarkerError(f"coordinateSystem is {system!r}; LPS or RAS is wanted", where=where)


def _position(value: Any, label: str, where: str) -> np.ndarray:
    if not isinstance(value, list) or len(value) != 3:
        raise MarkerError(
            f"position of marker {label!r} is {value!r}; three numbers are wanted", where=where
        )
    what = f"position of marker {label!r}"
    return np.array([parse_number(x, what, where, MarkerError) for x in value])


def parse_fcsv(text: str, where: str) -> MarkerPoints:
    """The points of a Slicer `.fcsv` as markers, each with its label; raises as `fcsv_points`."""
    points = enumerate(fcsv_points(text, where), start=1)
    return _points([(label_of(k, "it", f"{where}, point {i}"), p) for i, (k, p) in points], where)


def fcsv_points(text: str, where: str) -> list[tuple[str | None, np.ndarray]]:
    """Label and (3,) position in LPS [m] of each point of a Slicer `.fcsv`, in the file's order.

    Positions are in mm, in the coordinate system that the header names. With a `# Markups fiducial
    file version` line the columns are Slicer 4's, at fixed places; without one they are Slicer 3's
    `label,x,y,z,sel,vis` in RAS.

    Raises MarkerError: an unknown coordinate system, other columns, a position that is not three
        finite numbers
    """
    lines = [line.strip() for line in text.splitlines()]
    header = {
        key.strip().lower(): value.strip()
        for key, _, value in (line[1:].partition("=") for line in lines if line.startswith("#"))
    }
    slicer4 = "markups fiducial file version" in header
    columns = FCSV_COLUMNS if slicer4 else SLICER3_COLUMNS
    _check_columns(header.get("columns"), columns, where)
    sign = _fcsv_sign(header, slicer4, where)
    text = "\n".join(line for line in lines if not line.startswith("#"))
    rows = [row for _, row in split_rows(text, where, MarkerError)]
    points = []
    for i, row in enumerate(rows, start=1):
        place = f"{where}, point {i}"
        cells = dict(zip(columns, row, strict=False))
        label = cells.get("label")
        what = f"of marker {label.strip()!r}" if label else "of it"
        xyz = [
            parse_number(cells.get(axis), f"{axis} {what}", place, MarkerError) for axis in "xyz"
        ]
        points.append((label, np.array(xyz) * sign * 1e-3))
    return points


def _check_columns(stated: str | None, columns: list[str], where: str) -> None:
    if stated is None:
        return
    found = [name.strip() for name in stated.split(",")]
    if found[: len(columns)] != columns:
        allowed = ",".join(columns)
        raise MarkerError(f"columns are {stated!r}; {allowed!r} is wanted", where=where)


def _fcsv_sign(header: dict[str, str], slicer4: bool, where: str) -> np.ndarray:
    system = header.get("coordinatesystem")
    if system is None and not slicer4:
        return RAS_TO_LPS
    if system in ("LPS", "1"):
        return np.ones(3)
    if system in ("RAS", "0"):
        return RAS_TO_LPS
    raise MarkerError(
        f"CoordinateSystem is {system!r}; RAS, LPS, 0 (RAS) or 1 (LPS) is wanted", where=where
    )
