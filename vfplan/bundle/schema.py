"""The format's table: what a bundle may hold, read from `schemas/bundle-2.0.json`.

The writer, the validator and `info` ask this table; nothing about paths, types, shapes or units is
written down a second time in Python.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

Content = dict[str, Any]
"""Path -> value: text (`str`), `int`, `float`, a NumPy array, or a tuple of texts."""

Kind = Literal["group", "dataset", "attribute"]
FORMAT = "vfplan-fixture"
VERSION = "2.0"
OLDER = "1.1"
"""The newest version that only `migrate` reads; its table covers those before it as well."""


@dataclass(frozen=True)
class Row:
    """One thing a bundle may hold.

    Parameters
    ----------
    path
        "/group/name", or "/group@name" for an attribute.
    kind, type, shape
        What it is; `shape` mixes numbers and the size symbols of the table.
    unit, frame
        As written in the file's own `unit` and `frame` attributes; "@frame" and "@source_frame"
        stand for the frame that attribute names (for a unit: px in "image", else m).
    required
        "always", "group" (whenever its group is there), "rendering" (whenever `/rendering` is
        there) or "optional".
    since
        The first version that has it.
    """

    path: str
    kind: Kind
    required: str
    since: str
    meaning: str
    type: str = ""
    shape: tuple[int | str, ...] = ()
    unit: str | None = None
    frame: str | None = None
    allowed: tuple[str, ...] | None = None
    min: float | None = None
    max: float | None = None
    above: float | None = None
    max_abs: dict[str, float] | None = None

    @property
    def parent(self) -> str:
        """The group that holds it."""
        if self.kind == "attribute":
            return self.path.partition("@")[0]
        parent = self.path.rpartition("/")[0]
        return "/" if parent == "" else parent

    @property
    def name(self) -> str:
        """The last part of the path."""
        separator = "@" if self.kind == "attribute" else "/"
        return self.path.rpartition(separator)[2]


@cache
def document(version: str = VERSION) -> dict[str, Any]:
    """The whole of `bundle-VERSION.json`."""
    file = Path(__file__).parents[1] / "schemas" / f"bundle-{version}.json"
    return json.loads(file.read_text("utf-8"))


@cache
def table(version: str = VERSION) -> tuple[Row, ...]:
    """Everything a bundle may hold, in the order of the format."""
    rows = []
    for entry in document(version)["rows"]:
        fields = dict(entry)
        for name in ("shape", "allowed"):
            if name in fields:
                fields[name] = tuple(fields[name])
        rows.append(Row(**fields))
    return tuple(rows)


@cache
def rows_by_path() -> dict[str, Row]:
    """Path -> its row of the table."""
    return {row.path: row for row in table()}


def max_size(symbol: str) -> int:
    """The largest size that a symbol of the shapes stands for."""
    return document()["sizes"][symbol]["max"]


def max_number(path: str) -> float:
    """The largest number that a bundle may hold at a path."""
    largest = rows_by_path()[path].max
    return math.inf if largest is None else float(largest)


def max_payload_bytes() -> int:
    """The largest payload of a bundle [bytes]."""
    return document()["limits"]["payload_bytes"]
