"""Two replays of the same ticks: where they part, and by how much."""

from __future__ import annotations

from typing import Any

import numpy as np

from vfplan.replaying.quantities import row_norms
from vfplan.session import TickBlock

# Proxies farther apart than this [m] have parted; below it rules differ by their bands alone.
PART_M = 5e-5
LISTED = 50


class Apart:
    """Compare two runs block by block."""

    def __init__(self) -> None:
        self._ticks = 0
        self._differ: int | None = None
        self._count = 0
        self._proxy = (0.0, 0)
        self._force = (0.0, 0)
        self._force2 = 0.0
        self._spans: list[dict[str, Any]] = []

    def update(self, a: TickBlock, b: TickBlock) -> None:
        """Take in the same ticks of both runs."""
        gap = row_norms(a.proxy - b.proxy)
        force = row_norms(a.force - b.force)
        first = self._ticks
        self._ticks += len(a)
        differ = np.flatnonzero(((a.proxy != b.proxy) | (a.force != b.force)).any(axis=1))
        if self._differ is None and len(differ):
            self._differ = first + int(differ[0])
        self._proxy = max(self._proxy, (float(gap.max()), -first - int(gap.argmax())))
        self._force = max(self._force, (float(force.max()), -first - int(force.argmax())))
        self._force2 += float((force**2).sum())
        apart = gap > PART_M
        self._count += int(np.count_nonzero(apart))
        edges = np.flatnonzero(np.diff(apart.astype(np.int8), prepend=0, append=0))
        for start, end in edges.reshape(-1, 2).tolist():
            span = {
                "start_tick": first + start,
                "end_tick": first + end - 1,
                "start_s": float(a.time[start]),
                "end_s": float(a.time[end - 1]),
                "proxy_max_m": float(gap[start:end].max()),
            }
            if self._spans and self._spans[-1]["end_tick"] + 1 == first + start:
                before = self._spans.pop()
                span |= {name: before[name] for name in ("start_tick", "start_s")}
                span["proxy_max_m"] = max(span["proxy_max_m"], before["proxy_max_m"])
            self._spans.append(span)

    def report(self) -> dict[str, Any]:
        """Where they part; the spans listed are the first 50."""
        data: dict[str, Any] = {
            "threshold_m": PART_M,
            "ticks": self._count,
            "proxy_max_m": self._proxy[0],
            "force_max_n": self._force[0],
            "force_rms_n": float(np.sqrt(self._force2 / max(1, self._ticks))),
            "spans": self._spans[:LISTED],
            "span_count": len(self._spans),
        }
        if self._proxy[0] > 0:
            data["proxy_max_tick"] = -self._proxy[1]
        if self._force[0] > 0:
            data["force_max_tick"] = -self._force[1]
        if self._differ is not None:
            data["first_difference_tick"] = self._differ
        if self._spans:
            data["first_tick"] = self._spans[0]["start_tick"]
            data["first_s"] = self._spans[0]["start_s"]
        return data
