"""What a replay found, a row a tick, and how a result file holds it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vfplan.session.types import Array

RESULT_FORMAT = "vfplan-result"
RESULT_VERSION = "1.0"

# name -> (columns, type, unit)
TABLE: dict[str, tuple[tuple[int, ...], str, str]] = {
    "time": ((), "<f8", "s"),
    "hip": ((3,), "<f8", "m"),
    "proxy": ((3,), "<f8", "m"),
    "normal": ((3,), "<f8", "1"),
    "force": ((3,), "<f8", "N"),
    "state": ((), "|i1", "1"),
    "penetration": ((), "<f8", "m"),
    "overlap": ((), "<f8", "m"),
}


@dataclass(frozen=True, eq=False)
class TickBlock:
    """A run of consecutive ticks of a replay, one row each."""

    # (n,) [s] and (n, 3) [m], as the controller had them
    time: Array
    hip: Array
    # (n, 3) at the end of each tick [m], [1], [N]
    proxy: Array
    normal: Array
    force: Array
    state: NDArray[np.int8]  # (n,) int8, -1, 0, 1 or 2
    penetration: Array  # (n,) |proxy - hip| [m]
    overlap: Array  # (n,) how far the HIP is beyond the cloud's own surface [m], never below 0

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: slice | NDArray[np.intp]) -> TickBlock:
        """These ticks alone."""
        return TickBlock(*(getattr(self, name)[rows] for name in TABLE))


class Result(Protocol):
    """What `write_result` writes; a `Replay` is one."""

    @property
    def ticks(self) -> TickBlock:
        """One row a tick."""

    @property
    def record(self) -> dict[str, Any]:
        """The root attributes."""


def joined(blocks: list[TickBlock]) -> TickBlock:
    """Blocks one after the other, as one."""
    return TickBlock(*(np.concatenate([getattr(b, name) for b in blocks]) for name in TABLE))
