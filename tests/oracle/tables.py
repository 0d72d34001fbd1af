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
    out.writelines(f"# {comment}\n" for comment in comments)
    table = csv.writer(out, lineterminator="\n")
    table.writerow([field.name for field in fields(row_type)])
    for row in rows:
        values = astuple(row)
        table.writerow(f"{v:.{digits}f}" if isinstance(v, float) else v for v in values)
    return out.getvalue()


def table_rows(text: str, row_type: type) -> list[Any]:
    """The rows of a table, each cell of its field's type."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    readers = {"int": int, "float": float, "str": str}
    kinds = {field.name: readers[str(field.type)] for field in fields(row_type)}
    table = csv.DictReader(lines)
    return [row_type(**{name: kinds[name](cell) for name, cell in row.items()}) for row in table]
