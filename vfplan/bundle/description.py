"""What `vfplan info` shows of a bundle, and what `vfplan diff` shows of two."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.bundle.content import findings_of, from_content
from vfplan.bundle.read import read_bundle
from vfplan.bundle.schema import Content, Row, table
from vfplan.engine.choosing import MAX_TICK_TIME, best_rule, worst_tick_time
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
        described["tick_work"] = tick_work(content)
    for row in table():
        if row.path in content:
            described[row.path] = summary(content[row.path], row, values)
    return described


def review_of(content: Content) -> dict[str, str] | None:
    """Who reviewed the plan, when, and the digest of what was shown; `None` where nobody did."""
    if "/review@by" not in content:
        return None
    return {name: content[f"/review@{name}"] for name in ("by", "utc", "digest")}


def tick_work(content: Content) -> dict[str, Any]:
    """The rule that renders the fixture unless another is named, and the time of its ticks.

    `us` bounds a tick and `at_most_us` is what 1 kHz gives it [us]; rule and bound are `None` where
    no engine renders the fixture.
    """
    rule = None
    time_us = None
    try:
        fixture = from_content(content)
        rule = best_rule(fixture)
        time_us = 1e6 * worst_tick_time(fixture, rule)
    except VfplanError:
        rule = None
    return {"rule": rule, "us": time_us, "at_most_us": 1e6 * MAX_TICK_TIME}


def summary(value: Any, row: Row, values: bool) -> Any:
    """A value as it is; of a table with a row for each point or triangle a summary."""
    if "N" not in row.shape and "K" not in row.shape:
        return list(value) if isinstance(value, tuple) else value
    data = np.ascontiguousarray(value)
    described = {
        "shape": list(data.shape),
        "min": data.min().item(),
        "max": data.max().item(),
        "sha256": hashlib.sha256(data.data).hexdigest(),
    }
    if values:
        described["values"] = data.tolist()
    return described


def diff(a: str | Path, b: str | Path) -> list[dict[str, Any]]:
    """Differences between the contents of two bundles, in the order of the format's table.

    Each has `path` and `what` ("only in A", "only in B", "shape" or "value"); values that differ
    are given as `a` and `b`, tables by `count`, `first_index` and, if numbers, `max_abs`.

    Raises as `read_fixture` does.
    """
    content_a = read_bundle(a)[0]
    content_b = read_bundle(b)[0]
    differences = []
    for row in table():
        if row.path in content_a and row.path not in content_b:
            differences.append({"path": row.path, "what": "only in A"})
        elif row.path in content_b and row.path not in content_a:
            differences.append({"path": row.path, "what": "only in B"})
        elif row.path in content_a:
            difference = difference_of(content_a[row.path], content_b[row.path])
            if difference is not None:
                differences.append({"path": row.path, **difference})
    return differences


def difference_of(a: Any, b: Any) -> dict[str, Any] | None:
    """What differs between two values of one path; `None` if nothing does."""
    if isinstance(a, (str, int, float)):
        return None if a == b else {"what": "value", "a": a, "b": b}
    a = np.asarray(a)
    b = np.asarray(b)
    if a.shape != b.shape:
        return {"what": "shape", "a": list(a.shape), "b": list(b.shape)}
    differs = a != b
    if not differs.any():
        return None
    difference = {
        "what": "value",
        "count": int(differs.sum()),
        "first_index": np.argwhere(differs)[0].tolist(),
    }
    if a.dtype.kind != "U":
        difference["max_abs"] = float(np.max(np.abs(a.astype(float) - b.astype(float))))
    return difference
