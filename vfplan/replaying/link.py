"""What a run is set beside: a lossy link, another run of the same ticks, hands along a curve.

`LossyLink` delivers positions late, uneven, coarse, and not all; `Comparison` says where two runs
part; `approach_sessions` are hands that press along a drawn curve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfplan.display import count, millimetres
from vfplan.errors import InputError, SettingError
from vfplan.fixture import Fixture
from vfplan.geometry.lines import arc_lengths, interpolated, row_lengths, runs
from vfplan.replaying.metrics import Report, row_norms
from vfplan.session.result import TickBlock
from vfplan.session.session import NO_SAMPLES, Array, LongestRun, Session


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
        for name, low, high, allowed in (
            ("drop", 0, np.nextafter(1, 0), "0 to below 1"),
            ("jitter_s", 0, 10, "0 to 10 s"),
            ("delay_ticks", 0, 100_000, "0 to 100000 ticks"),
            ("quantum_m", 1e-12, 1, "1e-12 to 1 m"),
            ("seed", 0, np.inf, "0 or more"),
        ):
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                message = f"{name} is {value}. Give {allowed}"
                raise SettingError(message, code="link-out-of-range", numbers={name: value})

    def report(self) -> Report:
        """The faults that are set, by name, and the seed."""
        return {name: value for name, value in vars(self).items() if value is not None}


class LossyLink:
    """Deliver blocks of a session through a `Link`; what happens does not depend on the blocks."""

    def __init__(self, link: Link) -> None:
        self._link = link
        loss_seed, age_seed = np.random.SeedSequence(link.seed).spawn(2)
        self._loss_random = np.random.default_rng(loss_seed)
        self._age_random = np.random.default_rng(age_seed)
        # Samples before the block, as far back as a delayed one may come from.
        self._past_time, self._past_hip = NO_SAMPLES
        self._latest_time = -np.inf
        self._ticks = 0
        self._lost = 0
        self._longest_loss = LongestRun()

    def deliver(self, time: Array, hip: Array) -> tuple[Array, NDArray[np.intp]]:
        """The next block, as the controller has it.

        Returns the positions that arrived, (m, 3) [m], and of each tick (n,) the row of these that
        is in force; -1: the last one of the block before.
        """
        positions = self._delay(time, hip)
        if self._link.quantum_m is not None:
            positions = np.round(positions / self._link.quantum_m) * self._link.quantum_m
        arrived = np.ones(len(positions), dtype=bool)
        if self._link.drop is not None:
            arrived = self._loss_random.random(len(positions)) >= self._link.drop
            # A session begins when its first packet is there.
            arrived[0] |= self._ticks == 0
            self._lost += int(np.count_nonzero(~arrived))
            self._longest_loss.update(~arrived, self._ticks)
        self._ticks += len(positions)
        return positions[arrived], np.cumsum(arrived) - 1

    def _delay(self, time: Array, hip: Array) -> Array:
        """Positions as they were `delay_ticks` samples and up to `jitter_s` before each tick."""
        delay = self._link.delay_ticks or 0
        jitter = self._link.jitter_s
        times = np.concatenate((self._past_time, time))
        hips = np.concatenate((self._past_hip, hip))
        source = np.maximum(len(self._past_time) + np.arange(len(time)) - delay, 0)
        positions = hips[source]
        if jitter is not None:
            wanted = times[source] - self._age_random.uniform(0.0, jitter, len(time))
            # A later packet never overtakes an earlier one.
            wanted = np.maximum.accumulate(np.maximum(wanted, self._latest_time))
            self._latest_time = wanted[-1]
            positions = interpolated(wanted, times, hips)
        # Keep what the next block may ask for.
        first = max(0, len(times) - delay - 1)
        oldest = times[first] - (jitter or 0.0)
        first = max(0, int(np.searchsorted(times, oldest, "right")) - 1)
        self._past_time = times[first:]
        self._past_hip = hips[first:]
        return positions

    def report(self, lost_limit: int | None) -> Report:
        """What was lost; with a robot's limit, whether the robot would have stopped."""
        if self._link.drop is None:
            return {}
        longest = self._longest_loss
        data = {"lost": self._lost, "lost_longest": longest.length}
        if longest.length:
            data["lost_longest_tick"] = longest.tick
        if lost_limit is not None:
            data |= {"lost_limit": lost_limit, "robot_stops": longest.length > lost_limit}
        return data


# Speed of the hand [m/s]. A hand that follows a drawn line with care is about as fast.
SPEED_M_S = 0.05

# How far beyond contact the hand wants to be [m], but never beyond the drawn line.
PRESS_DEPTH_M = 5e-3

# Where a session begins and ends, in units of the distance at which the proxy stops. Above 1, so
# that the hand starts without contact.
START_DISTANCE = 1.5


def approach_sessions(
    fixture: Fixture, rate_hz: float = 1000.0, *, to_ends: bool = True
) -> list[Session]:
    """Hands that press on the drawn curve: along each stroke, on each of its sides.

    Left and right of a curve that is endless along an axis; above and below one in space, in the
    robot's frame. Each begins and ends clear of the curve.

    to_ends: whether open strokes are followed to their ends. A hand that presses there slips round
        them; without it, it stays as far from them as the proxy stops and the hand presses.
    Raises InputError: a fixture that was not drawn as a curve, or an open stroke with nothing
        between its ends
    """
    if fixture.curve is None or fixture.rendering is None:
        message = "the fixture has no drawn curve to follow. Give a session"
        raise InputError(message, code="no-curve")
    stop = fixture.contact_radius + fixture.point_radius
    sessions = []
    for number, stroke in enumerate(fixture.strokes):
        points = stroke.points
        normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
        if fixture.ignore_axis is not None and len(points) > 1:
            normals = np.cross(fixture.ignore_axis, np.gradient(points, axis=0))
            normals /= np.maximum(row_lengths(normals), 1e-12)[:, None]
        if not to_ends and not stroke.closed:
            arc = arc_lengths(points, closed=False)
            clear = stop + PRESS_DEPTH_M
            inner = (arc >= clear) & (arc[-1] - arc >= clear)
            if inner.sum() < 2:
                size, reach = millimetres(arc[-1]), millimetres(clear)
                message = f"a stroke of {size} has nothing {reach} from its ends. Give a session"
                numbers = {"length_m": float(arc[-1]), "clear_m": clear}
                raise InputError(message, code="stroke-too-short", numbers=numbers)
            points = points[inner]
            normals = normals[inner]
        for name, side in (("left", normals), ("right", -normals)):
            # Clear of the stroke, along it, and clear again, at an even speed.
            pressed = points + max(0.0, stop - PRESS_DEPTH_M) * side
            ends = points[[0, -1]] + START_DISTANCE * stop * side[[0, -1]]
            path = np.concatenate((ends[:1], pressed, ends[1:]))
            arc = arc_lengths(path, closed=False)
            ticks = max(2, int(arc[-1] * rate_hz / SPEED_M_S) + 1)
            hip = interpolated(np.linspace(0.0, arc[-1], ticks), arc, path)
            title = f"stroke {number}, {name} side"
            sessions.append(Session(np.arange(ticks) / rate_hz, hip, fixture.frame, title))
    return sessions


# What a lossy link did, by the names in a replay's report.
LINK_WORDS = {
    "drop": "each packet lost with probability {:g}", "lost": "{} lost",
    "lost_longest": "up to {} in a row", "jitter_s": "up to {:g} s late",
    "delay_ticks": "{} ticks late", "quantum_m": "rounded to {:g} µm", "seed": "seed {}",
}  # fmt: skip


def link_text(link: Report) -> str:
    """What a lossy link did, of a replay's report."""
    numbers = link | {"quantum_m": 1e6 * link.get("quantum_m", 0.0)}
    return ", ".join(words.format(numbers[n]) for n, words in LINK_WORDS.items() if n in link)


def apart_text(apart: Report) -> str:
    """How far two rules are apart, as `Comparison.report` has it."""
    return (
        f"the rules part {count(apart['span_count'], 'time')}, by at most "
        f"{millimetres(apart['proxy_max_m'])} and {apart['force_max_n']:.3f} N"
    )


# Proxies farther apart than this [m] have parted; below it rules differ by their bands alone.
PART_M = 5e-5
# How many stretches apart are listed one by one.
LISTED = 50


class Comparison:
    """Compare two runs, block by block."""

    def __init__(self) -> None:
        self._ticks = self._parted_ticks = 0
        self._first_difference = None
        self._proxy_max_m = self._force_max_n = 0.0
        self._spans = []

    def update(self, a: TickBlock, b: TickBlock) -> None:
        """Take in the same ticks of both runs."""
        first = self._ticks
        self._ticks += len(a)

        differs = ((a.proxy != b.proxy) | (a.force != b.force)).any(axis=1)
        if self._first_difference is None and differs.any():
            self._first_difference = first + int(differs.argmax())

        proxy_gap = row_norms(a.proxy - b.proxy)
        self._proxy_max_m = max(self._proxy_max_m, float(proxy_gap.max()))
        self._force_max_n = max(self._force_max_n, float(row_norms(a.force - b.force).max()))

        # Stretches in which the proxies are apart; one may go on from the last block.
        has_parted = proxy_gap > PART_M
        self._parted_ticks += int(np.count_nonzero(has_parted))
        for rows in runs(has_parted, closed=False):
            start, largest = first + int(rows[0]), float(proxy_gap[rows].max())
            if not self._spans or self._spans[-1]["end_tick"] + 1 != start:
                begun = {"start_tick": start, "start_s": float(a.time[rows[0]]), "proxy_max_m": 0.0}
                self._spans.append(begun)
            span = self._spans[-1]
            span["end_tick"], span["end_s"] = first + int(rows[-1]), float(a.time[rows[-1]])
            span["proxy_max_m"] = max(span["proxy_max_m"], largest)

    def report(self) -> Report:
        """Where they part; the spans listed are the first 50."""
        data = {
            "ticks": self._parted_ticks,
            "proxy_max_m": self._proxy_max_m,
            "force_max_n": self._force_max_n,
            "spans": self._spans[:LISTED],
            "span_count": len(self._spans),
        }
        if self._first_difference is not None:
            data["first_difference_tick"] = self._first_difference
        return data
