"""Marker files -> the two sides of the markers, joined by label, never by order or by nearness.

Read are tables, and 3D Slicer's `.mrk.json` and `.fcsv` into LPS metres. Sources: Slicer's markups
JSON schema v1 and its "Markups fiducial file" text format. Slicer keeps RAS in memory and states in
each file which of RAS and LPS the file holds; the two differ in the signs of x and y.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal
from unicodedata import category

import numpy as np

from vfplan.display import MM
from vfplan.errors import MarkerError
from vfplan.findings import Findings, doubt, note
from vfplan.geometry import CORNER_PX, PixelSpacing
from vfplan.geometry.lines import Array, rms_length
from vfplan.io.files import (
    METRES,
    FilePath,
    Names,
    Table,
    naming_place,
    parse_number,
    parse_table,
    read_text,
    split_rows,
)

# Largest size of a marker file [bytes]. A file of a thousand markers has some hundred thousand.
MAX_BYTES = 16 * 2**20

ALLOWED = "label,u_px,v_px and/or label,x_m,y_m,z_m (or x_mm,y_mm,z_mm), with sigma_m"

PER_METRE = {"m": 1.0, "cm": 100.0, "mm": MM}

# A column of ImageJ's coordinates, with the unit that it is calibrated in. XM is a centre of mass.
IMAGEJ_COLUMN = re.compile(rf"(?ia)([XY])(?:[ _(\[]+({'|'.join(METRES)})[)\]]?)?")

# A column of one of these names that is not understood would be a unit or a frame ignored.
COORDINATE_NAMES = ("u", "v", "x", "y", "z", "sigma")

# RMS distance [m] of the markers of a small jig from their centre.
MIN_RADIUS_M = 0.01

# RMS distance [m] of markers as far apart as a scanner is wide. It is less than a thousand times
# that of a jig, so the same numbers cannot be both metres and millimetres.
MAX_RADIUS_M = 1.0

SCHEMA = re.compile(r"(?i).*markups-schema-v1\.[0-9]+\.[0-9]+\.json#*$")
RAS_TO_LPS = np.array([-1.0, -1.0, 1.0])
FCSV_COLUMNS = "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID"
SLICER3_COLUMNS = "label,x,y,z,sel,vis"

# Markups of 3D Slicer, or one list of points among them.
JsonObject = dict[str, Any]

MarkerFrame = Literal["image", "patient_lps", "robot_base"]


@dataclass(frozen=True, eq=False)
class MarkerPoints:
    """Labelled positions in one frame."""

    # "image" [px], "patient_lps" [m] or "robot_base" [m].
    frame: MarkerFrame
    # (N,) labels, each once.
    labels: Names
    # (N, 2) in "image", (N, 3) elsewhere.
    positions: Array
    # (N,) or (N, 3) standard deviations an axis [m]; `None` where the file names none.
    sigma: Array | None = None
    # The file, for messages.
    where: str | None = None
    # SHA-256 of the file's bytes, lower-case hex.
    sha256: str = ""
    # What was concluded and not read.
    findings: Findings = ()

    def __post_init__(self) -> None:
        """Every label once, and at least one of them."""
        if not self.labels:
            raise MarkerError("holds no marker. Add markers", where=self.where, code="no-markers")
        for label, count in Counter(self.labels).items():
            if count > 1:
                raise MarkerError(
                    f"label {label!r} occurs {count} times. Give each marker a label of its own",
                    where=self.where, code="label-doubled",
                    numbers={"label": label, "count": count},
                )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Correspondences:
    """The same markers in two frames."""

    # (N,) labels in the order of the source file.
    labels: Names
    # (N, 2) [px] in "image", or (N, 3) [m] in "patient_lps".
    source: Array
    source_frame: MarkerFrame
    # (N, 3) [m] in `target_frame`.
    target: Array
    # (N,) or (N, 3) standard deviation of the target an axis [m]; `None` where none was given.
    sigma: Array | None = None
    # "patient_lps" where the target side came from a Slicer file.
    target_frame: MarkerFrame = "robot_base"
    # SHA-256 of "markers" and "markers2".
    inputs: dict[str, str] = field(default_factory=dict)
    # Units that were concluded, and markers that only one side has.
    findings: Findings = ()
    # The tool that touched them, and (3,) its tip in its own frame [m].
    tool: str | None = None
    tip: Array | None = None


def read_markers(
    path: FilePath, path2: FilePath | None = None, *, common: bool = False,
    spacing_mm: PixelSpacing = None,
) -> Correspondences:  # fmt: skip
    """Read markers from one file that holds both sides, or from two files joined by label.

    One file: a table with `label,u_px,v_px,x_m,y_m,z_m`. Two files, each a table
    (`label,u_px,v_px`, ImageJ's `X,Y`, or `label,x_m,y_m,z_m`), a Slicer `.mrk.json` or a Slicer
    `.fcsv`. Pixels are always a source and a table of robot positions is always the target, in
    whichever order the files come. A Slicer file (patient LPS) takes the other side. Of two Slicer
    files the first is the source.

    Parameters
    ----------
    path, path2
        The files.
    common
        Use the markers that both sides have. Without it both sides must have the same.
    spacing_mm
        Size of a pixel of the slice along u and v, which a calibrated table of ImageJ needs.

    Raises
    ------
    MarkerError
        A file that cannot be read or may mean two things; a label that is doubled, or that only one
        side has; two files for the same side.
    """
    files = [Path(path)] if path2 is None else [Path(path), Path(path2)]
    sides = [side for file in files for side in read_sides(file, spacing_mm)]
    if len(sides) == 1:
        raise MarkerError(
            f"holds only {sides[0].frame} positions. Give a second file with the other side, or "
            "one table with label,u_px,v_px,x_m,y_m,z_m",
            where=path, code="one-side-only",
        )  # fmt: skip
    if len(sides) > 2:
        raise MarkerError(
            "one holds both sides already. Give it alone, or two files with one side each",
            where=", ".join(map(str, files)), code="both-sides",
        )  # fmt: skip
    first, second = sides
    if first.frame == second.frame != "patient_lps":
        raise MarkerError(
            f"both files hold {first.frame} positions ({first.where}). Give one of each side",
            where=second.where, code="same-side-twice",
        )  # fmt: skip
    roles = ("markers", "markers2")[: len(files)]
    inputs = {role: side.sha256 for role, side in zip(roles, sides, strict=False)}
    is_swapped = second.frame == "image" or first.frame == "robot_base"
    source, target = (second, first) if is_swapped else (first, second)
    return join(source, target, inputs, common)


def read_sides(path: Path, spacing_mm: PixelSpacing = None) -> list[MarkerPoints]:
    """The image side, the other side, or both, of one file; raises as `read_markers`."""
    suffix = path.suffix.lower()
    where = str(path)
    if suffix not in (".csv", ".txt", ".tsv", ".json", ".fcsv"):
        raise MarkerError(
            f"has suffix {path.suffix!r}. Save it as .csv, .mrk.json or .fcsv",
            where=where, code="suffix-unknown",
        )  # fmt: skip
    text, sha256 = read_text(path, MAX_BYTES, MarkerError)
    with naming_place(where):
        if suffix not in (".json", ".fcsv"):
            sides = parse_marker_table(text, where, spacing_mm)
            return [replace(side, sha256=sha256) for side in sides]
        points = fiducials(text) if suffix == ".json" else fcsv_points(text, where)
        labels = [label_of(label, f"point {k}") for k, (label, _) in enumerate(points, 1)]
        positions = np.array([place for _, place in points]).reshape(-1, 3)
        return [MarkerPoints("patient_lps", tuple(labels), positions, None, where, sha256)]


def join(
    source: MarkerPoints, target: MarkerPoints, inputs: dict[str, str], common: bool
) -> Correspondences:
    """The markers of two sides, joined by label.

    inputs: SHA-256 of the files, by role
    common: leave out what only one side has, with a note each
    Raises MarkerError: a label that only one side has, without `common`
    """
    labels = [label for label in source.labels if label in target.labels]
    rows = [source.labels.index(label) for label in labels]
    target_rows = [target.labels.index(label) for label in labels]
    if not labels:
        raise MarkerError(
            f"has no label that {source.where} has. Give the files of one case, with the same "
            "labels in both",
            where=target.where, code="labels-differ", numbers={"labels": list(source.labels)},
        )  # fmt: skip
    findings = source.findings + target.findings
    for side, other in ((source, target), (target, source)):
        lone = [label for label in side.labels if label not in other.labels]
        if not lone:
            continue
        names = ", ".join(lone)
        if not common:
            raise MarkerError(
                f"has no marker {names}, which {side.where} has. Add it here, delete {names} "
                "there, or use --common",
                where=other.where, code="labels-differ", numbers={"labels": lone},
            )  # fmt: skip
        text = (
            f"Left out: {names}, which only {Path(side.where or 'one side').name} has. Nothing is "
            "to be done if you mean it so."
        )
        findings += (note("markers-not-common", "register", text),)
    sigma = target.sigma[target_rows] if target.sigma is not None else None
    return Correspondences(
        tuple(labels), source.positions[rows], source.frame, target.positions[target_rows], sigma,
        target.frame, inputs, findings,
    )  # fmt: skip


def label_of(text: object, what: str) -> str:
    """A label without surrounding blanks, or a `MarkerError` where no bundle can hold it."""
    label = str(text).strip() if text is not None else ""
    if not label:
        raise MarkerError(f"{what} has no label. Give every marker one", code="label-missing")
    if any(category(sign) == "Cc" for sign in label):
        raise MarkerError(
            f"{what} has a control character in its label {label!r}. Delete it",
            code="label-control-character",
        )
    return label


def parse_marker_table(text: str, where: str, spacing_mm: PixelSpacing) -> list[MarkerPoints]:
    """The image side, the robot side, or both, of one table.

    Columns: `label` (or `name`), `u_px,v_px` [px], `x_m,y_m,z_m` [m] (or `_mm`, `_cm`), and on the
    robot side `sigma_m` (or `sigma`, one standard deviation an axis) or `sigma_x_m,sigma_y_m,
    sigma_z_m`. Plain `x,y,z` are metres or millimetres, by the size of the layout. Other columns
    are notes and are ignored, unless they look like a coordinate in another unit.

    Raises MarkerError: a missing or doubled column, a missing cell, a value that is not a finite
        number, a table that may mean two things
    """
    table = parse_table(text, where, MarkerError)
    place = f"{where}, line {table.header_line}"
    header = ",".join(table.header)

    # The columns by their plain names: "X [mm]" is "x_mm".
    columns = {
        re.sub(r"[\s_\[\]()]+", "_", name.casefold()).strip("_"): name for name in table.header
    }
    label_column = columns.get("label", columns.get("name"))
    image = choose_columns(columns, [("u_px", "v_px"), ("u", "v")], place)
    has_z = any(name.split("_")[0] == "z" for name in columns)
    imagej, unit = ((), None) if image or has_z else imagej_columns(table.header)
    if imagej:
        return [imagej_points(table, imagej, unit, label_column, spacing_mm)]
    if label_column is None:
        raise MarkerError(
            f"no column 'label' in {header!r}. The columns may be {ALLOWED}",
            where=place, code="column-missing",
        )  # fmt: skip
    robot_choices, sigma_choices = [("x", "y", "z")], [("sigma",)]
    for unit in PER_METRE:
        robot_choices.append((f"x_{unit}", f"y_{unit}", f"z_{unit}"))
        sigma_choices.append((f"sigma_{unit}",))
        sigma_choices.append((f"sigma_x_{unit}", f"sigma_y_{unit}", f"sigma_z_{unit}"))
    robot = choose_columns(columns, robot_choices, place)
    sigma = choose_columns(columns, sigma_choices, place)
    for plain_name, name in columns.items():
        is_known = plain_name in image + robot + sigma
        if not is_known and plain_name.split("_")[0] in COORDINATE_NAMES:
            raise MarkerError(
                f"column {name!r} is not understood. The columns may be {ALLOWED}",
                where=place, code="column-unknown", numbers={"column": name},
            )  # fmt: skip
    if not image and not robot:
        raise MarkerError(
            f"no coordinates in the columns {header!r}. The columns may be {ALLOWED}",
            where=place, code="column-missing",
        )  # fmt: skip
    if sigma and not robot:
        raise MarkerError(
            "a sigma [m] belongs to the robot's positions, which are not here. Move it to their "
            "table",
            where=place, code="sigma-without-positions",
        )  # fmt: skip

    table.check_decimals(tuple(columns[name] for name in image + robot + sigma))
    labels = [label_of(row.cells[label_column], f"line {row.line}") for row in table.rows]
    names = [f"marker {label!r}" for label in labels]
    sides = []
    if image:
        positions = table.numbers(tuple(columns[name] for name in image), names)
        sides.append(MarkerPoints("image", tuple(labels), positions, where=where))
    if robot:
        raw = table.numbers(tuple(columns[name] for name in robot), names)
        unit, findings = unit_of(robot, raw, place)
        spread = None
        if sigma:
            spread = table.numbers(tuple(columns[name] for name in sigma), names)
            for row, label, values in zip(table.rows, labels, spread, strict=True):
                if not (values > 0).all():
                    raise MarkerError(
                        f"sigma of marker {label!r} is {values.min():g}. Give a number above 0",
                        where=f"{where}, line {row.line}", code="sigma-range",
                        numbers={"label": label},
                    )  # fmt: skip
            sigma_unit = sigma[0].rsplit("_", 1)[-1] if sigma != ("sigma",) else unit
            spread = (spread if len(sigma) > 1 else spread[:, 0]) / PER_METRE[sigma_unit]
        positions = raw / PER_METRE[unit]
        sides.append(
            MarkerPoints("robot_base", tuple(labels), positions, spread, where, findings=findings)
        )
    return sides


def imagej_columns(names: Sequence[str]) -> tuple[Names, str | None]:
    """The names of ImageJ's columns X and Y, and their unit; () where one is not there."""
    matches = [match for name in names if (match := IMAGEJ_COLUMN.fullmatch(name))]
    matches.sort(key=lambda match: match[1].upper())
    if [match[1].upper() for match in matches] != ["X", "Y"] or matches[0][2] != matches[1][2]:
        return (), None
    return tuple(match[0] for match in matches), matches[0][2]


def imagej_points(
    table: Table, columns: Names, unit: str | None, label_column: str | None,
    spacing_mm: PixelSpacing,
) -> MarkerPoints:  # fmt: skip
    """The points of a table of ImageJ, on the image [px].

    A point counts from the centre of a pixel, the centroid of an area from its corner. Points have
    numbers, and ImageJ's own label names the picture, the same in each row.

    Raises MarkerError: a calibrated table, and nobody knows how large a pixel is
    """
    pixel, findings = np.ones(2), ()
    if unit is None:
        text = (
            "X and Y name no unit and were taken as pixels. If ImageJ had a scale, write its unit "
            "into the header: X (mm),Y (mm)."
        )
        findings = (doubt("imagej-table", "register", text),)
    elif spacing_mm is None:
        raise MarkerError(
            f"is in {unit}, and no image says how large a pixel is. Give --pixel-spacing, or save "
            "the table in pixels",
            code="markers-without-spacing",
        )
    else:
        pixel = np.array(spacing_mm) / (MM * METRES[unit.lower()])
    labels = []
    if label_column is not None:
        labels = [label_of(row.cells[label_column], f"line {row.line}") for row in table.rows]
    if not labels or ("" in table.header and len({*labels}) < len(labels)):
        labels = [str(number) for number in range(1, len(table.rows) + 1)]
        text = "The table names no point, so they were numbered in its order."
        findings += (note("points-numbered", "register", text),)
    positions = table.numbers(columns) / pixel
    if "Area" in table.header and (table.numbers(("Area",)) > pixel.prod()).all():
        positions -= CORNER_PX
    return MarkerPoints("image", tuple(labels), positions, where=table.where, findings=findings)


def choose_columns(columns: dict[str, str], choices: list[Names], place: str) -> Names:
    """The one choice of column names that the table has; () where it has none of any."""
    present = [names for names in choices if not columns.keys().isdisjoint(names)]
    if not present:
        return ()
    names = present[0]
    if len(present) > 1:
        both = f"{','.join(names)} and {','.join(present[1])}"
        raise MarkerError(
            f"{both} are in one table. Give one of them", where=place, code="columns-ambiguous"
        )
    for name in names:
        if name not in columns:
            raise MarkerError(
                f"column {name!r} is missing beside {','.join(columns)!r}. Add it",
                where=place, code="column-missing", numbers={"column": name},
            )  # fmt: skip
    return names


def unit_of(names: Names, raw: Array, place: str) -> tuple[str, Findings]:
    """The unit of a table's positions: as its header says, or by the layout's size.

    Raises MarkerError: a header without a unit, and a layout that fits metres as little as
        millimetres
    """
    if "_" in names[0]:
        return names[0].rsplit("_", 1)[-1], ()
    radius = rms_length(raw - raw.mean(axis=0))
    for unit in ("m", "mm"):
        if MIN_RADIUS_M <= radius / PER_METRE[unit] <= MAX_RADIUS_M:
            text = (
                f"Columns X, Y, Z name no unit: taken as {unit}, by the size of the layout. "
                "Write x_m or x_mm to be sure."
            )
            return unit, (note("unit-concluded", "register", text),)
    raise MarkerError(
        f"columns x,y,z name no unit, and a layout of {radius:.3g} (rms from its centre) fits "
        "neither metres nor millimetres. Write x_m,y_m,z_m or x_mm,y_mm,z_mm",
        where=place, code="unit-unclear", numbers={"radius": radius},
    )  # fmt: skip


def fiducials(text: str) -> list[tuple[str | None, Array]]:
    """Label and (3,) position in LPS [m] of each defined point of a `.mrk.json`'s Fiducials.

    Positions in `coordinateSystem` (LPS unless stated) and `coordinateUnits` (mm unless stated);
    points whose `positionStatus` is not "defined" (undefined, preview, missing) are no markers.

    Raises MarkerError: not JSON, another schema, an unknown unit or coordinate system, a position
        that is not three finite numbers
    """
    markups = markups_of(text)
    lists = [markup for markup in markups if markup.get("type") == "Fiducial"]
    if not lists:
        types = ", ".join(repr(markup.get("type")) for markup in markups)
        raise MarkerError(
            f"holds {types or 'nothing'}. Give a markup of type Fiducial", code="no-fiducials"
        )
    return [(point.get("label"), place) for one in lists for point, place in defined_points(one)]


def markups_of(text: str) -> list[JsonObject]:
    """The markups of a Slicer `.mrk.json`, of whatever type; raises `MarkerError` if it is none."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MarkerError(
            f"is not JSON ({error}). Save it again in Slicer", code="not-json"
        ) from None
    if not isinstance(document, dict):
        raise MarkerError(
            f"holds a {type(document).__name__} and no markups. Save it again in Slicer",
            code="no-markups",
        )
    schema = document.get("@schema")
    if not isinstance(schema, str) or not SCHEMA.match(schema):
        raise MarkerError(
            f"@schema is {schema!r}. Give a file of Slicer's markups schema v1",
            code="schema-unknown",
        )
    return _objects(document, "markups")


def lps_points(markup: JsonObject) -> Array:
    """(P, 3) defined control points of one markup, in LPS [m]; labels do not matter."""
    return np.array([position for _, position in defined_points(markup)]).reshape(-1, 3)


def defined_points(markup: JsonObject) -> Iterator[tuple[JsonObject, Array]]:
    """The defined control points, and their positions in LPS [m]."""
    # A unit stands as its code, or as a list of the code, "UCUM" and its name.
    metres = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9}
    unit = markup.get("coordinateUnits", "mm")
    if isinstance(unit, list) and len(unit) == 3 and unit[1] == "UCUM":
        unit = unit[0]
    if not isinstance(unit, str) or unit not in metres:
        raise MarkerError(
            f"coordinateUnits is {unit!r}. It may be {', '.join(metres)}", code="unit-unknown"
        )
    system = markup.get("coordinateSystem", "LPS")
    if system not in ("LPS", "RAS"):
        raise MarkerError(
            f"coordinateSystem is {system!r}. It may be LPS or RAS",
            code="coordinate-system-unknown",
        )
    scale = metres[unit] * (RAS_TO_LPS if system == "RAS" else np.ones(3))
    for point in _objects(markup, "controlPoints"):
        if point.get("positionStatus", "defined") != "defined":
            continue
        what = f"position of marker {str(point.get('label') or point.get('id'))!r}"
        position = point.get("position")
        if not isinstance(position, list) or len(position) != 3:
            raise MarkerError(f"{what} is {position!r}. Give three numbers", code="no-position")
        xyz = [parse_number(value, what, None, MarkerError) for value in position]
        yield point, np.array(xyz) * scale


def _objects(parent: JsonObject, key: str) -> list[JsonObject]:
    """The list of objects under a key."""
    entries = parent.get(key)
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise MarkerError(
            f"{key!r} is not a list of objects. Save the file again in Slicer", code="no-markups"
        )
    return entries


def fcsv_points(text: str, where: str) -> list[tuple[str | None, Array]]:
    """Label and (3,) position in LPS [m] of each point of a Slicer `.fcsv`, in the file's order.

    Positions are in mm, in the coordinate system that the header names. With a `# Markups fiducial
    file version` line the columns are Slicer 4's, at fixed places; without one they are Slicer 3's
    `label,x,y,z,sel,vis` in RAS.

    Raises MarkerError: an unknown coordinate system, other columns, a position that is not three
        finite numbers
    """
    header = {}
    lines = []
    for line in text.splitlines():
        stripped = line.strip()
        if stripped.startswith("#"):
            key, _, value = stripped[1:].partition("=")
            header[key.strip().lower()] = value.strip()
        else:
            lines.append(stripped)

    is_slicer4 = "markups fiducial file version" in header
    columns = FCSV_COLUMNS if is_slicer4 else SLICER3_COLUMNS
    system = header.get("coordinatesystem", None if is_slicer4 else "RAS")
    names, stated = columns.split(","), header.get("columns", columns)
    if [name.strip() for name in stated.split(",")][: len(names)] != names:
        raise MarkerError(f"columns are {stated!r}. They may be {columns!r}", code="column-unknown")
    signs = {"LPS": np.ones(3), "1": np.ones(3), "RAS": RAS_TO_LPS, "0": RAS_TO_LPS}
    if system not in signs:
        raise MarkerError(
            f"CoordinateSystem is {system!r}. It may be RAS, LPS, 0 (RAS) or 1 (LPS)",
            code="coordinate-system-unknown",
        )

    points = []
    for number, (_, row) in enumerate(split_rows("\n".join(lines), where, MarkerError), start=1):
        cells = dict(zip(names, row, strict=False))
        label = cells.get("label")
        what = f"of marker {label.strip()!r}" if label else "of it"
        place = f"{where}, point {number}"
        xyz = [parse_number(cells.get(axis), f"{axis} {what}", place, MarkerError)
               for axis in "xyz"]  # fmt: skip
        points.append((label, np.array(xyz) * signs[system] * 1e-3))
    return points
