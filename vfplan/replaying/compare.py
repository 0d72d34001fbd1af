"""Two runs of the same ticks: where they part, and by how much."""

from __future__ import annotations

from typing import Any

import numpy as np

from vfplan.replaying.quantities import row_norms
from vfplan.session import TickBlock

PART_M = 5e-5
"""Proxies farther apart than this [m] have parted; below it rules differ by their bands alone."""
LISTED = 50
"""How many stretches apart are listed one by one."""


class Comparison:
    """Compare two runs, block by block."""

    def __init__(self) -> None:
        self._ticks = 0
        self._first_difference: int | None = None
        self._parted_ticks = 0
        self._proxy_max_m = 0.0
        self._proxy_max_tick = 0
        self._force_max_n = 0.0
        self._force_max_tick = 0
        self._force_squares = 0.0
        self._spans: list[dict[str, Any]] = []

    def update(self, a: TickBlock, b: TickBlock) -> None:
        """Take in the same ticks of both runs."""
        first = self._ticks
        self._ticks += len(a)

        differs = ((a.proxy != b.proxy) | (a.force != b.force)).any(axis=1)
        if self._first_difference is None and differs.any():
            self._first_difference = first + int(differs.argmax())

        proxy_gap = row_norms(a.proxy - b.proxy)
        tick = int(proxy_gap.argmax())
        if proxy_gap[tick] > self._proxy_max_m:
            self._proxy_max_m = float(proxy_gap[tick])
            self._proxy_max_tick = first + tick

        force_gap = row_norms(a.force - b.force)
        tick = int(force_gap.argmax())
        if force_gap[tick] > self._force_max_n:
            self._force_max_n = float(force_gap[tick])
            self._force_max_tick = first + tick
        self._force_squares += float((force_gap**2).sum())

        # Stretches in which the proxies are apart; one may go on from the last block.
        has_parted = proxy_gap > PART_M
        self._parted_ticks += int(np.count_nonzero(has_parted))
        edges = np.flatnonzero(np.diff(has_parted.astype(np.int8), prepend=0, append=0))
        for start, end in edges.reshape(-1, 2).tolist():
            span = {
                "start_tick": first + start,
                "end_tick": first + end - 1,
                "start_s": float(a.time[start]),
                "end_s": float(a.time[end - 1]),
                "proxy_max_m": float(proxy_gap[start:end].max()),
            }
            if self._spans and self._spans[-1]["end_tick"] + 1 == first + start:
                before = self._spans.pop()
                span["start_tick"] = before["start_tick"]
                span["start_s"] = before["start_s"]
                span["proxy_max_m"] = max(span["proxy_max_m"], before["proxy_max_m"])
            self._spans.append(span)

    def report(self) -> dict[str, Any]:
        """Where they part; the spans listed are the first 50."""
        data: dict[str, Any] = {
            "threshold_m": PART_M,
            "ticks": self._parted_ticks,
            "proxy_max_m": self._proxy_max_m,
            "force_max_n": self._force_max_n,
            "force_rms_n": float(np.sqrt(self._force_squares / max(1, self._ticks))),
            "spans": self._spans[:LISTED],
            "span_count": len(self._spans),
        }
        if self._proxy_max_m > 0:
            data["proxy_max_tick"] = self._proxy_max_tick
        if self._force_max_n > 0:
            data["force_max_tick"] = self._force_max_tick
        if self._first_difference is not None:
            data["first_difference_tick"] = self._first_difference
        if self._spans:
            data["first_tick"] = self._spans[0]["start_tick"]
            data["first_s"] = self._spans[0]["start_s"]
        return data
