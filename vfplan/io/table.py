"""The one strict reader of small tables as text: header, cells and numbers, each error by its line.

Columns are separated by commas, semicolons or tabs, whichever the header line holds. Between
semicolons or tabs, numbers may have a decimal comma, as spreadsheets in most of Europe write them.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

from vfplan.errors import InputError
from vfplan.io.files import read_bytes, real

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}

# Pixels or metres: nothing real is larger, and squares of more overflow in the end.
MAX_NUMBER = 1e9


@dataclass(frozen=True)
class Row:
    """One row below the header."""

    # Line of the file that the row ends on, counted from 1.
    line: int
    # Cells by the names of their columns, without surrounding blanks.
    cells: dict[str, str]


@dataclass(frozen=True)
class Table:
    """A table as text; nothing in it is a number yet."""

    # Column names as written, without surrounding blanks.
    header: tuple[str, ...]
    header_line: int
    rows: tuple[Row, ...]
    separator: str
    # The file, for messages.
    where: str
    kind: type[InputError]

    def number(self, row: Row, column: str, label: str = "") -> float:
        """The number in a cell.

        Raises the table's kind of error: no number, not finite, too large, or a comma that may be
        a decimal or a thousands separator
        """
        text = row.cells[column]
        what = f"{column} of {label}" if label else column
        place = f"{self.where}, line {row.line}"
        if "," in text and self.separator != ",":
            if "." in text or text.count(",") > 1:
                raise self.kind(
                    f"{what} is {text!r}, whose comma may mean two things; write a number as "
                    "1234.5 or as 1234,5",
                    where=place,
                    code="decimal-ambiguous",
                )
            text = text.replace(",", ".")
        return parse_number(text, what, place, self.kind)

    def check_decimals(self, columns: tuple[str, ...]) -> None:
        """Refuse a table whose numbers have decimal commas here and decimal points there."""
        first: dict[str, Row] = {}
        for row in self.rows:
            for column in columns:
                for mark in ",.":
                    if mark in row.cells[column]:
                        first.setdefault(mark, row)
        if self.separator != "," and len(first) == 2:
            line = max(row.line for row in first.values())
            raise self.kind(
                "decimal commas and decimal points in one table: 1,234 may be 1.234 or 1234. Write "
                "all numbers alike",
                where=f"{self.where}, line {line}",
                code="decimal-ambiguous",
            )


def read_table(path: str | Path, max_bytes: int, kind: type[InputError]) -> tuple[Table, str]:
    """A table from a file, and the SHA-256 of its bytes; raises the kind of error given."""
    text, sha256 = read_text(path, max_bytes, kind)
    return parse_table(text, str(path), kind), sha256


def read_text(path: str | Path, max_bytes: int, kind: type[InputError]) -> tuple[str, str]:
    """A file's text and the SHA-256 of its bytes: UTF-8, or UTF-16 with a byte order mark."""
    data, sha256 = read_bytes(Path(path), max_bytes, kind)
    encoding = "utf-8-sig"
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        encoding = "utf-16"
    try:
        return data.decode(encoding), sha256
    except UnicodeDecodeError:
        raise kind(
            "is not UTF-8 or UTF-16 text; save it as CSV UTF-8", where=str(path), code="not-text"
        ) from None


def parse_table(text: str, where: str, kind: type[InputError]) -> Table:
    """A table from text.

    Raises the kind of error given: no text, a separator that is not clear, a column twice, a row of
        another length
    """
    lines = text.splitlines()
    header_line = next((line for line in lines if line.strip()), "")
    present = [separator for separator in SEPARATORS if separator in header_line]
    if len(present) > 1:
        names = " and ".join(SEPARATORS[separator] for separator in present)
        raise kind(
            f"the header holds {names}, {header_line[:80]!r}; separate the columns by one of them",
            where=f"{where}, line {lines.index(header_line) + 1}",
            code="separator-ambiguous",
        )
    separator = present[0] if present else ","
    rows = split_rows(text, where, kind, separator)
    if not rows:
        raise kind("is empty; a table with a header is wanted", where=where, code="table-empty")
    first_line, names = rows[0]
    header = tuple(name.strip() for name in names)
    folded = [name.casefold() for name in header]
    for name, key in zip(header, folded, strict=True):
        if key and folded.count(key) > 1:
            raise kind(
                f"column {name!r} occurs {folded.count(key)} times",
                where=f"{where}, line {first_line}",
                code="column-doubled",
            )
    table_rows = []
    for line, cells in rows[1:]:
        if len(cells) != len(header):
            advice = ""
            if separator == "," and len(cells) > len(header):
                advice = ". Numbers with a decimal comma need semicolons between the columns"
            raise kind(
                f"{len(cells)} cells; the header names {len(header)} columns{advice}",
                where=f"{where}, line {line}",
                code="row-length",
                numbers={"cells": len(cells), "columns": len(header)},
            )
        stripped = [cell.strip() for cell in cells]
        table_rows.append(Row(line, dict(zip(header, stripped, strict=True))))
    return Table(header, first_line, tuple(table_rows), separator, where, kind)


def split_rows(
    text: str, where: str, kind: type[InputError], separator: str = ","
) -> list[tuple[int, list[str]]]:
    """The rows that hold anything, each with its line; LF, CRLF and CR end a line.

    Raises the kind of error given where the text is no table
    """
    reader = csv.reader(io.StringIO(text, newline=None), strict=True, delimiter=separator)
    rows = []
    try:
        for row in reader:
            if any(cell.strip() for cell in row):
                rows.append((reader.line_num, row))
    except csv.Error as error:
        raise kind(
            f"is no CSV: {error}", where=f"{where}, line {reader.line_num}", code="table-broken"
        ) from None
    return rows


def parse_number(value: object, what: str, where: str, kind: type[InputError]) -> float:
    """A finite number of at most 1e9 in size.

    value: text, or what JSON holds
    Raises the kind of error given, which says what stands there instead
    """
    try:
        if isinstance(value, bool):  # which Python takes for 0 or 1
            raise ValueError
        number = real(value) if isinstance(value, str) else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        shown, plain = f"{value!r}"[:60], str(value).strip().lower().lstrip("+-")
        wanted = "a finite number" if plain in ("nan", "inf", "infinity") else "a number"
        raise kind(
            f"{what} is {shown}; {wanted} is wanted", where=where, code="no-number"
        ) from None
    if not math.isfinite(number):
        raise kind(f"{what} is {value!r}; a finite number is wanted", where=where, code="no-number")
    if abs(number) > MAX_NUMBER:
        raise kind(
            f"{what} is {value!r}; at most {MAX_NUMBER:g} is allowed",
            where=where,
            code="number-too-large",
        )
    return number
