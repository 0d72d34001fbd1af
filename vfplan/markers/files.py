"""Marker files -> two sides joined by label; units and frames are read, never guessed.

CSV tables, whose header names columns and units, are read here, Slicer's files in `slicer`.
"""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal
from unicodedata import category

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MarkerError
from vfplan.io.files import read_bytes, real

IMAGE = ("u_px", "v_px")
ROBOT = ("x_m", "y_m", "z_m")
# One standard deviation for a marker, or one an axis; with or without the unit in the name, metres.
SIGMA = (("sigma_m",), ("sigma",), ("sigma_x_m", "sigma_y_m", "sigma_z_m"))
ALLOWED = "label,u_px,v_px and/or label,x_m,y_m,z_m, with sigma_m or sigma_x_m,sigma_y_m,sigma_z_m"
# A column of one of these families that is not understood would be a unit or a frame ignored.
FAMILIES = ("u", "v", "x", "y", "z", "sigma")

MAX_BYTES = 16 * 2**20
FURTHEST = 1e9  # pixels or metres; nothing real is, and squares of more overflow in the end

MarkerFrame = Literal["image", "patient_lps", "robot_base"]


@dataclass(frozen=True, eq=False)
class MarkerPoints:
    """Labelled positions in one frame."""

    frame: MarkerFrame  # "image" [px], "patient_lps" [m] or "robot_base" [m]
    labels: tuple[str, ...]  # (N,) labels, each once
    positions: NDArray[np.float64]  # (N, 2) in "image", (N, 3) elsewhere
    # (N,) or (N, 3) standard deviations [m] an axis; `None` where the file names none
    sigma: NDArray[np.float64] | None = None
    where: str | None = None  # the file, for messages
    sha256: str = ""  # of the file's bytes, lower-case hex

    def __post_init__(self) -> None:
        if not self.labels:
            raise MarkerError("holds no marker; at least three are wanted", where=self.where)
        for label, count in Counter(self.labels).items():
            if count > 1:
                raise MarkerError(
                    f"label {label!r} occurs {count} times; each marker may occur once",
                    where=self.where,
                )


@dataclass(frozen=True, eq=False)
class Correspondences:
    """The same markers seen in two frames."""

    labels: tuple[str, ...]  # (N,) in the order of the source file
    source: NDArray[np.float64]  # (N, 2) [px] in "image", or (N, 3) [m] in "patient_lps"
    source_frame: MarkerFrame  # "image" or "patient_lps"
    target: NDArray[np.float64]  # (N, 3) [m] in `target_frame`
    # (N,) or (N, 3) standard deviation of `target` an axis [m]; `None` when none was given
    sigma: NDArray[np.float64] | None = None
    # "patient_lps" where the target side came from a Slicer file
    target_frame: MarkerFrame = "robot_base"
    inputs: dict[str, str] = field(default_factory=dict)  # SHA-256 of "markers", "markers2"


def read_markers(path: str | Path, path2: str | Path | None = None) -> Correspondences:
    """Read markers from one file that holds both sides, or from two files joined by label.

    One file: a CSV with `label,u_px,v_px,x_m,y_m,z_m`. Two files, each a CSV (`label,u_px,v_px` or
    `label,x_m,y_m,z_m`), a Slicer `.mrk.json` or a Slicer `.fcsv`. Image pixels are always a
    source and a CSV of robot positions is always the target, in whichever order the files come; a
    Slicer file (patient LPS) takes the other side. Two Slicer files: the first is the source.

    Raises
    ------
    MarkerError
        A file that cannot be read or parsed; a label that is missing, doubled or extra; two files
        for the same side.
    """
    if path2 is None:
        sides = _read(Path(path))
        if len(sides) != 2:
            raise MarkerError(
                f"holds only {sides[0].frame} positions; give a second file with the other side, "
                "or one CSV with label,u_px,v_px,x_m,y_m,z_m",
                where=str(path),
            )
        return _join(*sides, {"markers": sides[0].sha256})
    one, other = _single(Path(path)), _single(Path(path2))
    return _join(*_sides(one, other), {"markers": one.sha256, "markers2": other.sha256})


def _read(path: Path) -> list[MarkerPoints]:
    from vfplan.markers.slicer import parse_fcsv, parse_mrk_json

    readers = {".csv": parse_table, ".json": parse_mrk_json, ".fcsv": parse_fcsv}
    if (reader := readers.get(path.suffix.lower())) is None:
        raise MarkerError(
            f"has suffix {path.suffix!r}; .csv, .mrk.json or .fcsv is wanted", where=str(path)
        )
    text, sha256 = read_text(path)
    found = reader(text, str(path))
    return [replace(side, sha256=sha256) for side in (found if type(found) is list else [found])]


def _single(path: Path) -> MarkerPoints:
    sides = _read(path)
    if len(sides) == 2:
        raise MarkerError(
            "holds both sides already; give it alone, or two files with one side each",
            where=str(path),
        )
    return sides[0]


def _sides(a: MarkerPoints, b: MarkerPoints) -> tuple[MarkerPoints, MarkerPoints]:
    if a.frame == b.frame != "patient_lps":
        raise MarkerError(
            f"both files hold {a.frame} positions ({a.where}); one of each side is wanted",
            where=b.where,
        )
    swapped = b.frame == "image" or a.frame == "robot_base"
    return (b, a) if swapped else (a, b)


def _join(source: MarkerPoints, target: MarkerPoints, inputs: dict[str, str]) -> Correspondences:
    for one, other in ((source, target), (target, source)):
        missing = [label for label in one.labels if label not in other.labels]
        if missing:
            names = ", ".join(map(repr, missing))
            raise MarkerError(
                f"no marker {names}, which {one.where} has; both sides need the same labels",
                where=other.where,
            )
    order = [target.labels.index(label) for label in source.labels]
    sigma = None if target.sigma is None else target.sigma[order]
    return Correspondences(
        source.labels, source.positions, source.frame, target.positions[order], sigma,
        target.frame, inputs,
    )  # fmt: skip


def read_text(path: str | Path) -> tuple[str, str]:
    """A marker file's text and the SHA-256 of its bytes, or a `MarkerError`."""
    data, sha256 = read_bytes(Path(path), MAX_BYTES, MarkerError)
    try:
        return data.decode("utf-8-sig"), sha256
    except UnicodeDecodeError:
        raise MarkerError("is not UTF-8 text", where=str(path)) from None


def table_rows(text: str, where: str) -> list[list[str]]:
    """The rows of a CSV that hold anything, whichever of LF, CRLF and CR ends its lines.

    Raises `MarkerError` where the text is no CSV.
    """
    try:
        rows = list(csv.reader(io.StringIO(text, newline=None), strict=True))
    except csv.Error as error:
        raise MarkerError(f"is no CSV: {error}", where=where) from None
    return [row for row in rows if any(cell.strip() for cell in row)]


def number(text: object, what: str, where: str) -> float:
    """A finite number, or a `MarkerError` that says what was found instead."""
    try:
        if isinstance(text, bool):  # which Python takes for 0 or 1
            raise ValueError
        value = real(text) if isinstance(text, str) else float(text)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        shown, plain = f"{text!r}"[:60], str(text).strip().lower().lstrip("+-")
        wanted = "a finite number" if plain in ("nan", "inf", "infinity") else "a number"
        raise MarkerError(f"{what} is {shown}; {wanted} is wanted", where=where) from None
    if not math.isfinite(value):
        raise MarkerError(f"{what} is {text!r}; a finite number is wanted", where=where)
    if abs(value) > FURTHEST:
        raise MarkerError(f"{what} is {text!r}; at most {FURTHEST:g} is allowed", where=where)
    return value


def label_of(text: object, what: str, where: str) -> str:
    """A label without surrounding blanks, or a `MarkerError` where no bundle can hold it."""
    label = str(text).strip() if text is not None else ""
    if not label:
        raise MarkerError(f"{what} has no label; every marker needs one", where=where)
    if any(category(sign) == "Cc" for sign in label):
        raise MarkerError(f"{what} has the label {label!r}: a control character", where=where)
    return label


def parse_table(text: str, where: str) -> list[MarkerPoints]:
    """The image side, the robot side, or both, of one CSV.

    Columns: `label`, `u_px,v_px` [px], `x_m,y_m,z_m` [m], and on the robot side `sigma_m` (or
    `sigma`, one standard deviation an axis [m]) or `sigma_x_m,sigma_y_m,sigma_z_m`. Other columns
    are notes and are left alone, unless they look like a coordinate in another unit.

    Raises MarkerError: a missing or doubled column, a missing cell, a value that is not a finite
        number
    """
    rows = table_rows(text, where)
    if not rows:
        raise MarkerError(f"is empty; a CSV with a header is wanted ({ALLOWED})", where=where)
    header = [cell.strip().lower() for cell in rows[0]]
    _check_header(header, where)
    records = [cells_of(header, row, at) for at, row in numbered(rows[1:], where)]
    labels = tuple(
        label_of(record["label"], f"row {i}", where) for i, record in enumerate(records, start=2)
    )
    found = []
    if IMAGE[0] in header:
        found.append(
            MarkerPoints("image", labels, _columns(records, labels, IMAGE, where), where=where)
        )
    if ROBOT[0] in header:
        xyz = _columns(records, labels, ROBOT, where)
        sigma = _sigma(header, records, labels, where)
        found.append(MarkerPoints("robot_base", labels, xyz, sigma, where=where))
    return found


def _check_header(header: list[str], where: str) -> None:
    shown = ",".join(header)
    for name in header:
        if name and header.count(name) > 1:
            raise MarkerError(f"column {name!r} occurs {header.count(name)} times", where=where)
    if len(header) == 1 and (";" in shown or "\t" in shown):
        raise MarkerError(
            f"columns are not separated by commas: {shown!r}; commas, and points in numbers, are "
            "wanted",
            where=where,
        )
    if "label" not in header:
        raise MarkerError(f"no column 'label' in {shown!r}; allowed: {ALLOWED}", where=where)
    if not set(IMAGE + ROBOT) & set(header):
        raise MarkerError(f"no coordinates in columns {shown!r}; allowed: {ALLOWED}", where=where)
    sigmas = [names for names in SIGMA if set(names) & set(header)]
    for names in (IMAGE, ROBOT, *sigmas):
        missing = [name for name in names if name not in header]
        if missing and len(missing) < len(names):
            raise MarkerError(f"missing column {missing[0]!r} beside {shown!r}", where=where)
    if len(sigmas) > 1:
        raise MarkerError(f"more than one kind of sigma in columns {shown!r}", where=where)
    if sigmas and ROBOT[0] not in header:
        raise MarkerError(
            "a sigma [m] belongs to the robot's positions (x_m,y_m,z_m), which are not here",
            where=where,
        )
    known = {*IMAGE, *ROBOT, *(name for names in SIGMA for name in names)}
    for name in header:
        if name not in known and name.split("_")[0] in FAMILIES:
            raise MarkerError(f"column {name!r} is not understood; allowed: {ALLOWED}", where=where)


def cells_of(header: list[str], row: list[str], where: str) -> dict[str, str]:
    """A row's cells by their columns' names."""
    if len(row) != len(header):
        raise MarkerError(f"{len(row)} cells; the header names {len(header)} columns", where=where)
    return dict(zip(header, row, strict=True))


def _columns(
    records: list[dict[str, str]], labels: tuple[str, ...], names: tuple[str, ...], where: str
) -> np.ndarray:
    values = [
        [number(record[name].strip(), f"{name} of marker {label!r}", where) for name in names]
        for label, record in zip(labels, records, strict=True)
    ]
    return np.array(values, dtype=float).reshape(len(labels), len(names))


def _sigma(
    header: list[str], records: list[dict[str, str]], labels: tuple[str, ...], where: str
) -> np.ndarray | None:
    names = next((names for names in SIGMA if names[0] in header), None)
    if names is None:
        return None
    sigma = _columns(records, labels, names, where)
    for label, row in zip(labels, sigma, strict=True):
        if not (row > 0).all():
            raise MarkerError(
                f"sigma of marker {label!r} is {row.min():g} m; above 0 is wanted", where=where
            )
    return sigma[:, 0] if len(names) == 1 else sigma


def numbered(rows: list[list[str]], where: str) -> list[tuple[str, list[str]]]:
    """Each row below the header, and where it stands."""
    return [(f"{where}, row {i}", row) for i, row in enumerate(rows, start=2)]
