"""A recording of HIP positions, in memory or as a stream of blocks: how it was sampled, resampled.

What is measured block by block, `WithPrevious`, `Largest` and `LongestRun`, serves a replay too.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vfplan.display import MAX_LISTED, Report
from vfplan.engine.parameters import MAX_COORDINATE
from vfplan.errors import SessionError, SettingError
from vfplan.geometry.lines import Array, Flags, interpolated, row_lengths
from vfplan.io.files import METRES

# The frames in which a robot's positions can be.
FRAMES = ("robot_base", "patient_lps")


class WithPrevious:
    """Arrays of a block after the last rows of the block before: for differences across blocks."""

    def __init__(self) -> None:
        self._last: tuple[Array, ...] | None = None

    def __call__(self, *rows: Array) -> tuple[Array, ...]:
        """The arrays, a row longer from the second block on."""
        if self._last is not None:
            rows = tuple(map(np.concatenate, zip(self._last, rows, strict=True)))
        self._last = tuple(array[-1:] for array in rows)
        return rows


class Largest:
    """The largest value so far that is above 0, and its tick."""

    def __init__(self) -> None:
        self.value = 0.0
        self.tick = 0

    def update(self, values: Array, first_tick: int) -> None:
        """Take in the values of the next ticks (n,), of which the first is `first_tick`."""
        k = int(np.argmax(values))
        if values[k] > self.value:
            self.value = float(values[k])
            self.tick = first_tick + k


class LongestRun:
    """The longest run of flags, which may go on from block to block, and its first tick."""

    def __init__(self) -> None:
        self.length = self.tick = self._open = 0

    def update(self, flags: Flags, first_tick: int) -> None:
        """Take in the flags of the next ticks (n,), of which the first is `first_tick`."""
        edges = np.concatenate(([-1 - self._open], np.flatnonzero(~flags), [len(flags)]))
        lengths = np.diff(edges) - 1
        k = int(np.argmax(lengths))
        if lengths[k] > self.length:
            self.length = int(lengths[k])
            self.tick = first_tick + int(edges[k]) + 1
        self._open = int(lengths[-1])


# An interval longer than this many nominal ones may miss samples: half a sample beyond one.
GAP = 1.5

# Samples on each side of a long interval, by which time is told that is only late.
AROUND = 16

# No hand moves a tool faster than this [m/s]: the position jumped.
JUMP_M_S = 20.0


class SamplingReport:
    """Measure how a session was recorded, from its time stamps and positions.

    The nominal interval is the median over the first block. Jitter is the RMS deviation from it
    of the intervals that are no gaps.
    """

    def __init__(self) -> None:
        self._with_previous = WithPrevious()
        self._count = 0
        self._nominal_s = 0.0
        self._longest_s = 0.0
        self._jitter_squares = 0.0
        self._intervals_without_gap = 0
        # As they are reported.
        self._counts = {"gaps": 0, "gap_s": 0.0, "missing_samples": 0, "repeats": 0}
        self._gaps = []
        self._repeats = LongestRun()
        self._speed = Largest()
        self._jump_count = 0
        self._jumps = []

    def update(self, time: Array, hip: Array) -> None:
        """Add the next samples."""
        first = max(0, self._count - 1)
        self._count += len(time)
        time, hip = self._with_previous(time, hip)
        if len(time) < 2:
            return
        dt = np.diff(time)
        if not self._nominal_s:
            # The median. NumPy's own would load numpy.ma, a fifth of a second.
            ordered = np.sort(dt)
            self._nominal_s = float(ordered[(len(dt) - 1) // 2] + ordered[len(dt) // 2]) / 2

        # Intervals: gaps and jitter.
        is_gap = dt > GAP * self._nominal_s
        phase = time - self._nominal_s * np.arange(len(time))
        for k in np.flatnonzero(is_gap):
            # Only the samples around it tell a late sample from one that is missing.
            before, after = np.sort(phase[max(0, k + 1 - AROUND) : k + 1]), phase[k + 1 :][:AROUND]
            shift = np.sort(after)[len(after) // 2] - before[len(before) // 2]
            missing = round(min(dt[k] - self._nominal_s, shift) / self._nominal_s)
            is_gap[k] = missing > 0
            if not missing:
                continue
            gap = {"t_s": float(time[k]), "length_s": float(dt[k]), "missing": missing}
            self._counts["missing_samples"] += missing
            self._counts["gaps"] += 1
            self._counts["gap_s"] += gap["length_s"]
            if len(self._gaps) < MAX_LISTED:
                self._gaps.append(gap)
        self._intervals_without_gap += int(np.count_nonzero(~is_gap))
        self._jitter_squares += float(((dt[~is_gap] - self._nominal_s) ** 2).sum())
        self._longest_s = max(self._longest_s, float(dt.max()))

        # Positions: repeats and jumps.
        step = np.diff(hip, axis=0)
        is_repeat = (step == 0).all(axis=1)
        self._counts["repeats"] += int(np.count_nonzero(is_repeat))
        self._repeats.update(is_repeat, first)
        speed = row_lengths(step) / dt
        self._speed.update(speed, first + 1)
        jumps = first + 1 + np.flatnonzero(speed > JUMP_M_S)
        self._jump_count += len(jumps)
        self._jumps.extend(jumps[: MAX_LISTED - len(self._jumps)].tolist())

    def report(self) -> Report:
        """The `session` part of a replay's report."""
        jitter_squares = self._jitter_squares / max(1, self._intervals_without_gap)
        data = {
            "samples": self._count,
            "rate_hz": 1.0 / self._nominal_s,
            "dt_nominal_s": self._nominal_s,
            "dt_max_s": self._longest_s,
            "jitter_rms_s": float(np.sqrt(jitter_squares)),
            **self._counts,
            "repeats_longest": self._repeats.length,
            "changes": self._count - 1 - self._counts["repeats"],
            "speed_max_m_s": self._speed.value,
            "speed_max_tick": self._speed.tick,
        }
        if self._gaps:
            data["gap_list"] = self._gaps
        if self._jump_count:
            data["jumps"] = self._jump_count
            data["jump_ticks"] = self._jumps
        return data


# Time (n,) [s] and HIP (n, 3) [m] of consecutive samples.
Samples = tuple[Array, Array]
Blocks = Iterator[Samples]
NO_SAMPLES: Samples = np.empty(0), np.empty((0, 3))

# Ticks of a block. All that sums over ticks sees blocks of this length, however the file was cut:
# sums then run in the same order on every run, and memory does not grow with the session.
BLOCK = 16384

# Largest time stamp [s]. No clock gives more, and the square of a difference stays finite.
MAX_TIME_S = 1e20

# Smallest difference between two time stamps [s]. A smaller one would make speeds overflow.
MIN_STEP_S = 1e-9

# Samples that wait for earlier ones.
REORDERED = 256

# Share of swapped and doubled samples up to which they are mended, and told.
MENDED_SHARE = 0.01

# Highest rate of resampling. No arm's loop is as fast, and a rate mistyped by some zeros would fill
# the memory.
MAX_RATE_HZ = 1e6


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
        What the reader did that the caller should know of, e.g. columns that it ignored.

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
    notes: Report = field(default_factory=dict)

    def __post_init__(self) -> None:
        time = np.ascontiguousarray(self.time, dtype=np.float64)
        hip = np.ascontiguousarray(self.hip, dtype=np.float64)
        if time.ndim != 1 or hip.shape != (*time.shape, 3):
            message = f"time has shape {time.shape} and hip {hip.shape}. Give (T,) and (T, 3)"
            raise SessionError(message, where=self.name, code="shape-wrong")
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "hip", hip)
        for _ in check_samples([(time, hip)], self.name):
            pass

    @property
    def ticks(self) -> int:
        """T."""
        return len(self.time)

    def blocks(self, size: int = BLOCK) -> Blocks:
        """Blocks of `size` ticks, the last one shorter."""
        return portions(self.time, self.hip, size)


@dataclass(frozen=True, eq=False)
class SessionStream:
    """A recording that is read block by block, each time `blocks` is called."""

    # Opens the file and yields samples in portions of any length.
    read: Callable[[], Blocks]
    # The same as in `Session`.
    name: str
    frame: str = "robot_base"
    sha256: str | None = None
    notes: Report = field(default_factory=dict)

    def blocks(self, size: int = BLOCK) -> Blocks:
        """Blocks of `size` ticks (the last one shorter), checked.

        Raises
        ------
        SessionError
            As for `Session`, naming the sample.
        """
        return check_samples(regrouped(self.read(), size), self.name)

    def load(self) -> Session:
        """Everything in memory."""
        time, hip = map(np.concatenate, zip(*self.blocks(), strict=True))
        return Session(time, hip, self.frame, self.name, self.sha256, self.notes)


# What can be replayed.
SessionSource = Session | SessionStream


def unit_factor(units: str) -> float:
    """Metres in one of `units`; raises `SettingError` for one that is not known."""
    if units not in METRES:
        text = f"unit of positions is {units!r}. Give {' or '.join(METRES)}"
        raise SettingError(text, code="unit-unknown")
    return METRES[units]


def portions(time: Any, hip: Any, size: int = BLOCK) -> Blocks:
    """Blocks of arrays, or of datasets that are read as they are asked for."""
    for start in range(0, len(time), size):
        rows = slice(start, start + size)
        yield np.asarray(time[rows], float), np.asarray(hip[rows], float)


def regrouped(samples: Iterable[Samples], size: int) -> Blocks:
    """The same samples in blocks of exactly `size`, the last one shorter."""
    time, hip = NO_SAMPLES
    for more_time, more_hip in samples:
        time = np.concatenate((time, more_time))
        hip = np.concatenate((hip, more_hip))
        while len(time) >= size:
            yield time[:size], hip[:size]
            time, hip = time[size:], hip[size:]
    if len(time):
        yield time, hip


def in_order(
    samples: Iterable[Samples], mended: dict[str, int], where: str, *, skip: bool
) -> Blocks:
    """The samples in the order of their times; one that is doubled, or far too late, is left out.

    mended: counts, when all is read, the samples that were `swapped` and those that were `doubled`
    skip: take any number of them

    Raises SessionError: more than `MENDED_SHARE` of them
    """
    time, hip = NO_SAMPLES
    count = swapped = doubled = 0
    newest = last = -np.inf
    first = None
    for more_time, more_hip in itertools.chain(samples, [NO_SAMPLES]):
        before = np.maximum.accumulate(np.append(newest, more_time))
        is_late = np.diff(before) < MIN_STEP_S
        if is_late.any() and first is None:
            k = int(np.argmax(is_late))
            first = count + k, float(more_time[k]), float(before[k])
        newest = before[-1]
        count += len(more_time)
        swapped += int(np.count_nonzero(is_late))
        time, hip = np.concatenate((time, more_time)), np.concatenate((hip, more_hip))
        if np.isfinite(time).all():
            order = np.argsort(time, kind="stable")
            order = order[np.diff(np.maximum(time[order], last), prepend=last) >= MIN_STEP_S]
            doubled += len(time) - len(order)
            time, hip = time[order], hip[order]
        done = len(time) - REORDERED if len(more_time) else len(time)
        if done > 0:
            yield time[:done], hip[:done]
            last = time[done - 1]
            time, hip = time[done:], hip[done:]
    mended |= {"swapped": swapped - doubled, "doubled": doubled}
    if first is not None and swapped > MENDED_SHARE * count and not skip:
        # A swapped sample is put in its place, and a doubled one cannot be kept.
        way_out = f", or --skip-unordered to sort the {count} samples"
        if doubled:
            way_out += f" and leave {doubled} of them out"
        raise not_increasing(*first, where, way_out)


def not_increasing(k: int, time: float, before: float, where: str, way_out: str) -> SessionError:
    """That sample k is no later than the one before it [s]."""
    message = (
        f"time does not increase: {time!r} s at sample {k} follows {before!r} s. Give each sample "
        f"a later time than the one before{way_out}"
    )
    return SessionError(message, where=where, code="time-not-increasing", numbers={"sample": k})


def check_samples(blocks: Iterable[Samples], where: str) -> Blocks:
    """Pass blocks on, and refuse the first sample that no robot can have.

    Raises SessionError: a value out of range, time that does not increase, fewer than two samples
    """
    count = 0
    last_time = -np.inf
    for time, hip in blocks:
        # NaN is not <= anything, so it is not good either.
        good = (np.abs(time) <= MAX_TIME_S) & (np.abs(hip) <= MAX_COORDINATE).all(axis=1)
        if not good.all():
            k = int(np.argmin(good))
            x, y, z = hip[k]
            is_finite = np.isfinite([time[k], x, y, z]).all()
            fault = "is out of range" if is_finite else "is not finite"
            message = (
                f"sample {count + k} {fault}: t = {time[k]} s, hip = ({x}, {y}, {z}) m. Give "
                f"finite positions within {MAX_COORDINATE:g} m"
            )
            code = "sample-out-of-range" if is_finite else "sample-not-finite"
            raise SessionError(message, where=where, code=code, numbers={"sample": count + k})
        with_last = np.concatenate(([last_time], time))
        increases = np.diff(with_last) >= MIN_STEP_S
        if not increases.all():
            k = int(np.argmin(increases))
            raise not_increasing(count + k, float(time[k]), float(with_last[k]), where, "")
        count += len(time)
        last_time = time[-1]
        yield time, hip
    if count < 2:
        message = f"the session has too few samples: {count}. Give at least 2"
        raise SessionError(message, where=where, code="too-few-samples", numbers={"samples": count})


def resampled(session: SessionSource, rate_hz: float) -> SessionStream:
    """The session at t0, t0 + 1/rate, ... up to its last sample, by linear interpolation.

    The lines also fill the gaps of the recording. `notes["recorded"]` says how it was sampled, as
    `SamplingReport.report` gives it, once all blocks are read.

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
    if not 0 < rate_hz <= MAX_RATE_HZ:
        message = f"rate is {rate_hz:g} Hz. Give more than 0 and at most {MAX_RATE_HZ:g} Hz"
        raise SettingError(message, code="rate-out-of-range", numbers={"rate_hz": rate_hz})

    notes = {**session.notes, "resampled_hz": rate_hz}

    def samples() -> Blocks:
        recorded = SamplingReport()
        # The first interval of a block begins at the last sample of the block before.
        with_previous = WithPrevious()
        start = None
        # Samples given so far; sample k stands at start + k / rate.
        done = 0
        for block_time, block_hip in session.blocks(BLOCK):
            recorded.update(block_time, block_hip)
            if start is None:
                start = block_time[0]
            time, hip = with_previous(block_time, block_hip)
            # 1e-9 of a sample keeps the last one when T * rate is a whole number but for rounding.
            last = int(np.floor((time[-1] - start) * rate_hz + 1e-9))
            for first in range(done, last + 1, BLOCK):
                new_time = start + np.arange(first, min(first + BLOCK, last + 1)) / rate_hz
                yield new_time, interpolated(new_time, time, hip)
            done = max(done, last + 1)
        notes["recorded"] = recorded.report()

    return SessionStream(samples, session.name, session.frame, session.sha256, notes)
