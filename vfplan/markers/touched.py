"""Points that a robot touched on a surface: CSV with the columns x_m, y_m, z_m."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import MarkerError
from vfplan.io.reading import read_whole
from vfplan.markers.points import number, table_rows
from vfplan.markers.table import ROBOT

MAX_BYTES = 16 * 2**20
KNOWN = {*ROBOT, "label", "t"}


def read_touched(path: str | Path) -> NDArray[np.float64]:
    """(T, 3) places [m] in the robot's frame; columns `label` and `t` may stand beside them.

    Raises MarkerError: the file cannot be read, has other columns, or holds a value that is not a
        finite number
    """
    where = str(path)
    try:
        text = read_whole(Path(path), MAX_BYTES, MarkerError).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise MarkerError("is not UTF-8 text", where=where) from None
    header, *rows = table_rows(text, where) or [[]]
    names = [name.strip().lower() for name in header]
    if not set(ROBOT) <= set(names) <= KNOWN or len(set(names)) != len(names):
        shown = ",".join(names)[:80]
        raise MarkerError(f"its columns are {shown!r}; {','.join(ROBOT)} is wanted", where=where)
    columns = [names.index(name) for name in ROBOT]
    for i, row in enumerate(rows, start=2):
        if len(row) != len(names):
            raise MarkerError(f"{len(row)} cells; {len(names)} wanted", where=f"{where}, row {i}")
    return np.array(
        [
            [number(row[c].strip(), names[c], f"{where}, row {i}") for c in columns]
            for i, row in enumerate(rows, start=2)
        ]
    ).reshape(-1, 3)
