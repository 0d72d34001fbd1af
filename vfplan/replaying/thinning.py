"""A replay in a bounded number of ticks, for pictures: of each stretch, its deepest tick."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.replaying.quantities import CONTACT_M
from vfplan.session import TickBlock
from vfplan.session.result import TABLE, concatenate_ticks


def no_ticks() -> TickBlock:
    """A block without ticks."""
    return TickBlock(*(np.empty((0, *columns), dtype) for columns, dtype, _ in TABLE.values()))


class ThinnedTicks:
    """Keep at most `capacity` ticks; every tick while the session is that short.

    capacity: ticks kept, 2 at least; 0: none; `None`: all of them
    """

    def __init__(self, capacity: int | None = 65536) -> None:
        self._capacity = capacity
        self._blocks = [no_ticks()]
        self.stride = 1

    def update(self, block: TickBlock) -> None:
        """Take in the next ticks."""
        if self._capacity == 0:
            return
        self._blocks.append(thinned(block, self.stride))
        while self._capacity is not None and len(self.ticks) > self._capacity:
            self._blocks = [thinned(self.ticks, 2)]
            self.stride *= 2

    @property
    def ticks(self) -> TickBlock:
        """What was kept, in order."""
        if len(self._blocks) > 1:
            self._blocks = [concatenate_ticks(self._blocks)]
        return self._blocks[0]


def thinned(block: TickBlock, stride: int) -> TickBlock:
    """Of every `stride` ticks in a row the one with the deepest penetration (the first)."""
    if stride == 1:
        return block
    n = len(block)
    depth = np.full(-(-n // stride) * stride, -1.0)
    depth[:n] = block.penetration
    rows = depth.reshape(-1, stride)
    picks = rows.argmax(axis=1) + np.arange(len(rows)) * stride
    return block[picks]


def contact_marks(ticks: TickBlock, rate_hz: float) -> NDArray[np.intp]:
    """Indices of ticks in contact, at most `rate_hz` of them a second: the first of each slot."""
    slot = np.floor((ticks.time - ticks.time[0]) * rate_hz).astype(np.int64)
    in_contact = np.flatnonzero(ticks.penetration > CONTACT_M)
    _, first = np.unique(slot[in_contact], return_index=True)
    return in_contact[first]
