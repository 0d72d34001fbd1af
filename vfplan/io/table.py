"""The one strict reader of CSV tables: header, cells and numbers; each error names its line.

`read_table` reads a small table whole, as text. `open_number_table` reads a table of numbers of any
length block by block.

Columns are separated by commas, semicolons or tabs, whichever the header line holds. Between
semicolons or tabs, numbers may have a decimal comma, as spreadsheets in most of Europe write them.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from vfplan.errors import InputError
from vfplan.io.files import MAX_LINE_BYTES, parse_decimal, read_bytes

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}

MAX_NUMBER = 1e9
"""Largest number in a small table [px or m], and in a tick that is shown [s, m or N]. Nothing real
is larger, and its square is finite."""

MAX_COLUMNS = 1000
"""Columns of a table of numbers. Loggers write some tens."""

BLOCK_BYTES = 1 << 21
"""Bytes that are parsed at a time, about 40,000 lines of a session."""

# Bytes of a block that NumPy's parser and `parse_decimal` read alike. Both also take nan and inf,
# which the callers refuse.
_NUMERIC_BYTES = b"0123456789+-.eE \t\nnaifNAIF"


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
                    f"{what} is {text!r}, whose comma may mean two things. Write a number as "
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
    encoding = "utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        return data.decode(encoding), sha256
    except UnicodeDecodeError:
        raise kind(
            "is not UTF-8 or UTF-16 text. Save it as CSV UTF-8", where=str(path), code="not-text"
        ) from None


def parse_table(text: str, where: str, kind: type[InputError]) -> Table:
    """A table from text.

    Raises the kind of error given: no text, a separator that is not clear, a column twice, a row of
        another length
    """
    lines = text.splitlines()
    header_line = next((line for line in lines if line.strip()), "")
    separator = ","
    if header_line:
        place = f"{where}, line {lines.index(header_line) + 1}"
        separator = _separator_of(header_line, place, kind)
    rows = split_rows(text, where, kind, separator)
    if not rows:
        raise kind("is empty. Give a table with a header", where=where, code="table-empty")
    first_line, names = rows[0]
    header = tuple(name.strip() for name in names)
    folded = [name.casefold() for name in header]
    for name, key in zip(header, folded, strict=True):
        if key and folded.count(key) > 1:
            raise kind(
                f"column {name!r} occurs {folded.count(key)} times. Leave one",
                where=f"{where}, line {first_line}",
                code="column-doubled",
            )
    table_rows = []
    for line, cells in rows[1:]:
        if len(cells) != len(header):
            advice = "Give each row as many"
            if separator == "," and len(cells) > len(header):
                advice = "Put semicolons between the columns where numbers have a decimal comma"
            raise kind(
                f"the row has {len(cells)} cells, and the header names {len(header)} "
                f"columns. {advice}",
                where=f"{where}, line {line}",
                code="row-length",
                numbers={"cells": len(cells), "columns": len(header)},
            )
        stripped = [cell.strip() for cell in cells]
        table_rows.append(Row(line, dict(zip(header, stripped, strict=True))))
    return Table(header, first_line, tuple(table_rows), separator, where, kind)


def _separator_of(header_line: str, place: str, kind: type[InputError]) -> str:
    present = [separator for separator in SEPARATORS if separator in header_line]
    if len(present) > 1:
        names = " and ".join(SEPARATORS[separator] for separator in present)
        raise kind(
            f"the header holds {names}: {header_line[:80]!r}. Separate the columns by one of them",
            where=place,
            code="separator-ambiguous",
        )
    return present[0] if present else ","


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
            f"is no CSV: {error}. Save the table again as CSV",
            where=f"{where}, line {reader.line_num}",
            code="table-broken",
        ) from None
    return rows


def parse_number(value: object, what: str, where: str, kind: type[InputError]) -> float:
    """A finite number of at most 1e9 in size.

    value: text, or what JSON holds
    Raises the kind of error given, which says what stands there instead
    """
    try:
        if isinstance(value, bool):  # Python takes True for 1.
            raise ValueError
        number = parse_decimal(value) if isinstance(value, str) else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = None
    if number is None or not math.isfinite(number):
        wanted = "a number"
        if str(value).strip().lower().lstrip("+-") in ("nan", "inf", "infinity"):
            wanted = "a finite number"
        raise kind(f"{what} is {repr(value)[:60]}. Give {wanted}", where=where, code="no-number")
    if abs(number) > MAX_NUMBER:
        raise kind(
            f"{what} is {value!r}. Give at most {MAX_NUMBER:g}",
            where=where,
            code="number-too-large",
        )
    return number


@dataclass(frozen=True)
class NumberTable:
    """A table of numbers that is read block by block, each time `blocks` is called."""

    # Opens the file at its first byte.
    open_stream: Callable[[], BinaryIO]
    # The file, for messages, and the class of its errors.
    where: str
    kind: type[InputError]
    # Column names in lower case, without surrounding blanks.
    columns: tuple[str, ...]
    separator: str
    # Lines above the first row of numbers.
    header_lines: int

    def blocks(self, columns: tuple[str, ...]) -> Iterator[NDArray[np.float64]]:
        """Yield some rows at a time, (n, len(columns)).

        Raises the table's kind of error: a line too long, another number of cells than columns, a
            cell that is no number, a decimal comma in one place and a decimal point in another
        """
        indices = [self.columns.index(column) for column in columns]
        parser = _BlockParser(self)
        with self.open_stream() as stream:
            for _ in range(self.header_lines):
                stream.readline(MAX_LINE_BYTES + 1)
            line = self.header_lines + 1
            unfinished = b""
            while True:
                piece = stream.read(BLOCK_BYTES)
                if not piece:
                    break
                complete, newline, unfinished = (unfinished + piece).rpartition(b"\n")
                if newline:
                    yield parser.parse(complete, line)[:, indices]
                    line += complete.count(b"\n") + 1
                if len(unfinished) > MAX_LINE_BYTES:
                    raise self.kind(
                        f"the line is longer than {MAX_LINE_BYTES} bytes. Give a table of "
                        "shorter rows",
                        where=f"{self.where}, line {line}",
                        code="line-too-long",
                    )
            if unfinished.strip():
                yield parser.parse(unfinished, line)[:, indices]


def open_number_table(
    open_stream: Callable[[], BinaryIO],
    where: str,
    kind: type[InputError],
    wanted: tuple[str, ...] = (),
    *,
    header_optional: bool = False,
) -> NumberTable:
    """A table of numbers, of which the header has been read and checked.

    Parameters
    ----------
    open_stream
        Opens the file, UTF-8 text, at its first byte; called once here and once a reading.
    where, kind
        The file for messages, and the class of its errors.
    wanted
        Names of columns, in lower case, that the header must hold once each.
    header_optional
        A first line that begins with a number is taken for a row. The columns are then named
        "column 1", "column 2" and so on.

    Raises
    ------
    InputError
        One of the `kind` given: an empty file, a first line that is too long, no text, or holds two
        kinds of separators, too many columns, a wanted column that is missing or there twice.
    """
    listed = ", ".join(wanted)
    with open_stream() as stream:
        first = stream.readline(MAX_LINE_BYTES + 1)
        line = 1
        while first and not first.strip():
            first = stream.readline(MAX_LINE_BYTES + 1)
            line += 1
    place = f"{where}, line {line}"
    if not first:
        raise kind(
            f"is empty. Give a table with a header {listed}".rstrip(),
            where=where,
            code="table-empty",
        )
    if len(first) > MAX_LINE_BYTES:
        raise kind(
            f"the line is longer than {MAX_LINE_BYTES} bytes. Give a table of shorter rows",
            where=place,
            code="line-too-long",
        )
    try:
        header = first.decode("utf-8-sig").strip("\r\n")
    except UnicodeDecodeError:
        raise kind(
            "is not UTF-8 text. Save it as CSV UTF-8", where=where, code="not-text"
        ) from None
    separator = _separator_of(header, place, kind)
    columns = [name.strip().lower() for name in header.split(separator)]
    if len(columns) > MAX_COLUMNS:
        raise kind(
            f"has {len(columns)} columns. Leave at most {MAX_COLUMNS}",
            where=where,
            code="too-many-columns",
            numbers={"columns": len(columns)},
        )
    header_lines = line
    if header_optional:
        try:
            parse_decimal(columns[0].replace(",", "."))
        except ValueError:
            pass
        else:
            columns = [f"column {i + 1}" for i in range(len(columns))]
            header_lines = line - 1
    for column in wanted:
        count = columns.count(column)
        if count == 0:
            raise kind(
                f"column {column!r} is missing from the header {header[:70]!r}. Give {listed}",
                where=place,
                code="column-missing",
            )
        if count > 1:
            raise kind(
                f"column {column!r} occurs {count} times. Leave one",
                where=place,
                code="column-doubled",
            )
    return NumberTable(open_stream, where, kind, tuple(columns), separator, header_lines)


class _BlockParser:
    """Parses the blocks of one table, and remembers which decimal mark they have used so far."""

    def __init__(self, table: NumberTable) -> None:
        self._table = table
        self._numeric = _NUMERIC_BYTES + b"," + table.separator.encode()
        self._marks: set[bytes] = set()

    def parse(self, text: bytes, line: int) -> NDArray[np.float64]:
        """(n, columns) numbers of lines, the first of which has the number `line`."""
        import numpy as np  # Here and not above, because other tables need none of it.

        # A carriage return that stands elsewhere than before a newline makes its line a bad one.
        body = (text + b"\n").replace(b"\r\n", b"\n").rstrip(b"\n")
        if self._table.separator != ",":
            for mark in (b",", b"."):
                if mark in body:
                    self._marks.add(mark)
            if len(self._marks) == 2:
                raise self._table.kind(
                    "decimal commas and decimal points in one table: 1,234 may be 1.234 or 1234. "
                    "Write all numbers alike",
                    where=f"{self._table.where}, from line {line} on",
                    code="decimal-ambiguous",
                )
            body = body.replace(b",", b".")
        if body and not body.translate(None, self._numeric):
            try:
                values = np.loadtxt(
                    io.BytesIO(body), delimiter=self._table.separator, comments=None, ndmin=2
                )
            except ValueError:
                pass
            else:
                if values.shape[1] == len(self._table.columns):
                    return values
        # Parse line by line: slower, passes over blank lines, and names the first bad line.
        rows = []
        for number, raw in enumerate(body.split(b"\n"), start=line):
            row = raw.decode("utf-8", "replace")
            if row.strip():
                rows.append(self._parse_line(row, number))
        return np.array(rows, dtype=np.float64).reshape(-1, len(self._table.columns))

    def _parse_line(self, text: str, line: int) -> list[float]:
        table = self._table
        place = f"{table.where}, line {line}"
        cells = text.split(table.separator)
        if len(cells) != len(table.columns):
            raise table.kind(
                f"the row has {len(cells)} cells, and the header names {len(table.columns)} "
                "columns. Give each row as many",
                where=place,
                code="row-length",
                numbers={"cells": len(cells), "columns": len(table.columns)},
            )
        row = []
        for column, cell in zip(table.columns, cells, strict=True):
            try:
                row.append(parse_decimal(cell))
            except ValueError as error:
                raise table.kind(
                    f"column {column!r} cannot be used: {error}. Correct the row",
                    where=place,
                    code="no-number",
                ) from None
        return row
