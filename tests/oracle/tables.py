"""Frozen tables: a row of a dataclass a line of CSV, below comments that say how to renew it."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import astuple, fields
from typing import Any


def table_text(comments: Iterable[str], rows: Iterable[Any], row_type: type, digits: int) -> str:
    """The text of a table; numbers that are not whole have that many digits."""
    out = io.StringIO()
    for comment in comments:
        out.write(f"# {comment}\n")
    table = csv.writer(out, lineterminator="\n")
    table.writerow([field.name for field in fields(row_type)])
    for row in rows:
        cells = []
        for value in astuple(row):
            cells.append(f"{value:.{digits}f}" if isinstance(value, float) else value)
        table.writerow(cells)
    return out.getvalue()


def table_rows(text: str, row_type: type) -> list[Any]:
    """The rows of a table, each cell of its field's type."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    readers = {"int": int, "float": float, "str": str}
    rows = []
    for cells in csv.DictReader(lines):
        values = {}
        for field in fields(row_type):
            values[field.name] = readers[str(field.type)](cells[field.name])
        rows.append(row_type(**values))
    return rows
