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
    # Every sample arrives this many ticks late
    delay_ticks: int | None = None
    # Positions are rounded to multiples of this [m]
    quantum_m: float | None = None
    # Of the random numbers: the same seed gives the same faults
    seed: int = 0

    def __post_init__(self) -> None:
        if self.drop is not None and not 0 <= self.drop < 1:
            raise _out_of_range("drop", self.drop, "0 to below 1")
        if self.jitter_s is not None and not 0 <= self.jitter_s <= 10:
            raise _out_of_range("jitter_s", self.jitter_s, "0 to 10 s")
        if self.delay_ticks is not None and not 0 <= self.delay_ticks <= 100_000:
            raise _out_of_range("delay_ticks", self.delay_ticks, "0 to 100000 ticks")
        if self.quantum_m is not None and not 1e-12 <= self.quantum_m <= 1:
            raise _out_of_range("quantum_m", self.quantum_m, "1e-12 to 1 m")
        if self.seed < 0:
            raise _out_of_range("seed", self.seed, "0 or more")

    @property
    def faulty(self) -> bool:
        """Whether any fault is set."""
        faults = (self.drop, self.jitter_s, self.delay_ticks, self.quantum_m)
        return any(fault is not None for fault in faults)

    def report(self) -> dict[str, Any]:
        """The faults that are set, by name."""
        return {name: value for name, value in vars(self).items() if value is not None}


def _out_of_range(name: str, value: float, allowed: str) -> SettingError:
    return SettingError(
        f"{name} is {value}. Give {allowed}", code="link-out-of-range", numbers={name: value}
    )


@dataclass(frozen=True, eq=False)
class Delivered:
    """A block of ticks as the controller had them."""

    # (m, 3) positions that arrived [m]
    hip: Array
    # (n,) for each tick the row of `hip` in force; -1: the last one of the block before
    row: NDArray[np.intp]


class LossyLink:
    """Deliver blocks of a session through a `Link`; what happens does not depend on the blocks."""

    def __init__(self, link: Link) -> None:
        self._link = link
        loss_seed, age_seed = np.random.SeedSequence(link.seed).spawn(2)
        self._loss_random = np.random.default_rng(loss_seed)
        self._age_random = np.random.default_rng(age_seed)
        # Samples before the block, as far back as a delayed one may come from.
        self._past_time = np.empty(0)
        self._past_hip = np.empty((0, 3))
        self._latest_time = -np.inf
        self._ticks = 0
        self._lost = 0
        # Packets lost in a row: at the end of the last block, and the longest run with its tick.
        self._losing = 0
        self._longest = 0
        self._longest_tick = 0

    def deliver(self, time: Array, hip: Array) -> Delivered:
        """The next block, as it arrives."""
        positions = self._delay(time, hip)
        if self._link.quantum_m is not None:
            positions = np.round(positions / self._link.quantum_m) * self._link.quantum_m
        arrived = np.ones(len(positions), dtype=bool)
        if self._link.drop is not None:
            arrived = self._loss_random.random(len(positions)) >= self._link.drop
            # A session begins when its first packet is there.
            arrived[0] |= self._ticks == 0

            # Packets lost in a row lie between those that arrived; a run may go on from the last
            # block.
            self._lost += int(np.count_nonzero(~arrived))
            edges = np.concatenate(([-1 - self._losing], np.flatnonzero(arrived), [len(arrived)]))
            runs = np.diff(edges) - 1
            k = int(np.argmax(runs))
            if runs[k] > self._longest:
                self._longest = int(runs[k])
                self._longest_tick = self._ticks + int(edges[k]) + 1
            self._losing = int(runs[-1])
        self._ticks += len(positions)
        return Delivered(positions[arrived], np.cumsum(arrived) - 1)

    def _delay(self, time: Array, hip: Array) -> Array:
        """Positions as they were `delay_ticks` samples and up to `jitter_s` before each tick."""
        delay = self._link.delay_ticks or 0
        jitter = self._link.jitter_s
        if not delay and jitter is None:
            return hip
        times = np.concatenate((self._past_time, time))
        hips = np.concatenate((self._past_hip, hip))
        source = np.maximum(len(self._past_time) + np.arange(len(time)) - delay, 0)
        positions = hips[source]
        if jitter is not None:
            wanted = times[source] - self._age_random.uniform(0.0, jitter, len(time))
            # A later packet never overtakes an earlier one.
            wanted = np.maximum.accumulate(np.maximum(wanted, self._latest_time))
            self._latest_time = wanted[-1]
            positions = np.empty((len(time), 3))
            for axis in range(3):
                positions[:, axis] = np.interp(wanted, times, hips[:, axis])
        # Keep what the next block may ask for.
        first = max(0, len(times) - delay - 1)
        oldest = times[first] - (jitter or 0.0)
        first = max(0, int(np.searchsorted(times, oldest, "right")) - 1)
        self._past_time = times[first:]
        self._past_hip = hips[first:]
        return positions

    def report(self, lost_limit: int | None) -> dict[str, Any]:
        """What was lost; with a robot's limit, whether the robot would have stopped."""
        if self._link.drop is None:
            return {}
        data: dict[str, Any] = {"lost": self._lost, "lost_longest": self._longest}
        if self._longest:
            data["lost_longest_tick"] = self._longest_tick
        if lost_limit is not None:
            data["lost_limit"] = lost_limit
            data["robot_stops"] = self._longest > lost_limit
        return data
