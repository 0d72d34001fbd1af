"""Marker files -> the two sides of the markers, joined by label.

Tables are read here, 3D Slicer's files in `slicer`. Markers are joined by label, never by order or
by nearness.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal
from unicodedata import category

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MarkerError
from vfplan.findings import Finding, note
from vfplan.io.table import Table, parse_table, read_text

MAX_BYTES = 16 * 2**20

ALLOWED = "label,u_px,v_px and/or label,x_m,y_m,z_m (or x_mm,y_mm,z_mm), with sigma_m"

LABEL_NAMES = ("label", "name")
METRES = {"m": 1.0, "cm": 100.0, "mm": 1000.0}  # how many of the unit a metre is

# A column of one of these names that is not understood would be a unit or a frame ignored.
COORDINATE_NAMES = ("u", "v", "x", "y", "z", "sigma")

# RMS distance of a layout's markers from their centre [m]: from a small jig to the width of a
# scanner. The same numbers read as metres and as millimetres cannot both be within it.
LAYOUT_RADIUS_M = (0.01, 1.0)

MarkerFrame = Literal["image", "patient_lps", "robot_base"]


@dataclass(frozen=True, eq=False)
class MarkerPoints:
    """Labelled positions in one frame."""

    # "image" [px], "patient_lps" [m] or "robot_base" [m].
    frame: MarkerFrame
    # (N,) labels, each once.
    labels: tuple[str, ...]
    # (N, 2) in "image", (N, 3) elsewhere.
    positions: NDArray[np.float64]
    # (N,) or (N, 3) standard deviations an axis [m]; `None` where the file names none.
    sigma: NDArray[np.float64] | None = None
    # The file, for messages.
    where: str | None = None
    # SHA-256 of the file's bytes, lower-case hex.
    sha256: str = ""
    # What was concluded and not read.
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        """Every label once, and at least one of them."""
        if not self.labels:
            raise MarkerError(
                "holds no marker; at least three are wanted", where=self.where, code="no-markers"
            )
        for label, count in Counter(self.labels).items():
            if count > 1:
                raise MarkerError(
                    f"label {label!r} occurs {count} times; each marker may occur once",
                    where=self.where,
                    code="label-doubled",
                    numbers={"label": label, "count": count},
                )


@dataclass(frozen=True, eq=False)
class Correspondences:
    """The same markers in two frames."""

    # (N,) labels in the order of the source file.
    labels: tuple[str, ...]
    # (N, 2) [px] in "image", or (N, 3) [m] in "patient_lps".
    source: NDArray[np.float64]
    source_frame: MarkerFrame
    # (N, 3) [m] in `target_frame`.
    target: NDArray[np.float64]
    # (N,) or (N, 3) standard deviation of the target an axis [m]; `None` where none was given.
    sigma: NDArray[np.float64] | None = None
    # "patient_lps" where the target side came from a Slicer file.
    target_frame: MarkerFrame = "robot_base"
    # SHA-256 of "markers" and "markers2".
    inputs: dict[str, str] = field(default_factory=dict)
    # Units that were concluded, and markers that only one side has.
    findings: tuple[Finding, ...] = ()


def read_markers(
    path: str | Path, path2: str | Path | None = None, *, common: bool = False
) -> Correspondences:
    """Read markers from one file that holds both sides, or from two files joined by label.

    One file: a table with `label,u_px,v_px,x_m,y_m,z_m`. Two files, each a table
    (`label,u_px,v_px` or `label,x_m,y_m,z_m`), a Slicer `.mrk.json` or a Slicer `.fcsv`. Pixels are
    always a source and a table of robot positions is always the target, in whichever order the
    files come. A Slicer file (patient LPS) takes the other side. Of two Slicer files the first is
    the source.

    Parameters
    ----------
    path, path2
        The files.
    common
        Use the markers that both sides have. Without it both sides must have the same.

    Raises
    ------
    MarkerError
        A file that cannot be read or may mean two things; a label that is doubled, or that only one
        side has; two files for the same side.
    """
    if path2 is None:
        sides = _read(Path(path))
        if len(sides) != 2:
            raise MarkerError(
                f"holds only {sides[0].frame} positions; give a second file with the other side, "
                "or one table with label,u_px,v_px,x_m,y_m,z_m",
                where=str(path),
                code="one-side-only",
            )
        return _join(sides[0], sides[1], {"markers": sides[0].sha256}, common)
    first, second = _read_one_side(Path(path)), _read_one_side(Path(path2))
    source, target = _source_and_target(first, second)
    inputs = {"markers": first.sha256, "markers2": second.sha256}
    return _join(source, target, inputs, common)


def _read(path: Path) -> list[MarkerPoints]:
    from vfplan.markers.slicer import parse_fcsv, parse_mrk_json

    suffix = path.suffix.lower()
    where = str(path)
    if suffix not in (".csv", ".txt", ".tsv", ".json", ".fcsv"):
        raise MarkerError(
            f"has suffix {path.suffix!r}; .csv, .mrk.json or .fcsv is wanted",
            where=where,
            code="suffix-unknown",
        )
    text, sha256 = read_text(path, MAX_BYTES, MarkerError)
    if suffix == ".json":
        sides = [parse_mrk_json(text, where)]
    elif suffix == ".fcsv":
        sides = [parse_fcsv(text, where)]
    else:
        sides = parse_marker_table(text, where)
    return [replace(side, sha256=sha256) for side in sides]


def _read_one_side(path: Path) -> MarkerPoints:
    sides = _read(path)
    if len(sides) == 2:
        raise MarkerError(
            "holds both sides already; give it alone, or two files with one side each",
            where=str(path),
            code="both-sides",
        )
    return sides[0]


def _source_and_target(
    first: MarkerPoints, second: MarkerPoints
) -> tuple[MarkerPoints, MarkerPoints]:
    if first.frame == second.frame != "patient_lps":
        raise MarkerError(
            f"both files hold {first.frame} positions ({first.where}); one of each side is wanted",
            where=second.where,
            code="same-side-twice",
        )
    if second.frame == "image" or first.frame == "robot_base":
        return second, first
    return first, second


def _join(
    source: MarkerPoints, target: MarkerPoints, inputs: dict[str, str], common: bool
) -> Correspondences:
    findings = source.findings + target.findings
    for side, other in ((source, target), (target, source)):
        lone = [label for label in side.labels if label not in other.labels]
        if not lone:
            continue
        names = ", ".join(lone)
        if not common:
            raise MarkerError(
                f"has no marker {names}, which {side.where} has; delete {names} there, or use "
                "--common",
                where=other.where,
                code="labels-differ",
                numbers={"labels": lone},
            )
        text = f"Only {Path(side.where or 'one side').name} has {names}: left out."
        findings += (note("markers-not-common", "register", text),)
    labels = tuple(label for label in source.labels if label in target.labels)
    from_source = [source.labels.index(label) for label in labels]
    from_target = [target.labels.index(label) for label in labels]
    return Correspondences(
        labels=labels,
        source=source.positions[from_source],
        source_frame=source.frame,
        target=target.positions[from_target],
        sigma=None if target.sigma is None else target.sigma[from_target],
        target_frame=target.frame,
        inputs=inputs,
        findings=findings,
    )


def label_of(text: object, what: str, where: str) -> str:
    """A label without surrounding blanks, or a `MarkerError` where no bundle can hold it."""
    label = str(text).strip() if text is not None else ""
    if not label:
        raise MarkerError(
            f"{what} has no label; every marker needs one", where=where, code="label-missing"
        )
    if any(category(sign) == "Cc" for sign in label):
        raise MarkerError(
            f"{what} has the label {label!r}: a control character",
            where=where,
            code="label-control-character",
        )
    return label


def parse_marker_table(text: str, where: str) -> list[MarkerPoints]:
    """The image side, the robot side, or both, of one table.

    Columns: `label` (or `name`), `u_px,v_px` [px], `x_m,y_m,z_m` [m] (or `_mm`, `_cm`), and on the
    robot side `sigma_m` (or `sigma`, one standard deviation an axis) or `sigma_x_m,sigma_y_m,
    sigma_z_m`. Plain `x,y,z` are metres or millimetres, by the size of the layout. Other columns
    are notes and are left alone, unless they look like a coordinate in another unit.

    Raises MarkerError: a missing or doubled column, a missing cell, a value that is not a finite
        number, a table that may mean two things
    """
    table = parse_table(text, where, MarkerError)
    place = f"{where}, line {table.header_line}"
    if all(_looks_like_number(name) for name in table.header[1:]) and len(table.header) > 1:
        raise MarkerError(
            "the first line holds numbers and no column names; write label,u_px,v_px or "
            "label,x_m,y_m,z_m above it",
            where=place,
            code="header-missing",
        )
    columns = {_plain(name): name for name in table.header}
    label_column = next((columns[name] for name in LABEL_NAMES if name in columns), None)
    if label_column is None:
        raise MarkerError(
            f"no column 'label' in {','.join(table.header)!r}; allowed: {ALLOWED}",
            where=place,
            code="column-missing",
        )
    image = _choose(columns, [("u_px", "v_px"), ("u", "v")], place)
    robot = _choose(columns, [("x", "y", "z"), *_in_units("x_{}", "y_{}", "z_{}")], place)
    sigma_choices = [("sigma",), *_in_units("sigma_{}")]
    sigma_choices += _in_units("sigma_x_{}", "sigma_y_{}", "sigma_z_{}")
    sigma = _choose(columns, sigma_choices, place)
    _refuse_unknown(columns, image + robot + sigma, place)
    if not image and not robot:
        raise MarkerError(
            f"no coordinates in columns {','.join(table.header)!r}; allowed: {ALLOWED}",
            where=place,
            code="column-missing",
        )
    if sigma and not robot:
        raise MarkerError(
            "a sigma [m] belongs to the robot's positions (x_m,y_m,z_m), which are not here",
            where=place,
            code="sigma-without-positions",
        )
    table.check_decimals(tuple(columns[name] for name in image + robot + sigma))

    labels = tuple(
        label_of(row.cells[label_column], f"line {row.line}", where) for row in table.rows
    )
    sides = []
    if image:
        positions = _positions(table, labels, [columns[name] for name in image])
        sides.append(MarkerPoints("image", labels, positions, where=where))
    if robot:
        raw = _positions(table, labels, [columns[name] for name in robot])
        per_metre, findings = _units_per_metre(robot, raw, place)
        spread = None
        if sigma:
            spread = _sigma(table, labels, [columns[name] for name in sigma])
            unit = sigma[0].rsplit("_", 1)[-1]
            spread = spread / METRES.get(unit, per_metre)
        sides.append(
            MarkerPoints(
                "robot_base", labels, raw / per_metre, spread, where=where, findings=findings
            )
        )
    return sides


def _plain(name: str) -> str:
    """A column's name in lower case, with its unit behind an underscore: "X [mm]" is "x_mm"."""
    return re.sub(r"[\s_\[\]()]+", "_", name.casefold()).strip("_")


def _looks_like_number(text: str) -> bool:
    return bool(re.fullmatch(r"[-+]?[0-9.,]+(e[-+]?[0-9]+)?", text.strip(), re.IGNORECASE))


def _in_units(*patterns: str) -> list[tuple[str, ...]]:
    return [tuple(pattern.format(unit) for pattern in patterns) for unit in METRES]


def _choose(columns: dict[str, str], choices: list[tuple[str, ...]], place: str) -> tuple[str, ...]:
    """The one choice of column names that the table has; () where it has none of any."""
    present = [names for names in choices if any(name in columns for name in names)]
    if not present:
        return ()
    if len(present) > 1:
        shown = " and ".join(",".join(names) for names in present)
        raise MarkerError(
            f"{shown} in one table; give one of them", where=place, code="columns-ambiguous"
        )
    names = present[0]
    for name in names:
        if name not in columns:
            raise MarkerError(
                f"missing column {name!r} beside {','.join(columns)!r}",
                where=place,
                code="column-missing",
                numbers={"column": name},
            )
    return names


def _refuse_unknown(columns: dict[str, str], known: tuple[str, ...], place: str) -> None:
    for plain, name in columns.items():
        if plain not in known and plain.split("_")[0] in COORDINATE_NAMES:
            raise MarkerError(
                f"column {name!r} is not understood; allowed: {ALLOWED}",
                where=place,
                code="column-unknown",
                numbers={"column": name},
            )


def _positions(table: Table, labels: tuple[str, ...], columns: list[str]) -> NDArray[np.float64]:
    positions = np.empty((len(labels), len(columns)))
    for i, (row, label) in enumerate(zip(table.rows, labels, strict=True)):
        for k, column in enumerate(columns):
            positions[i, k] = table.number(row, column, f"marker {label!r}")
    return positions


def _sigma(table: Table, labels: tuple[str, ...], columns: list[str]) -> NDArray[np.float64]:
    """(N,) or (N, 3) standard deviations in the table's unit."""
    sigma = _positions(table, labels, columns)
    for row, label, values in zip(table.rows, labels, sigma, strict=True):
        if not (values > 0).all():
            raise MarkerError(
                f"sigma of marker {label!r} is {values.min():g}; above 0 is wanted",
                where=f"{table.where}, line {row.line}",
                code="sigma-range",
                numbers={"label": label},
            )
    return sigma[:, 0] if len(columns) == 1 else sigma


def _units_per_metre(
    names: tuple[str, ...], raw: NDArray[np.float64], place: str
) -> tuple[float, tuple[Finding, ...]]:
    """How many of the table's unit a metre is: as its header says, or by the layout's size."""
    if "_" in names[0]:
        return METRES[names[0].rsplit("_", 1)[-1]], ()
    radius = float(np.sqrt(((raw - raw.mean(axis=0)) ** 2).sum(axis=1).mean()))
    for unit in ("m", "mm"):
        if LAYOUT_RADIUS_M[0] <= radius / METRES[unit] <= LAYOUT_RADIUS_M[1]:
            text = f"Columns X, Y, Z name no unit: taken as {unit}, by the size of the layout."
            return METRES[unit], (note("unit-concluded", "register", text),)
    raise MarkerError(
        f"columns x,y,z name no unit, and a layout of {radius:.3g} (rms from its centre) fits "
        "neither metres nor millimetres; write x_m,y_m,z_m or x_mm,y_mm,z_mm",
        where=place,
        code="unit-unclear",
        numbers={"radius": radius},
    )
