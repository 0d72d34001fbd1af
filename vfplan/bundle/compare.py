"""What differs between two bundles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from vfplan.bundle.read import read_bundle
from vfplan.bundle.table import table


def diff(a: str | Path, b: str | Path) -> list[dict[str, Any]]:
    """Differences between the contents of two bundles, in the order of the format's table.

    Each has `path` and `what` ("only in A", "only in B", "shape" or "value"); values that differ
    are given as `a` and `b`, tables by `count`, `first_index` and, if numbers, `max_abs`.

    Raises as `read_fixture` does.
    """
    one, other = read_bundle(a)[0], read_bundle(b)[0]
    differences = []
    for row in table().rows:
        if (row.path in one) != (row.path in other):
            side = "A" if row.path in one else "B"
            differences.append({"path": row.path, "what": f"only in {side}"})
        elif row.path in one:
            found = _difference(one[row.path], other[row.path])
            differences += [{"path": row.path, **found}] if found else []
    return differences


def _difference(a: Any, b: Any) -> dict[str, Any] | None:
    if isinstance(a, (str, int, float)):
        return None if a == b else {"what": "value", "a": a, "b": b}
    a, b = np.asarray(a), np.asarray(b)
    if a.shape != b.shape:
        return {"what": "shape", "a": list(a.shape), "b": list(b.shape)}
    differ = a != b
    if not differ.any():
        return None
    found = {"what": "value", "count": int(differ.sum())}
    found["first_index"] = [int(i) for i in np.argwhere(differ)[0]]
    if a.dtype.kind != "U":
        found["max_abs"] = float(np.max(np.abs(a.astype(float) - b.astype(float))))
    return found


def first_tick(a: np.ndarray, b: np.ndarray) -> tuple[int | None, float]:
    """(first row in which two (T, 3) series differ, or `None`; largest distance of two rows)."""
    apart = np.linalg.norm(a - b, axis=1)
    rows = np.flatnonzero(np.any(a != b, axis=1))
    return (int(rows[0]) if len(rows) else None), float(apart.max(initial=0.0))
