"""From blocks of ticks to ticks that know their successor, across the blocks' borders."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vfplan.replaying.quantities import Steps
from vfplan.session import TickBlock
from vfplan.session.ticks import joined

Array = NDArray[np.float64]


class Stepper:
    """Turn blocks into `Steps`, one tick behind; `finish` gives the last tick."""

    def __init__(self) -> None:
        self._carry: tuple[TickBlock, Array] | None = None
        self._done = 0

    def push(self, block: TickBlock, hand: Array | None = None) -> Steps | None:
        """The ticks whose successor is now known; `None` while there are none."""
        hand = block.hip if hand is None else hand
        if self._carry is not None:
            block = joined([self._carry[0], block])
            hand = np.concatenate((self._carry[1], hand))
        self._carry = block[-1:], hand[-1:]
        if len(block) < 2:
            return None
        return self._steps(block, hand)

    def finish(self) -> Steps:
        """The last tick: its differences are zero."""
        assert self._carry is not None, "finish() before any block"
        block, hand = self._carry
        return self._steps(joined([block, block]), np.concatenate((hand, hand)))

    def _steps(self, block: TickBlock, hand: Array) -> Steps:
        steps = Steps(
            first=self._done,
            ticks=block[:-1],
            hand=hand[:-1],
            dt=np.diff(block.time),
            dhand=np.diff(hand, axis=0),
            dproxy=np.diff(block.proxy, axis=0),
            dhip=np.diff(block.hip, axis=0),
            dforce=np.diff(block.force, axis=0),
        )
        self._done += len(steps)
        return steps
