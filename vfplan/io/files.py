"""Read files from outside: regular files of a bounded size, whole or through one open descriptor.

Also strict decimal numbers and lengths of time as text holds them, values as JSON holds them, the
time that outputs are stamped with, and CSV tables: `parse_table` reads a small one whole, as text,
and `open_number_table` numbers of any length, block by block.

Columns are separated by commas, semicolons or tabs, whichever the header line holds. Between
semicolons or tabs, numbers may have a decimal comma, as spreadsheets in most of Europe write them.
"""

from __future__ import annotations

import codecs
import csv
import io
import math
import os
import re
import stat
import weakref
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, cast

from vfplan.errors import CheckFailed, InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# Bytes of a file that is read whole, where the caller names no other limit.
MAX_FILE_BYTES = 1 << 30

# Bytes that packed data may unpack to.
MAX_DECOMPRESSED_BYTES = MAX_FILE_BYTES

# Bytes of a file of settings, keys, a robot or an arm. A real one is a hundred times smaller.
MAX_SETTINGS_BYTES = 1 << 20

# Bytes of a file of text. Parsing text takes several times its size in memory.
MAX_TEXT_BYTES = 1 << 28

# Bytes of a line of text. No program that exports tables writes a longer one.
MAX_LINE_BYTES = 1 << 16

# A file, by its name.
FilePath = str | Path

# Unit of a table's or a mesh's numbers -> metres.
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}

# Names of columns or markers.
Names = tuple[str, ...]

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}

# Largest number in a small table [px or m], and in a tick that is shown [s, m or N]. Nothing real
# is larger, and its square is finite.
MAX_NUMBER = 1e9

# Columns of a table of numbers. Loggers write some tens.
MAX_COLUMNS = 1000

# Bytes that are parsed at a time, about 40,000 lines of a session.
BLOCK_BYTES = 1 << 21

# Bytes of a block that NumPy's parser and `parse_decimal` read alike. Both also take nan and inf,
# which the callers refuse.
_NUMERIC_BYTES = b"0123456789+-.,eE \t\nnaifNAIF"

# What tells zlib to take either kind of header.
GZIP_OR_ZLIB = zlib.MAX_WBITS | 32

# The units of a length of time.
SECONDS = {"s": 1, "min": 60, "h": 3600, "d": 86400}

# How UTF-16 begins.
UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")

# How a line begins that is no row: a remark, or Excel's word on its separator.
REMARK = re.compile('\ufeff?[ \t]*(#|"?sep=)', re.IGNORECASE)

# Digits, a point, an exponent. Python and NumPy would also take 1_000, nan and digits of other
# scripts, and other readers take 0x10 and 1d3.
_DECIMAL = re.compile(r"[ \t]*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)[ \t]*")


# The class of the errors that a reader raises.
ErrorKind = type[InputError]


@contextmanager
def naming_place(where: object | None) -> Iterator[None]:
    """Add a place to refusals of input that are raised inside and name none; `None` adds none."""
    try:
        yield
    except (CheckFailed, InputError) as error:
        if where is not None and not error.where:
            error.where = str(where)
        raise


def flags(names: str) -> int:
    """Flags of `os.open`, 0 for those that this system does not have, such as Windows."""
    return sum(getattr(os, name, 0) for name in names.split())


def opened_file(path: Path, kind: ErrorKind = InputError) -> BinaryIO:
    """A regular file, open for reading.

    Raises an error of the `kind` given if there is none, it is a directory, a pipe or a device,
    or it cannot be read.
    """
    try:
        # O_NONBLOCK: opening a named pipe would otherwise wait until somebody writes to it.
        descriptor = os.open(path, os.O_RDONLY | flags("O_NONBLOCK O_CLOEXEC O_BINARY"))
    except FileNotFoundError:
        text = "cannot be read: there is no such file. Check its name"
        raise kind(text, where=path, code="file-missing") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        text = f"cannot be read: {reason}. Check the file and its permissions"
        raise kind(text, where=path, code="file-unreadable") from error
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        what = "a directory" if stat.S_ISDIR(mode) else "a device or a pipe"
        text = f"cannot be read: it is {what}, not a file. Name a file"
        raise kind(text, where=path, code="not-a-file")
    return open(descriptor, "rb")


def read_whole(path: Path, max_bytes: int, kind: ErrorKind = InputError) -> bytes:
    """The bytes of a regular file of at most `max_bytes` bytes.

    A file that is longer is refused before it is read. Raises as `opened_file` does.
    """
    with opened_file(path, kind) as file:
        size = os.fstat(file.fileno()).st_size
        # One byte more, because the file may grow while it is read.
        data = file.read(size + 1) if size <= max_bytes else b""
    if max(size, len(data)) > max_bytes:
        raise kind(
            f"is longer than {max_bytes} bytes, the most that is read. Give a shorter file",
            where=path, code="file-too-long",
            numbers={"bytes": max(size, len(data)), "max_bytes": max_bytes},
        )  # fmt: skip
    return data


def read_bytes(
    path: Path, max_bytes: int = MAX_FILE_BYTES, kind: ErrorKind = InputError
) -> tuple[bytes, str]:
    """A file's bytes and their SHA-256; raises as `read_whole` does."""
    data = read_whole(path, max_bytes, kind)
    import hashlib  # Here and not above, because `vfplan COMMAND --help` needs none of it.

    return data, hashlib.sha256(data).hexdigest()


class OpenedFile:
    """A regular file, opened once: if another file takes its name meanwhile, this one is read.

    path, kind: as for `opened_file`, which raises
    """

    def __init__(self, path: Path, kind: ErrorKind = InputError) -> None:
        with opened_file(path, kind) as file:
            self._descriptor = os.dup(file.fileno())
        weakref.finalize(self, os.close, self._descriptor)
        self._kind, self._where = kind, str(path)
        self._stamp = self._size_and_time()

    def fileno(self) -> int:
        """The descriptor, under the name that every Python file has for it."""
        return self._descriptor

    def view(self) -> BinaryIO:
        """A stream over the whole file, with a position of its own."""
        return stream_over(self._descriptor, self)

    def sha256(self) -> str:
        """SHA-256 of the file's bytes, hexadecimal."""
        import hashlib  # Here and not above, because `vfplan COMMAND --help` needs none of it.

        return hashlib.file_digest(self.view(), "sha256").hexdigest()

    def require_unchanged(self) -> None:
        """Refuse a file that was written to since it was opened: its digest would be wrong."""
        if self._size_and_time() != self._stamp:
            text = "was changed while it was read"
            raise self._kind(text, where=self._where, code="file-changed")

    def _size_and_time(self) -> tuple[int, int]:
        status = os.fstat(self._descriptor)
        return status.st_size, status.st_mtime_ns


def nameless_file() -> BinaryIO:
    """A file without a name: in memory where the system has such files."""
    if hasattr(os, "memfd_create"):
        return os.fdopen(os.memfd_create("vfplan"), "w+b")
    import tempfile

    return cast("BinaryIO", tempfile.TemporaryFile())


def stream_over(descriptor: int, owner: object = None) -> BinaryIO:
    """A stream with a position of its own in an open file.

    owner: the object that closes the descriptor; the stream keeps it alive
    """
    return cast("BinaryIO", io.BufferedReader(_View(descriptor, owner), 1 << 16))


class _View(io.RawIOBase):
    name = ""  # Libraries ask an open file for its name.

    def __init__(self, descriptor: int, owner: object) -> None:
        self._descriptor = descriptor
        self._owner = owner
        self._position = 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:
        if hasattr(os, "preadv"):
            count = os.preadv(self._descriptor, [buffer], self._position)
        else:
            # One position is shared here, as in Windows. So two threads may not read one file.
            os.lseek(self._descriptor, self._position, os.SEEK_SET)
            data = os.read(self._descriptor, len(buffer))
            count = len(data)
            buffer[:count] = data
        self._position += count
        return count

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        origins = (0, self._position, os.fstat(self._descriptor).st_size)
        self._position = offset + origins[whence]
        return self._position


def decompress(data: bytes, kind: str, max_bytes: int) -> bytes:
    """What "gzip" or "bzip2" bytes hold, never more than `max_bytes`.

    Raises InputError: the data are damaged, cut short, or hold more
    """
    import bz2

    decompressor = zlib.decompressobj(GZIP_OR_ZLIB) if kind == "gzip" else bz2.BZ2Decompressor()
    try:
        content = decompressor.decompress(data, max_bytes + 1)
    except (zlib.error, OSError, ValueError):
        text = f"its {kind} data are damaged. Copy or save the file again"
        raise InputError(text, code="compressed-data-damaged") from None
    if len(content) > max_bytes:
        text = f"unpacks to more than {max_bytes} bytes. Give a shorter file"
        raise InputError(text, code="unpacks-too-large", numbers={"max_bytes": max_bytes})
    if not decompressor.eof:
        text = f"its {kind} data are cut short. Copy or save the file again"
        raise InputError(text, code="compressed-data-cut")
    return content


def check_text_size(data: bytes) -> None:
    """Raise `ValueError` for text that is too long or has too long a line."""
    if len(data) > MAX_TEXT_BYTES:
        raise ValueError(f"{len(data)} bytes of text; at most {MAX_TEXT_BYTES} are read")
    start = 0
    while len(data) - start > MAX_LINE_BYTES:
        # The last line break within the next longest line; the search goes on behind it.
        end = data.rfind(b"\n", start, start + MAX_LINE_BYTES)
        if end < 0:
            raise ValueError(f"the line at byte {start} is longer than {MAX_LINE_BYTES} bytes")
        start = end + 1


def parse_decimal(text: str) -> float:
    """A decimal number, blanks around it allowed; raises `ValueError` for anything else.

    A number beyond the largest float64, 1.8e308, is refused as well.
    """
    match = _DECIMAL.fullmatch(text)
    if match is None:
        raise ValueError(f"{text[:40]!r} is no number" if text.strip() else "a number is missing")
    value = float(match[1])
    if math.isinf(value):
        raise ValueError(f"{text[:40]!r} is larger than a float64 holds, 1.8e308")
    return value


def parse_seconds(text: str) -> float:
    """A length of time, e.g. `90s`, `30min`, `12h` or `2d`, as seconds."""
    match = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?)(s|min|h|d)", text)
    seconds = float(match[1]) * SECONDS[match[2]] if match is not None else math.inf
    if not seconds < 1e9 * SECONDS["d"]:
        raise ValueError(f"{text!r} is no time. Type one like 90s, 30min, 12h or 2d")
    return seconds


def now_utc() -> str:
    """The time as ISO 8601 in whole seconds.

    The environment's SOURCE_DATE_EPOCH (reproducible-builds.org) takes the place of the clock.

    Raises InputError: SOURCE_DATE_EPOCH is no time
    """
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    if epoch is None:
        moment = datetime.now(UTC)
    elif epoch.isascii() and epoch.isdigit() and len(epoch) < 12:
        moment = datetime.fromtimestamp(int(epoch), UTC)
    else:
        text = f"the environment's SOURCE_DATE_EPOCH is {epoch!r}. Give whole seconds since 1970"
        raise InputError(text, code="epoch-invalid")
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def to_json_types(value: Any) -> Any:
    """The value in JSON's types: arrays as nested lists, NaN and infinities as `null`."""
    if isinstance(value, dict):
        return {str(k): to_json_types(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_json_types(v) for v in value]
    if hasattr(value, "tolist"):  # NumPy arrays and scalars, without importing NumPy here.
        return to_json_types(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


MIXED_DECIMALS = (
    "decimal commas and decimal points in one table: 1,234 may be 1.234 or 1234. Write all numbers "
    "alike"
)


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
    header: Names
    header_line: int
    rows: tuple[Row, ...]
    separator: str
    # The file, for messages.
    where: str
    kind: ErrorKind

    def number(self, row: Row, column: str, label: str = "") -> float:
        """The number in a cell.

        Raises the table's kind of error: no number, not finite, too large, or a comma that may be
        a decimal or a thousands separator
        """
        text = row.cells[column]
        what = " of ".join(filter(None, (column, label)))
        place = f"{self.where}, line {row.line}"
        if "," in text and self.separator != ",":
            if "." in text or text.count(",") > 1:
                raise self.kind(
                    f"{what} is {text!r}, whose comma may mean two things. Write a number as "
                    "1234.5 or as 1234,5",
                    where=place, code="decimal-ambiguous",
                )  # fmt: skip
            text = text.replace(",", ".")
        return parse_number(text, what, place, self.kind)

    def numbers(self, columns: Names, labels: Sequence[str] = ()) -> NDArray[np.float64]:
        """(N, K) the numbers in some columns; raises as `number` and `check_decimals`.

        labels: of the rows, for messages
        """
        import numpy as np  # Here and not above, because `vfplan COMMAND --help` needs none of it.

        self.check_decimals(columns)
        rows = zip_longest(self.rows, labels, fillvalue="")
        numbers = [[self.number(row, column, label) for column in columns] for row, label in rows]
        return np.array(numbers).reshape(-1, len(columns))

    def check_decimals(self, columns: Names) -> None:
        """Refuse a table whose numbers have decimal commas here and decimal points there."""
        with_mark = [
            [row.line for row in self.rows if any(mark in row.cells[name] for name in columns)]
            for mark in ",."
        ]
        if self.separator != "," and all(with_mark):
            place = f"{self.where}, line {max(lines[0] for lines in with_mark)}"
            raise self.kind(MIXED_DECIMALS, where=place, code="decimal-ambiguous")


def read_text(path: FilePath, max_bytes: int, kind: ErrorKind) -> tuple[str, str]:
    """A file's text and the SHA-256 of its bytes: UTF-8, or UTF-16 with a byte order mark."""
    data, sha256 = read_bytes(Path(path), max_bytes, kind)
    return decode_text(data, str(path), kind), sha256


def decode_text(data: bytes, where: str, kind: ErrorKind) -> str:
    """Bytes as text: UTF-8, or UTF-16 with a byte order mark; raises the kind of error given."""
    encoding = "utf-16" if data.startswith(UTF16_MARKS) else "utf-8-sig"
    try:
        return data.decode(encoding)
    except UnicodeDecodeError:
        text = "is not UTF-8 or UTF-16 text. Save it as CSV UTF-8"
        raise kind(text, where=where, code="not-text") from None


def parse_table(text: str, where: str, kind: ErrorKind) -> Table:
    """A table from text.

    Raises the kind of error given: no text, a separator that is not clear, a column twice, a row of
        another length
    """
    lines = text.splitlines()
    numbered = ((k, row) for k, row in enumerate(lines, 1) if row.strip() and not REMARK.match(row))
    number, header_line = next(numbered, (1, ""))
    separator = _separator_of(header_line, f"{where}, line {number}", kind)
    rows = split_rows(text, where, kind, separator)
    while rows and REMARK.match(rows[0][1][0]):
        del rows[0]
    if not rows:
        raise kind("is empty. Give a table with a header", where=where, code="table-empty")
    first_line, names = rows[0]
    header = tuple(name.strip() for name in without_blank_end(names, 1))
    folded = [name.casefold() for name in header]
    for name, key in zip(header, folded, strict=True):
        if key and folded.count(key) > 1:
            text = f"column {name!r} occurs {folded.count(key)} times. Leave one"
            raise kind(text, where=f"{where}, line {first_line}", code="column-doubled")
    table_rows = []
    for line, cells in rows[1:]:
        cells = without_blank_end(cells, len(header))
        # A label may begin like a remark; a row has as many cells as the header.
        if REMARK.match(cells[0]) and len(cells) != len(header):
            continue
        advice = "Give each row as many"
        if separator == "," and len(cells) > len(header):
            advice = "Put semicolons between the columns where numbers have a decimal comma"
        require_length(cells, header, f"{where}, line {line}", kind, advice)
        stripped = [cell.strip() for cell in cells]
        table_rows.append(Row(line, dict(zip(header, stripped, strict=True))))
    return Table(header, first_line, tuple(table_rows), separator, where, kind)


def without_blank_end(cells: list[str], count: int) -> list[str]:
    """The cells of a row without the blank ones at its end, of which `count` stay."""
    while len(cells) > count and not cells[-1].strip():
        cells = cells[:-1]
    return cells


def require_length(
    cells: list[str], header: Names, place: str, kind: ErrorKind,
    advice: str = "Give each row as many",
) -> None:  # fmt: skip
    """Raise the kind of error given for a row that has another number of cells than the header."""
    if len(cells) != len(header):
        raise kind(
            f"the row has {len(cells)} cells, and the header names {len(header)} columns. {advice}",
            where=place, code="row-length",
            numbers={"cells": len(cells), "columns": len(header)},
        )  # fmt: skip


def _separator_of(header_line: str, place: str, kind: ErrorKind) -> str:
    unquoted = re.sub('"[^"]*"', "", header_line)
    present = [separator for separator in SEPARATORS if separator in unquoted] or [","]
    if len(present) > 1:
        names = " and ".join(SEPARATORS[separator] for separator in present)
        text = (
            f"the header holds {names}: {header_line[:80]!r}. Separate the columns by one of them"
        )
        raise kind(text, where=place, code="separator-ambiguous")
    return present[0]


def split_rows(
    text: str, where: str, kind: ErrorKind, separator: str = ","
) -> list[tuple[int, list[str]]]:
    """The rows that hold anything, each with its line; LF, CRLF and CR end a line.

    Raises the kind of error given where the text is no table
    """
    reader = csv.reader(io.StringIO(text, newline=None), strict=True, delimiter=separator)
    try:
        return [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        text = f"is no CSV: {error}. Save the table again as CSV"
        raise kind(text, where=f"{where}, line {reader.line_num}", code="table-broken") from None


def parse_number(value: object, what: str, where: str | None, kind: ErrorKind) -> float:
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
        is_infinite = str(value).strip().lower().lstrip("+-") in ("nan", "inf", "infinity")
        wanted = "a finite number" if is_infinite else "a number"
        raise kind(f"{what} is {repr(value)[:60]}. Give {wanted}", where=where, code="no-number")
    if abs(number) > MAX_NUMBER:
        text = f"{what} is {value!r}. Give at most {MAX_NUMBER:g}"
        raise kind(text, where=where, code="number-too-large")
    return number


@dataclass(frozen=True)
class NumberTable:
    """A table of numbers that is read block by block, each time `blocks` is called."""

    # Opens the file at its first byte.
    open_stream: Callable[[], BinaryIO]
    # The file, for messages, and the class of its errors.
    where: str
    kind: ErrorKind
    # Column names in lower case, without surrounding blanks.
    columns: Names
    separator: str
    # Lines above the first row of numbers.
    header_lines: int

    def blocks(self, columns: Names) -> Iterator[NDArray[np.float64]]:
        """Yield some rows at a time, (n, len(columns)).

        What the other columns hold does not matter. Raises the table's kind of error: a line too
            long, another number of cells than columns, a cell that is no number, a decimal comma in
            one place and a decimal point in another
        """
        indices = [self.columns.index(column) for column in columns]
        marks = set()
        with self.open_stream() as stream:
            for _ in range(self.header_lines):
                stream.readline(MAX_LINE_BYTES + 1)
            line = self.header_lines + 1
            unfinished = b""
            while piece := stream.read(BLOCK_BYTES):
                complete, newline, unfinished = (unfinished + piece).rpartition(b"\n")
                if newline:
                    yield parse_block(self, complete, line, marks, indices)
                    line += complete.count(b"\n") + 1
                require_line(unfinished, f"{self.where}, line {line}", self.kind)
            if unfinished.strip():
                yield parse_block(self, unfinished, line, marks, indices)


def named_columns(table: NumberTable, units: str) -> Names:
    """The columns x, y and z, whose names may end in a known unit: x_mm or x [mm].

    Raises the table's kind of error: an axis without a column, or with two; a unit that is not
        `units`
    """
    chosen = []
    for axis in "xyz":
        units_of = {}
        for column in table.columns:
            name, _, unit = re.sub(r"[\s_\[\]()]+", "_", column).strip("_").partition("_")
            if name == axis and unit in ("", "px", *METRES):
                units_of[column] = unit
        header = ",".join(table.columns)[:80]
        if not units_of:
            raise table.kind(
                f"The header {header!r} names no {axis}. Name the columns of the coordinates x, y "
                "and z.",
                where=table.where, code="column-missing",
            )  # fmt: skip
        if sum(map(table.columns.count, units_of)) > 1:
            raise table.kind(
                f"The header {header!r} names {axis} more than once. Leave one.",
                where=table.where, code="column-doubled",
            )  # fmt: skip
        ((column, unit),) = units_of.items()
        chosen.append(column)
        if unit not in ("", units):
            raise table.kind(
                f"The header names {column}, and {units} was given as the unit. "
                f"{other_unit(unit)}, or name the column by its true unit.",
                where=table.where, code="units-differ",
            )  # fmt: skip
    return tuple(chosen)


def other_unit(unit: str) -> str:
    """What to do where a file has another unit than was said."""
    return "Register the curve first" if unit == "px" else f"Give --units {unit}"


def require_line(line: bytes, place: str, kind: ErrorKind) -> None:
    """Raise the kind of error given for a line that is longer than any program writes."""
    if len(line) > MAX_LINE_BYTES:
        text = f"the line is longer than {MAX_LINE_BYTES} bytes. Give a table of shorter rows"
        raise kind(text, where=place, code="line-too-long")


def open_number_table(
    open_stream: Callable[[], BinaryIO], where: str, kind: ErrorKind,
    wanted: Names = (), *, header_optional: bool = False,
) -> NumberTable:  # fmt: skip
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
    line, first = 0, b"\n"
    open_stream = partial(_utf8_stream, open_stream)
    with open_stream() as stream:
        # Without a header a remark may be one that was meant: it names columns and their units.
        while first and (not first.strip() or (not header_optional and is_remark(first))):
            first = stream.readline(MAX_LINE_BYTES + 1)
            line += 1
    place = f"{where}, line {line}"
    if not first:
        text = f"is empty. Give a table with a header {listed}".rstrip()
        raise kind(text, where=where, code="table-empty")
    require_line(first, place, kind)
    try:
        header = first.decode("utf-8-sig").strip("\r\n")
    except UnicodeDecodeError:
        text = "is not UTF-8 text. Save it as CSV UTF-8"
        raise kind(text, where=where, code="not-text") from None
    separator = _separator_of(header, place, kind)
    columns = [name.strip().lower() for name in split_line(header, separator, place, kind)]
    if len(columns) > MAX_COLUMNS:
        raise kind(
            f"has {len(columns)} columns. Leave at most {MAX_COLUMNS}",
            where=where, code="too-many-columns", numbers={"columns": len(columns)},
        )  # fmt: skip
    columns = without_blank_end(columns, 1)
    if header_optional:
        with suppress(ValueError):
            parse_decimal(columns[0].replace(",", "."))
            columns = [f"column {i + 1}" for i in range(len(columns))]
            line -= 1
    for column in wanted:
        count = columns.count(column)
        if count == 0:
            text = f"column {column!r} is missing from the header {header[:70]!r}. Give {listed}"
            raise kind(text, where=place, code="column-missing")
        if count > 1:
            text = f"column {column!r} occurs {count} times. Leave one"
            raise kind(text, where=place, code="column-doubled")
    return NumberTable(open_stream, where, kind, tuple(columns), separator, line)


def is_remark(line: bytes) -> bool:
    """Whether a line of a table is no row."""
    return REMARK.match(line.decode("utf-8", "replace")) is not None


def _utf8_stream(open_stream: Callable[[], BinaryIO]) -> BinaryIO:
    """An open file of text as UTF-8; UTF-16 is known by its mark."""
    stream = open_stream()
    is_utf16 = stream.read(2) in UTF16_MARKS
    stream.seek(0)
    if is_utf16:
        return cast("BinaryIO", codecs.EncodedFile(stream, "utf-8", "utf-16", "replace"))
    return stream


def parse_block(
    table: NumberTable, text: bytes, line: int, marks: set[bytes], indices: list[int]
) -> NDArray[np.float64]:
    """(n, len(indices)) numbers of lines, the first of which has the number `line`.

    marks: the decimal marks that the table has used so far
    """
    import numpy as np  # Here and not above, because `vfplan COMMAND --help` needs none of it.

    # A carriage return that stands elsewhere than before a newline makes its line a bad one.
    body = (text + b"\n").replace(b"\r\n", b"\n").rstrip(b"\n")
    if body and not body.translate(None, _NUMERIC_BYTES + table.separator.encode()):
        plain = body if table.separator == "," else body.replace(b",", b".")
        in_body = {mark for mark in (b",", b".") if mark in body}
        if table.separator == "," or len(marks | in_body) < 2:
            with suppress(ValueError):
                file = io.BytesIO(plain)
                values = np.loadtxt(file, delimiter=table.separator, comments=None, ndmin=2)
                if values.shape[1] == len(table.columns):
                    marks |= in_body
                    return values[:, indices]
    # Parse line by line: slower, passes over blank lines, and names the first bad line.
    rows = [
        parse_line(table, row, number, marks, indices)
        for number, row in enumerate(body.decode("utf-8", "replace").split("\n"), start=line)
        if row.strip() and not REMARK.match(row)
    ]
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(indices))


def split_line(text: str, separator: str, place: str, kind: ErrorKind) -> list[str]:
    """The cells of one line, of which some may be quoted."""
    if '"' not in text:
        return text.split(separator)
    try:
        return next(csv.reader([text], delimiter=separator, strict=True))
    except csv.Error as error:
        message = f"is no CSV: {error}. Save the table again as CSV"
        raise kind(message, where=place, code="table-broken") from None


def parse_line(
    table: NumberTable, text: str, line: int, marks: set[bytes], indices: list[int]
) -> list[float]:
    """The wanted numbers of one line; raises the table's kind of error for the first bad one."""
    place = f"{table.where}, line {line}"
    cells = split_line(text, table.separator, place, table.kind)
    cells = without_blank_end(cells, len(table.columns))
    require_length(cells, table.columns, place, table.kind)
    row = []
    for i in indices:
        cell = cells[i]
        if table.separator != ",":
            marks.update(mark for mark in (b",", b".") if mark.decode() in cell)
            if len(marks) == 2:
                raise table.kind(MIXED_DECIMALS, where=place, code="decimal-ambiguous")
            cell = cell.replace(",", ".")
        try:
            row.append(parse_decimal(cell))
        except ValueError as error:
            reason = f"column {table.columns[i]!r} cannot be used: {error}. Correct the row"
            raise table.kind(reason, where=place, code="no-number") from None
    return row
