"""Sessions as CSV: a header that names `t`, `x`, `y` and `z`, then one sample a line."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import numpy as np

from vfplan.errors import SessionError
from vfplan.session.types import Array, Pair

WANTED = ("t", "x", "y", "z")
_PIECE = 1 << 21  # bytes read at a time
_COMMA, _NEWLINE = 44, 10


def csv_columns(path: Path) -> list[str]:
    """The names in the header line.

    Raises
    ------
    SessionError
        An empty file, text that is not UTF-8, a wanted column missing or named twice.
    """
    with path.open("rb") as file:
        line = file.readline(65536)
    if not line.strip():
        raise SessionError("is empty; a header t,x,y,z and samples wanted", where=path.name)
    try:
        names = [name.strip().lower() for name in line.decode("utf-8-sig").split(",")]
    except UnicodeDecodeError:
        raise SessionError(
            "is not text; a CSV with header t,x,y,z wanted", where=path.name
        ) from None
    for name in WANTED:
        if names.count(name) != 1:
            raise SessionError(
                f"column {name!r} occurs {names.count(name)} times in the header "
                f"{','.join(names)[:80]!r}; t (s), x, y, z (m) wanted, once each",
                where=path.name,
            )
    return names


def read_csv(path: Path, factor: float) -> Iterator[Pair]:
    """Yield (time [s], hip [m]) piece by piece; `factor` turns the file's lengths into metres."""
    names = csv_columns(path)
    picks = [names.index(name) for name in WANTED]
    with path.open("rb") as file:
        file.readline()
        line = 2
        rest = b""
        while piece := file.read(_PIECE):
            text, newline, rest = (rest + piece).rpartition(b"\n")
            if newline:
                rows = _parse(text, len(names), path.name, line)
                line += text.count(b"\n") + 1
                yield rows[:, picks[0]].copy(), rows[:, picks[1:]] * factor
        if rest.strip():
            rows = _parse(rest, len(names), path.name, line)
            yield rows[:, picks[0]].copy(), rows[:, picks[1:]] * factor


def _parse(text: bytes, columns: int, name: str, line: int) -> Array:
    """(n, columns) numbers; a block that is not plain is read again line by line."""
    # A carriage return elsewhere than before a newline stays, and makes its line a bad one.
    body = (text + b"\n").replace(b"\r\n", b"\n").rstrip(b"\n")
    if _plain(body, columns):
        with warnings.catch_warnings():
            # NumPy tells of text it could not read by a DeprecationWarning.
            warnings.simplefilter("error")
            try:
                values = np.fromstring(body.replace(b"\n", b",").decode("ascii"), sep=",")
                return values.reshape(-1, columns)
            except (DeprecationWarning, ValueError):
                pass
    return _parse_slowly(body, columns, name, line)


def _plain(body: bytes, columns: int) -> bool:
    """Whether every line has `columns` fields and none of them is empty."""
    marks = np.frombuffer(body, np.uint8)
    at = np.flatnonzero((marks == _COMMA) | (marks == _NEWLINE))
    if len(at) % columns != columns - 1 or (np.diff(at, prepend=-1, append=len(marks)) < 2).any():
        return False
    wanted = np.full(columns, _COMMA, np.uint8)
    wanted[-1] = _NEWLINE
    return bool((marks[at] == np.resize(wanted, len(at))).all())


def _parse_slowly(body: bytes, columns: int, name: str, line: int) -> Array:
    """Line by line, blank lines passed over; raises `SessionError` at the first bad one."""
    rows = []
    for number, text in enumerate(body.split(b"\n"), start=line):
        if not text.strip():
            continue
        fields = text.split(b",")
        if len(fields) != columns:
            _refuse(f"{len(fields)} fields; {columns} wanted", name, number)
        try:
            if b"_" in text:  # Python's own notation for long numbers, not a CSV's
                raise ValueError
            rows.append([float(field) for field in fields])
        except ValueError:
            shown = text[:60].decode("utf-8", "replace")
            _refuse(f"{shown!r} is not {columns} numbers", name, number)
    return np.array(rows, dtype=np.float64).reshape(-1, columns)


def _refuse(message: str, name: str, number: int) -> NoReturn:
    raise SessionError(message, where=f"{name}, line {number}")
