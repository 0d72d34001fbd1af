"""A lossy link between hand and controller: late, uneven, coarse, and with packets lost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Link:
    """What a link does to a stream of positions; a fault that is `None` is absent.

    Raises
    ------
    SettingError
        A value outside its range.
    """

    # Probability that a packet is lost, in [0, 1); the robot then repeats the last command
    drop: float | None = None
    # Each sample is older than its stamp by up to this [s], evenly distributed; order is kept
    jitter_s: float | None = None
    delay_ticks: int | None = None  # every sample arrives this many ticks late
    quantum_m: float | None = None  # positions are rounded to multiples of this [m]
    seed: int = 0  # of the random numbers: the same seed gives the same faults

    def __post_init__(self) -> None:
        for name, value, good, wanted in (
            ("drop", self.drop, lambda v: 0 <= v < 1, "0 to below 1"),
            ("jitter_s", self.jitter_s, lambda v: 0 <= v <= 10, "0 to 10 s"),
            ("delay_ticks", self.delay_ticks, lambda v: 0 <= v <= 100_000, "0 to 100000 ticks"),
            ("quantum_m", self.quantum_m, lambda v: 1e-12 <= v <= 1, "1e-12 to 1 m"),
            ("seed", self.seed, lambda v: v >= 0, "0 at least"),
        ):
            if value is not None and not good(value):
                raise SettingError(f"{name} {value}; {wanted} wanted")

    @property
    def faulty(self) -> bool:
        """Whether any fault was asked for."""
        asked = (self.drop, self.jitter_s, self.delay_ticks, self.quantum_m)
        return any(value is not None for value in asked)

    def report(self) -> dict[str, Any]:
        """The faults that are there, by name."""
        return {name: value for name, value in vars(self).items() if value is not None}


@dataclass(frozen=True, eq=False)
class Delivered:
    """A block of ticks as the controller had them."""

    hip: Array  # (m, 3) positions that arrived [m]
    # (n,) for each tick the row of `hip` in force; -1: the last one of the block before
    row: NDArray[np.intp]


class LossyLink:
    """Deliver blocks of a session through a `Link`; what happened does not depend on the blocks."""

    def __init__(self, link: Link) -> None:
        self._link = link
        streams = np.random.SeedSequence(link.seed).spawn(2)
        self._loss, self._age = (np.random.default_rng(s) for s in streams)
        self._past_time, self._past_hip = np.empty(0), np.empty((0, 3))
        self._latest = -np.inf
        self._ticks = 0
        self._lost = 0
        self._run = 0
        self._longest = (0, 0)

    def deliver(self, time: Array, hip: Array) -> Delivered:
        """The next block, as it arrives."""
        seen = self._aged(time, hip)
        if self._link.quantum_m is not None:
            seen = np.round(seen / self._link.quantum_m) * self._link.quantum_m
        return self._dropped(seen)

    def _aged(self, time: Array, hip: Array) -> Array:
        """Positions as they were `delay_ticks` samples and up to `jitter_s` before each tick."""
        delay, jitter = self._link.delay_ticks or 0, self._link.jitter_s
        if not delay and jitter is None:
            return hip
        past = len(self._past_time)
        times = np.concatenate((self._past_time, time))
        hips = np.concatenate((self._past_hip, hip))
        back = np.maximum(past + np.arange(len(time)) - delay, 0)
        seen = hips[back]
        reach = 0.0
        if jitter is not None:
            reach = jitter
            wanted = times[back] - self._age.uniform(0.0, jitter, len(time))
            # A later packet never overtakes an earlier one.
            wanted = np.maximum.accumulate(np.maximum(wanted, self._latest))
            self._latest = wanted[-1]
            seen = np.stack([np.interp(wanted, times, hips[:, i]) for i in range(3)], axis=1)
        first = max(0, len(times) - delay - 1)
        first = max(0, int(np.searchsorted(times, times[first] - reach, "right")) - 1)
        self._past_time, self._past_hip = times[first:], hips[first:]
        return seen

    def _dropped(self, seen: Array) -> Delivered:
        arrived = np.ones(len(seen), dtype=bool)
        if self._link.drop is not None:
            arrived = self._loss.random(len(seen)) >= self._link.drop
            arrived[0] |= self._ticks == 0  # a session begins when its first packet is there
            self._count(arrived)
        self._ticks += len(seen)
        return Delivered(seen[arrived], np.cumsum(arrived) - 1)

    def _count(self, arrived: NDArray[np.bool_]) -> None:
        self._lost += int(np.count_nonzero(~arrived))
        marks = np.flatnonzero(arrived)
        edges = np.concatenate(([-1 - self._run], marks, [len(arrived)]))
        runs = np.diff(edges) - 1
        k = int(np.argmax(runs))
        if runs[k] > self._longest[0]:
            self._longest = int(runs[k]), self._ticks + int(edges[k]) + 1
        self._run = int(runs[-1])

    def report(self, lost_limit: int | None) -> dict[str, Any]:
        """What was lost; with a robot's limit, whether it would have stopped."""
        if self._link.drop is None:
            return {}
        longest, start = self._longest
        data: dict[str, Any] = {"lost": self._lost, "lost_longest": longest}
        if longest:
            data["lost_longest_tick"] = start
        if lost_limit is not None:
            data["lost_limit"] = lost_limit
            data["robot_stops"] = longest > lost_limit
        return data
