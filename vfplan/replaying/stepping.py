"""From blocks of ticks to ticks that know their successor, across the blocks' borders."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from vfplan.replaying.quantities import Steps
from vfplan.session import TickBlock

Array = NDArray[np.float64]
_NAMES = [field.name for field in fields(TickBlock)]


def _cut(block: TickBlock, part: slice) -> TickBlock:
    return TickBlock(**{name: getattr(block, name)[part] for name in _NAMES})


def _stuck(block: TickBlock, other: TickBlock) -> TickBlock:
    return TickBlock(**{n: np.concatenate((getattr(block, n), getattr(other, n))) for n in _NAMES})


class Stepper:
    """Turn blocks into `Steps`, one tick behind; `finish` gives the last tick."""

    def __init__(self) -> None:
        self._carry: tuple[TickBlock, Array] | None = None
        self._done = 0

    def push(self, block: TickBlock, hand: Array | None = None) -> Steps | None:
        """The ticks whose successor is now known; `None` while there are none."""
        hand = block.hip if hand is None else hand
        if self._carry is not None:
            block = _stuck(self._carry[0], block)
            hand = np.concatenate((self._carry[1], hand))
        self._carry = _cut(block, slice(-1, None)), hand[-1:]
        if len(block) < 2:
            return None
        return self._steps(block, hand)

    def finish(self) -> Steps:
        """The last tick: its differences are zero."""
        assert self._carry is not None, "finish() before any block"
        block, hand = self._carry
        return self._steps(_stuck(block, block), np.concatenate((hand, hand)))

    def _steps(self, block: TickBlock, hand: Array) -> Steps:
        steps = Steps(
            first=self._done,
            ticks=_cut(block, slice(None, -1)),
            hand=hand[:-1],
            dt=np.diff(block.time),
            dhand=np.diff(hand, axis=0),
            dproxy=np.diff(block.proxy, axis=0),
            dhip=np.diff(block.hip, axis=0),
            dforce=np.diff(block.force, axis=0),
        )
        self._done += len(steps)
        return steps


def stepped(blocks: Iterable[TickBlock]) -> Iterator[Steps]:
    """All ticks of a replay as `Steps`."""
    stepper = Stepper()
    for block in blocks:
        steps = stepper.push(block)
        if steps is not None:
            yield steps
    yield stepper.finish()
