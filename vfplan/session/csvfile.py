"""Sessions as CSV: a header that names `t`, `x`, `y` and `z`, then one sample a line."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import BinaryIO, NoReturn

import numpy as np

from vfplan.errors import SessionError
from vfplan.io.files import real
from vfplan.io.reading import MOST_COLUMNS, MOST_LINE, OneFile
from vfplan.session.types import Array, Pair

WANTED = ("t", "x", "y", "z")
_PIECE = 1 << 21  # bytes read at a time
# All that a plain table is made of; nan and inf are read, and refused as samples.
_PLAIN = b"0123456789+-.eE, \t\nnaifNAIF"


def csv_columns(file: BinaryIO, name: str, wanted: tuple[str, ...] = WANTED) -> list[str]:
    """The names in the header line.

    Raises SessionError: an empty file, text that is not UTF-8, a line too long, too many columns, a
        wanted column missing or named twice
    """
    line = file.readline(MOST_LINE + 1)
    if not line.strip():
        raise SessionError(f"is empty; a header {','.join(wanted)} and rows wanted", where=name)
    if len(line) > MOST_LINE:
        raise SessionError(f"its first line is longer than {MOST_LINE} bytes", where=name)
    try:
        names = [column.strip().lower() for column in line.decode("utf-8-sig").split(",")]
    except UnicodeDecodeError:
        text = f"is not text; a CSV with header {','.join(wanted)} wanted"
        raise SessionError(text, where=name) from None
    if len(names) > MOST_COLUMNS:
        raise SessionError(f"has {len(names)} columns; at most {MOST_COLUMNS} are read", where=name)
    for column in wanted:
        if names.count(column) != 1:
            raise SessionError(
                f"column {column!r} occurs {names.count(column)} times in the header "
                f"{','.join(names)[:80]!r}; {', '.join(wanted)} (s, m) wanted, once each",
                where=name,
            )
    return names


def read_csv(
    file: OneFile, name: str, factor: float, wanted: tuple[str, ...] = WANTED
) -> Iterator[Pair]:
    """Yield (time [s], hip [m]) piece by piece; `factor` turns the file's lengths into metres.

    With other columns `wanted`, the first of them and the rest.
    """
    with file.view() as stream:
        names = csv_columns(stream, name, wanted)
        picks = [names.index(column) for column in wanted]
        line = 2
        rest = b""
        while piece := stream.read(_PIECE):
            text, newline, rest = (rest + piece).rpartition(b"\n")
            if newline:
                rows = _parse(text, names, name, line)
                line += text.count(b"\n") + 1
                yield rows[:, picks[0]].copy(), rows[:, picks[1:]] * factor
            if len(rest) > MOST_LINE:
                _refuse(f"the line is longer than {MOST_LINE} bytes", name, line)
        if rest.strip():
            rows = _parse(rest, names, name, line)
            yield rows[:, picks[0]].copy(), rows[:, picks[1:]] * factor


def _parse(text: bytes, names: list[str], name: str, line: int) -> Array:
    """(n, columns) numbers; a block that is not plain is read again line by line."""
    # A carriage return elsewhere than before a newline stays, and makes its line a bad one.
    body = (text + b"\n").replace(b"\r\n", b"\n").rstrip(b"\n")
    if body and not body.translate(None, _PLAIN):
        try:
            values = np.loadtxt(io.BytesIO(body), delimiter=",", comments=None, ndmin=2)
        except ValueError:
            pass
        else:
            if values.shape[1] == len(names):
                return values
    return _parse_slowly(body, names, name, line)


def _parse_slowly(body: bytes, names: list[str], name: str, line: int) -> Array:
    """Line by line, blank lines passed over; raises `SessionError` at the first bad one."""
    rows = []
    for number, raw in enumerate(body.split(b"\n"), start=line):
        text = raw.decode("utf-8", "replace")
        if not text.strip():
            continue
        fields = text.split(",")
        if len(fields) != len(names):
            _refuse(f"{len(fields)} fields; {len(names)} wanted", name, number)
        rows.append(
            [_number(*pair, text, name, number) for pair in zip(names, fields, strict=True)]
        )
    return np.array(rows, dtype=np.float64).reshape(-1, len(names))


def _number(column: str, field: str, text: str, name: str, number: int) -> float:
    try:
        return real(field)
    except ValueError as error:
        wanted = f"{text[:60]!r} is not {text.count(',') + 1} numbers"
        _refuse(f"{wanted}: in column {column!r} {error}", name, number)


def _refuse(message: str, name: str, number: int) -> NoReturn:
    raise SessionError(message, where=f"{name}, line {number}")
