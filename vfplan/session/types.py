"""A recording of HIP positions: in memory, or as a stream of blocks; also at another rate."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SessionError, SettingError

Array = NDArray[np.float64]
Pair = tuple[Array, Array]  # time (n,) [s], hip (n, 3) [m]

UNITS = {"m": 1.0, "mm": 1e-3}
# Every consumer sees blocks of this many ticks, however the file was cut: sums then run in the same
# order on every run, and memory does not grow with the session.
BLOCK = 16384
# Beyond it no engine answers: float64 loses the nanometre (native core: `largest_coordinate`).
FARTHEST_M = 1e6
# Stamps that no clock gives: their differences would overflow, or make speeds that do.
LATEST_S, SHORTEST_S = 1e20, 1e-9


@dataclass(frozen=True, eq=False)
class Session:
    """A recording of HIP positions in memory.

    Parameters
    ----------
    time
        (T,) [s], strictly increasing, T >= 2.
    hip
        (T, 3) HIP positions in `frame` [m], finite and within 1e6 m.
    frame
        The frame of `hip`.
    name
        What to call it in messages and reports; never a path.
    sha256
        Of the file it came from; `None` for arrays.
    notes
        What the reader did that the caller should know of, e.g. columns it left aside.

    Raises
    ------
    SessionError
        Wrong shapes, fewer than two samples, a value that is not finite, a position beyond 1e6 m,
        time that does not increase.
    """

    time: Array
    hip: Array
    frame: str = "robot_base"
    name: str = "session"
    sha256: str | None = None
    notes: dict[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        time = np.ascontiguousarray(self.time, dtype=np.float64)
        hip = np.ascontiguousarray(self.hip, dtype=np.float64)
        if time.ndim != 1 or hip.shape != (*time.shape, 3):
            raise SessionError(
                f"time has shape {time.shape} and hip {hip.shape}; (T,) and (T, 3) wanted",
                where=self.name,
            )
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "hip", hip)
        for _ in checked(iter([(time, hip)]), self.name):
            pass

    @property
    def ticks(self) -> int:
        """T."""
        return len(self.time)

    def blocks(self, size: int = BLOCK) -> Iterator[Pair]:
        """Blocks of `size` ticks, the last one shorter."""
        for start in range(0, len(self.time), size):
            yield self.time[start : start + size], self.hip[start : start + size]


@dataclass(frozen=True, eq=False)
class SessionStream:
    """A recording that is read block by block, each time `blocks` is called."""

    # Opens the file and yields pieces of any length: (time [s], hip [m])
    read: Callable[[], Iterator[Pair]]
    # As in `Session`
    name: str
    frame: str = "robot_base"
    sha256: str | None = None
    notes: dict[str, object] = field(default_factory=dict)
    ticks: int | None = None  # the number of samples; `None` when only reading to the end tells

    def blocks(self, size: int = BLOCK) -> Iterator[Pair]:
        """Blocks of `size` ticks (the last one shorter), checked.

        Raises
        ------
        SessionError
            As for `Session`, naming the sample.
        """
        return checked(regrouped(self.read(), size), self.name)

    def load(self) -> Session:
        """Everything in memory."""
        time, hip = map(np.concatenate, zip(*self.blocks(), strict=True))
        return Session(time, hip, self.frame, self.name, self.sha256, self.notes)


# What can be replayed.
Source = Session | SessionStream


def unit_factor(units: str) -> float:
    """Metres in one of `units` ("m" or "mm"); raises `SettingError` for anything else."""
    if units not in UNITS:
        raise SettingError(f"unit {units!r} of positions; {' or '.join(UNITS)} wanted")
    return UNITS[units]


def regrouped(pieces: Iterable[Pair], size: int) -> Iterator[Pair]:
    """The same samples in blocks of exactly `size`, the last one shorter."""
    time, hip = np.empty(0), np.empty((0, 3))
    for more in pieces:
        time, hip = (np.concatenate(two) for two in zip((time, hip), more, strict=True))
        while len(time) >= size:
            yield time[:size], hip[:size]
            time, hip = time[size:], hip[size:]
    if len(time):
        yield time, hip


def checked(blocks: Iterable[Pair], where: str) -> Iterator[Pair]:
    """Pass blocks on while each sample is one a robot can have; at least two samples."""
    count = 0
    last = -np.inf
    for time, hip in blocks:
        _check_samples(time, hip, count, where)
        with_last = np.concatenate(([last], time))
        stuck = np.flatnonzero(~(np.diff(with_last) >= SHORTEST_S))
        if len(stuck):
            k = int(stuck[0])
            raise SessionError(
                f"time does not increase: {with_last[k + 1]:.9g} s at sample {count + k} follows "
                f"{with_last[k]:.9g} s; every time stamp must be above the one before",
                where=where,
            )
        count += len(time)
        last = time[-1]
        yield time, hip
    if count < 2:
        raise SessionError(f"holds {count} sample{'s'[count == 1 :]}; 2 at least", where=where)


def _check_samples(time: Array, hip: Array, count: int, where: str) -> None:
    # Written so that NaN fails.
    good = (np.abs(time) <= LATEST_S) & (np.abs(hip) <= FARTHEST_M).all(axis=1)
    if good.all():
        return
    k = int(np.flatnonzero(~good)[0])
    x, y, z = hip[k]
    finite = np.isfinite(time[k]) and np.isfinite(hip[k]).all()
    fault = "is out of range" if finite else "is not finite"
    raise SessionError(
        f"sample {count + k} {fault}: t = {time[k]} s, hip = ({x}, {y}, {z}) m; finite numbers, "
        f"positions within {FARTHEST_M:g} m wanted",
        where=where,
    )


FASTEST_HZ = 1e6  # far above any arm's; a rate mistyped by six zeros would fill the memory


def resampled(session: Source, rate_hz: float) -> SessionStream:
    """The session at t0, t0 + 1/rate, ... up to its last sample, by linear interpolation.

    Parameters
    ----------
    session
        Any source of blocks.
    rate_hz
        Samples a second.

    Raises
    ------
    SettingError
        A rate that is not above 0 and at most 1 MHz.
    """
    if not 0 < rate_hz <= FASTEST_HZ:
        raise SettingError(f"rate {rate_hz:g} Hz; above 0 and at most {FASTEST_HZ:g} wanted")
    return SessionStream(
        lambda: _interpolated(session, rate_hz),
        session.name,
        session.frame,
        session.sha256,
        {**session.notes, "resampled_hz": rate_hz},
    )


def _interpolated(session: Source, rate_hz: float) -> Iterator[Pair]:
    start = None
    done = 0  # samples given so far; sample k stands at start + k / rate
    carry_time, carry_hip = np.empty(0), np.empty((0, 3))
    for time, hip in session.blocks(BLOCK):
        start = time[0] if start is None else start
        time = np.concatenate((carry_time, time))
        hip = np.concatenate((carry_hip, hip))
        # The guard of 1e-9 sample keeps the last one when T * rate is a whole number.
        last = int(np.floor((time[-1] - start) * rate_hz + 1e-9))
        for first in range(done, last + 1, BLOCK):
            at = start + np.arange(first, min(first + BLOCK, last + 1)) / rate_hz
            yield at, np.stack([np.interp(at, time, hip[:, i]) for i in range(3)], axis=1)
        done = max(done, last + 1)
        carry_time, carry_hip = time[-1:], hip[-1:]
