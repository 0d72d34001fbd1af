"""Ticks at the rate of a display, for any number of readers, none of which is waited for."""

from __future__ import annotations

import threading
from collections import deque

import numpy as np
from numpy.typing import NDArray

MOST_CLIENTS = 32  # of one server
BEHIND_S = 0.5  # a reader that is further behind misses the oldest


class Feed:
    """Takes in every tick, and holds the first one of each period of the rate for a short while.

    rate_hz: how many ticks a second are handed out, in the ticks' own time
    """

    def __init__(self, rate_hz: float = 100.0) -> None:
        self.rate_hz = rate_hz
        self._held: deque[NDArray[np.void]] = deque(maxlen=max(1, int(BEHIND_S * rate_hz)))
        self._count, self._period = 0, np.nan
        self._news = threading.Condition()

    def put(self, ticks: NDArray[np.void]) -> None:
        """Take in (n,) of `vfplan.session.mcapfile.TICK`, n at least 1."""
        periods = np.floor(ticks["t"] * self.rate_hz + 1e-6)
        due = ticks[np.diff(periods, prepend=self._period) != 0]
        with self._news:
            self._period = periods[-1]
            self._held.extend(due)
            self._count += len(due)
            self._news.notify_all()

    def after(self, seen: int, wait_s: float) -> tuple[int, list[NDArray[np.void]]]:
        """What a reader has seen now, and the ticks that are new to it; none after `wait_s`.

        `seen` is what the call before gave; -1 at first, for the newest tick alone.
        """
        with self._news:
            self._news.wait_for(lambda: self._count > max(seen, 0), wait_s)
            new = min(self._count, 1) if seen < 0 else self._count - seen
            held = list(self._held)
            return self._count if self._count else seen, held[max(0, len(held) - new) :]
