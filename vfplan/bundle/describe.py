"""What `vfplan info` shows of a bundle."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.bundle.content import Content, from_content
from vfplan.bundle.read import read_bundle
from vfplan.bundle.table import Row, table
from vfplan.engine.work import MOST_TICK_WORK, work_of
from vfplan.errors import VfplanError


def describe(path: str | Path, *, values: bool = False, work: bool = False) -> dict[str, Any]:
    """Head, seal, and every attribute and table of a bundle by its path in the format.

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
    }
    if work and "/rendering/stiffness" in content:
        described["tick_work"] = _work(content)
    for row in table().rows:
        if row.path in content:
            described[row.path] = _shown(content[row.path], row, values)
    return described


def _work(content: Content) -> dict[str, float | None]:
    """How long a tick may take, and what 1 kHz gives it [us]; `None` where no engine renders it."""
    try:
        work = 1e6 * work_of(from_content(content))
    except VfplanError:
        work = None
    return {"us": work, "at_most_us": 1e6 * MOST_TICK_WORK}


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
