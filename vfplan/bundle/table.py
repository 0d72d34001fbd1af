"""The table of everything a bundle may hold, read from `schemas/bundle-1.1.json`.

Reader, writer and validator ask this table; nothing about paths, types, shapes, units or ranges
is written down a second time in Python.
"""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass
from importlib import resources
from typing import Any, Literal

Kind = Literal["group", "dataset", "attribute"]
UNITS_OF_FRAME = {"image": "px", "robot_base": "m", "patient_lps": "m"}


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
        holder, _, _ = self.path.partition("@")
        if self.kind == "attribute":
            return holder
        return holder.rpartition("/")[0] or "/"

    @property
    def name(self) -> str:
        """The last part of the path."""
        return self.path.rpartition("@" if self.kind == "attribute" else "/")[2]


@dataclass(frozen=True)
class Table:
    """Every row of one version of the format, with its limits."""

    version: str
    rows: tuple[Row, ...]
    sizes: dict[str, int]
    limits: dict[str, int]

    def of(self, kind: Kind, parent: str | None = None) -> list[Row]:
        """Rows of a kind, of one group if `parent` is given."""
        return [r for r in self.rows if r.kind == kind and parent in (None, r.parent)]

    def children(self, group: str) -> dict[str, Row]:
        """Links a group may hold: name -> row."""
        return {
            r.name: r
            for r in self.rows
            if r.kind != "attribute" and r.parent == group and r.path != "/"
        }


def _row(entry: dict[str, Any]) -> Row:
    entry = dict(entry)
    for name in ("shape", "allowed"):
        if name in entry:
            entry[name] = tuple(entry[name])
    return Row(**entry)


@functools.cache
def document() -> dict[str, Any]:
    """The whole of `bundle-1.1.json`."""
    text = resources.files("vfplan.schemas").joinpath("bundle-1.1.json").read_text("utf-8")
    return json.loads(text)


@functools.cache
def table(version: str = "1.1") -> Table:
    """The table of a version, "0.1", "1.0" or "1.1": the rows that existed then."""
    data = document()
    rows = tuple(_row(entry) for entry in data["rows"] if entry["since"] <= version)
    sizes = {symbol: entry["max"] for symbol, entry in data["sizes"].items()}
    return Table(version, rows, sizes, data["limits"])
