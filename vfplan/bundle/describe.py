"""What `vfplan info` shows of a bundle, and what `vfplan diff` shows of two."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.bundle.content import findings_of, from_content
from vfplan.bundle.read import read_bundle
from vfplan.bundle.schema import Content, Row, table
from vfplan.engine.renderable import MOST_TICK_WORK, best_rule, work_of
from vfplan.errors import VfplanError


def describe(path: str | Path, *, values: bool = False, work: bool = False) -> dict[str, Any]:
    """Head, seal, findings, and every attribute and table of a bundle by its path in the format.

    Tables with a row for each point or triangle are summed up as `shape`, `min`, `max` and the
    SHA-256 of their little-endian bytes, with `values` as well if wanted; all others are plain.
    With `work`, `tick_work` bounds what a tick of the engine may take.

    Raises as `read_fixture` does.
    """
    content, seal = read_bundle(path)
    described: dict[str, Any] = {
        "format": content["/@format"],
        "version": content["/@version"],
        "frame": content["/@frame"],
        "points": len(content["/points"]),
        "seal": seal.describe(),
        "findings": [finding.as_dict() for finding in findings_of(content)],
        "reviewed": review_of(content),
    }
    if work and "/rendering/stiffness" in content:
        described["tick_work"] = _work(content)
    for row in table():
        if row.path in content:
            described[row.path] = _shown(content[row.path], row, values)
    return described


def review_of(content: Content) -> dict[str, str] | None:
    """Who reviewed the plan, when, and the digest of what was shown; `None` where nobody did."""
    if "/review@by" not in content:
        return None
    return {name: content[f"/review@{name}"] for name in ("by", "utc", "digest")}


def _work(content: Content) -> dict[str, Any]:
    """The rule it is rendered by unless another is asked for, how long a tick may take, and what
    1 kHz gives it [us]; `None` where no engine renders it.
    """
    try:
        fixture = from_content(content)
        rule = best_rule(fixture)
        work = 1e6 * work_of(fixture, rule)
    except VfplanError:
        rule = work = None
    return {"rule": rule, "us": work, "at_most_us": 1e6 * MOST_TICK_WORK}


def _shown(value: Any, row: Row, values: bool) -> Any:
    if not {"N", "K"} & set(row.shape):
        return list(value) if isinstance(value, tuple) else value
    data = np.ascontiguousarray(value)
    shown = {
        "shape": list(data.shape),
        "min": data.min().item(),
        "max": data.max().item(),
        "sha256": hashlib.sha256(data.data).hexdigest(),
    }
    return shown | {"values": data.tolist()} if values else shown


def diff(a: str | Path, b: str | Path) -> list[dict[str, Any]]:
    """Differences between the contents of two bundles, in the order of the format's table.

    Each has `path` and `what` ("only in A", "only in B", "shape" or "value"); values that differ
    are given as `a` and `b`, tables by `count`, `first_index` and, if numbers, `max_abs`.

    Raises as `read_fixture` does.
    """
    one, other = read_bundle(a)[0], read_bundle(b)[0]
    differences = []
    for row in table():
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
