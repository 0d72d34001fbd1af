"""The numbers that a replay reports, gathered block by block in memory that does not grow.

`NUMBERS` says how each of them is written. `Steps` are ticks with what changes until the next one;
`Episodes` gathers the contacts, `Metrics` the whole session, and `StepTimes` how long a tick took.

Tick k holds the HIP x_k, the proxy p_k, the normal n_k (pointing out of the fixture) and the force
F_k = K (p_k - x_k) on the hand, which acts from t_k until t_{k+1}. Forward differences are written
Δx_k = x_{k+1} - x_k; the last tick of a session has no successor and its Δ are zero.
Every quantity is defined here, once; docs/replay.md says the same in words.
"""

from __future__ import annotations

import heapq
import time
from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vfplan.display import MM, Report, three_digits
from vfplan.engine.proxy import Status, Trace
from vfplan.fixture import Fixture
from vfplan.geometry import ROUNDING_M
from vfplan.geometry.lines import Array, arc_lengths, flattened, runs
from vfplan.io.files import to_json_types
from vfplan.robot import Robot
from vfplan.session.result import STATES, TickBlock, concatenate_ticks
from vfplan.session.session import Largest

# A penetration above this is contact [m]. Below it is the rounding of p + (x - p).
CONTACT_M = ROUNDING_M

SUMS = "dwell_s", "impulse_ns", "energy_j", "energy_hold_j", "slide_m", "press_path", "drag_work"
PEAKS = "penetration_max_m", "overlap_max_m", "force_max_n", "force_step_max_n", "lag_max_m"


def row_norms(vectors: Array) -> Array:
    """(n,) Euclidean lengths of (n, 3) vectors."""
    return np.sqrt(dots(vectors, vectors))


def dots(a: Array, b: Array) -> Array:
    """(n,) scalar products of the rows of two (n, 3) arrays."""
    return np.einsum("ij,ij->i", a, b)


def rendered_ticks(time: Array, hip: Array, answers: Any, surface_depth: float) -> TickBlock:
    """Ticks at (n,) [s] with the HIP at (n, 3) [m], of an engine's answers.

    The HIP overlaps the cloud's own surface by max(0, n·(p - x) - r_c) [m]: that is the surface of
    the balls of radius r_v about its points, and the proxy rests r_c above it (R - r_v = r_c).

    answers: with `proxy`, `normal`, `force` and `state`, a row a tick
    surface_depth: r_c, or infinity where there is no surface
    """
    proxy, normal = answers.proxy, answers.normal
    overlap = np.maximum(0.0, dots(normal, proxy - hip) - surface_depth)
    # How far the hand has pushed past where the proxy was stopped.
    depth = row_norms(proxy - hip)
    return TickBlock(time, hip, proxy, normal, answers.force, answers.state, depth, overlap)


@dataclass(frozen=True, eq=False)
class Steps:
    """Consecutive ticks, each with what changes until the next one."""

    # Number of the first tick, counted from the session's first
    first: int
    # The ticks, n of them
    ticks: TickBlock
    # (n, 3) where the hand truly was [m]; differs from `ticks.hip` only behind a lossy link
    hand: Array
    # Forward differences of time, hand, HIP and force: (n,) [s], (n, 3) [m] and [N]
    dt: Array
    dhand: Array
    dhip: Array
    dforce: Array

    def __len__(self) -> int:
        return len(self.ticks)

    @cached_property
    def held(self) -> NDArray[np.bool_]:
        """(n,) whether the fixture pushes: |p - x| above 1 nm. This is what *contact* means."""
        return self.ticks.penetration > CONTACT_M

    @cached_property
    def force_n(self) -> Array:
        """(n,) |F_k| [N]."""
        return row_norms(self.ticks.force)

    @cached_property
    def force_step_n(self) -> Array:
        """(n,) |F_{k+1} - F_k| [N]."""
        return row_norms(self.dforce)

    @cached_property
    def work_j(self) -> Array:
        """(n,) F_k · Δx_k [J], with the hand's own motion: above 0 the hand receives energy."""
        return dots(self.ticks.force, self.dhand)

    @cached_property
    def hold_j(self) -> Array:
        """(n,) -½ ΔF_k · Δx_k [J]: what holding F_k over the tick adds.

        Against a force that changes evenly from F_k to F_{k+1} while the hand moves; above 0 for a
        spring, loading and unloading alike.
        """
        return -0.5 * dots(self.dforce, self.dhand)

    @cached_property
    def speed(self) -> Array:
        """(n,) |Δx_k| / Δt_k of the HIP [m/s]; 0 at the last tick."""
        return row_norms(self.dhip) / np.where(self.dt > 0, self.dt, 1.0)

    @cached_property
    def sliding(self) -> tuple[Array, Array, Array, Array]:
        """Normal force, tangential drag, tangential path and lag, each (n,).

        N_k = n·F [N]; drag D_k = -F·Δx_t/|Δx_t| [N], above 0 where the tangential part of the
        force opposes the HIP's tangential motion Δx_t = Δx - (n·Δx) n; path |Δx_t| [m]; lag
        (x - p)·Δx_t/|Δx_t| [m], how far the proxy trails behind the HIP. Zero where the fixture
        does not push.
        """
        ticks, normal = self.ticks, self.ticks.normal
        along = self.dhip - dots(normal, self.dhip)[:, None] * normal
        path = np.where(self.held, row_norms(along), 0.0)
        drag, lag = (
            np.divide(dots(vectors, along), path, out=np.zeros_like(path), where=path > 0)
            for vectors in (-ticks.force, ticks.hip - ticks.proxy)
        )
        press = np.where(self.held, dots(normal, ticks.force), 0.0)
        return press, drag, path, lag

    @cached_property
    def sums(self) -> dict[str, Array]:
        """What is summed over ticks, by the report's name: (n,), and F_k Δt_k (n, 3) [N·s]."""
        press, drag, path, _ = self.sliding
        impulse = self.ticks.force * self.dt[:, None]
        columns = impulse, self.work_j, self.hold_j, path, press * path, drag * path
        return dict(zip(SUMS, (self.dt, *columns), strict=True))

    @cached_property
    def peaks(self) -> dict[str, Array]:
        """(n,) of what the largest is reported, by the report's name."""
        ticks = self.ticks
        columns = ticks.penetration, ticks.overlap, self.force_n, self.force_step_n
        return dict(zip(PEAKS, (*columns, np.abs(self.sliding[-1])), strict=True))


class PairedTicks:
    """Turn blocks into `Steps`, one tick behind; `finish` gives the last tick."""

    def __init__(self) -> None:
        # The last tick and its hand, whose successor is still to come.
        self._last = None
        self._done = 0

    def push(self, block: TickBlock, hand: Array) -> Steps | None:
        """The ticks whose successor is now known; `None` while there are none."""
        if self._last is not None:
            block = concatenate_ticks([self._last[0], block])
            hand = np.concatenate((self._last[1], hand))
        self._last = block[-1:], hand[-1:]
        if len(block) < 2:
            return None
        changes = [np.diff(rows, axis=0) for rows in (block.time, hand, block.hip, block.force)]
        steps = Steps(self._done, block[:-1], hand[:-1], *changes)
        self._done += len(steps)
        return steps

    def finish(self) -> Steps | None:
        """The last tick: its differences are zero."""
        return self.push(*self._last)


class Number(NamedTuple):
    """A number of the report, and how a text, a page and docs/replay.md give it.

    unit, decimals: as it is written; the report holds SI units
    label: its words in a table of the whole session; empty where it is not in one
    column: the same in a table of episodes
    """

    key: str
    unit: str
    decimals: int
    label: str = ""
    column: str = ""

    def suiting(self, *values: float | None) -> Number:
        """The number in m where its values have outgrown its µm: a wrong unit is seen by that."""
        if self.unit == "µm" and any(MM * abs(value or 0.0) > 1 for value in values):
            return self._replace(unit="m", decimals=3)
        return self

    def text(self, value: float | None) -> str:
        """The value without its unit; nothing if there is none. From 1 mJ it has three digits."""
        if value is None:
            return ""
        shown = FACTORS.get(self.unit, 1) * value
        if self.unit == "mJ" and abs(shown) >= 1:
            return three_digits(shown)
        return f"{shown:z.{self.decimals}f}"


# How many of a unit are in the SI unit.
FACTORS = {"mm": MM, "mm/s": MM, "mJ": MM, "ms": MM, "µm": 1e6}

NUMBERS = (
    Number("duration_s", "s", 3, "duration"),
    Number("contact_s", "s", 3, "time in contact"),
    Number("contact_episodes", "", 0, "contact episodes"),
    Number("start_s", "s", 3, column="start"),
    Number("end_s", "s", 3, column="end"),
    Number("dwell_s", "s", 3, column="contact"),
    Number("penetration_max_m", "mm", 3, "largest penetration (tip to proxy)", "penetration"),
    Number("penetration_rms_m", "mm", 3, "RMS penetration over the session"),
    Number("overlap_max_m", "mm", 3, "farthest beyond {drawn}", "beyond"),
    Number("force_max_n", "N", 3, "largest force", "force"),
    Number("force_rms_n", "N", 3, "RMS force over the session"),
    Number("force_step_max_n", "N", 3, "largest change of force in one tick"),
    Number("speed_max_m_s", "m/s", 3, "largest speed of the tool tip"),
    Number("clearance_min_m", "µm", 2, "least clearance between proxy and wall"),
    Number("band_m", "µm", 2, "band: the clearance may go down to minus this"),
    Number("energy_j", "mJ", 3, "energy given to the hand", "energy"),
    Number("energy_hold_j", "mJ", 3, "energy from holding each force for a tick"),
    Number("friction", "", 3, "apparent friction"),
    Number("lag_rms_m", "µm", 2, "RMS lag of the proxy while sliding"),
    Number("lateral_max_m", "mm", 3, "farthest from the guide's line"),
    Number("fixture_energy_j", "mJ", 3),
    Number("pose_age_max_s", "ms", 1),
    Number("entrenched_ticks", "", 0, "ticks with the proxy inside the wall"),
    Number("too_fast_ticks", "", 0, "ticks too short for the proxy's way"),
    Number("p999", "µs", 2, "time a tick, in 999 of 1000 at most"),
    Number("speed_at_touch_m_s", "mm/s", 1, column="speed at touch"),
    Number("s_m", "mm", 1, column="along the line"),
)

# The last words of a number's key and its unit in the report, the longest first.
UNITS = {
    "_m_s": "m/s", "_n_per_m": "N/m", "_deg": "°", "_ticks": "ticks", "_tick": "tick", "_hz": "Hz",
    "_us": "µs", "_mm": "mm", "_nm": "N·m", "_j": "J", "_n": "N", "_s": "s", "_m": "m",
}  # fmt: skip


def unit_of(key: str) -> str:
    """The unit that a number has in the report, by the ending of its key; empty for none."""
    return next((unit for ending, unit in UNITS.items() if key.endswith(ending)), "")


# Runs of contact closer than this [s] are one episode. A touch that flickers is one touch, and no
# hand lets go and touches again as fast.
JOIN_S = 0.01

# The deepest episodes that are reported one by one. Of the others the report has their number and
# their largest values, so that a report stays readable and bounded.
MAX_EPISODES = 1000

# What is known of an episode and not reported as it is.
UNREPORTED = {"press_path", "drag_work", "touch", "leave"}


class Episodes:
    """Collect episodes from `Steps`, block after block.

    An episode, or as much of it as has been read, is a dict as it is reported, and holds also the
    proxy's places where it began and ended. Sums run over its ticks.

    slack_m: how far the proxy may move out under the peak force of a passive episode
    """

    def __init__(self, slack_m: float) -> None:
        self._slack_m = slack_m
        # Of the step that led to the next tick: the speed, and the energy by holding (0 within a
        # contact).
        self._speed = None
        self._hold_j = 0.0
        # The latest episode, which the next ticks may continue.
        self._latest = {}
        # A heap of (depth, minus the number, episode): the least deep, latest, first.
        self._deepest = []
        self._unlisted = {"count": 0, "penetration_max_m": 0.0, "active": 0}
        self.count = 0

    def update(self, steps: Steps) -> None:
        """Add the next ticks."""
        for rows in runs(steps.held, closed=False):
            run = self._measure(steps, int(rows[0]), int(rows[-1]) + 1)
            if self._latest and run["start_s"] - self._latest["end_s"] <= JOIN_S:
                self._extend_latest(run)
            else:
                self._finish_latest()
                self._latest = run
        self._speed = float(steps.speed[-1])
        self._hold_j = 0.0 if steps.held[-1] else float(steps.hold_j[-1])

    def report(self, ruler: CurveRuler | None) -> Report:
        """`episodes`, in the order of time, and `episodes_left_out` where there were more."""
        self._finish_latest()
        listed = []
        for _, minus_number, episode in sorted(self._deepest, key=lambda entry: -entry[1]):
            told = {n: v for n, v in episode.items() if n not in UNREPORTED and v is not None}
            described = {"index": -minus_number, **told, "passive": self._is_passive(episode)}
            if episode["press_path"] > 0:
                described["friction"] = episode["drag_work"] / episode["press_path"]
            if ruler is not None:
                described |= {
                    "start_along": ruler.locate(episode["touch"]),
                    "deepest_along": ruler.locate(episode["deepest"]["proxy_m"]),
                    "end_along": ruler.locate(episode["leave"]),
                }
            listed.append(to_json_types(described))
        if not self._unlisted["count"]:
            return {"episodes": listed}
        return {"episodes": listed, "episodes_left_out": dict(self._unlisted)}

    def _is_passive(self, episode: Report) -> bool:
        """Whether its energy is what holding each force for a tick explains."""
        explained = episode["energy_hold_j"] + self._slack_m * episode["force_max_n"]
        return bool(episode["energy_j"] <= explained)

    def _extend_latest(self, run: Report) -> None:
        """Join a run of contact to the latest episode."""
        episode = self._latest
        peak = max(episode["energy_peak_j"], episode["energy_j"] + run["energy_peak_j"])
        deepest = max(episode, run, key=lambda part: part["penetration_max_m"])["deepest"]
        episode |= {name: run[name] for name in ("end_s", "end_tick", "leave")}
        episode |= {name: episode[name] + run[name] for name in ("ticks", *SUMS)}
        episode |= {name: max(episode[name], run[name]) for name in PEAKS}
        episode |= {"energy_peak_j": peak, "deepest": deepest}

    def _finish_latest(self) -> None:
        """Put the latest episode to the others; nothing is joined to it any more."""
        if not self._latest:
            return
        entry = self._latest["penetration_max_m"], -self.count, self._latest
        self._latest = {}
        self.count += 1
        heapq.heappush(self._deepest, entry)
        if len(self._deepest) > MAX_EPISODES:
            depth, _, episode = heapq.heappop(self._deepest)
            self._unlisted["count"] += 1
            self._unlisted["penetration_max_m"] = max(self._unlisted["penetration_max_m"], depth)
            self._unlisted["active"] += not self._is_passive(episode)

    def _measure(self, steps: Steps, start: int, end: int) -> Report:
        """A run of contact from row `start` to before row `end`."""
        rows = slice(start, end)
        ticks = steps.ticks
        deepest = start + int(np.argmax(ticks.penetration[rows]))
        # The step into contact loads the spring, though its force was still 0.
        speed_at_touch, hold_before = self._speed, self._hold_j
        if start > 0:
            speed_at_touch, hold_before = steps.speed[start - 1], steps.hold_j[start - 1]
        run = {
            "start_s": float(ticks.time[start]),
            "end_s": float(ticks.time[end - 1] + steps.dt[end - 1]),
            "start_tick": steps.first + start,
            "end_tick": steps.first + end - 1,
            "ticks": end - start,
            **{name: float(values[rows].max()) for name, values in steps.peaks.items()},
            **{name: values[rows].sum(axis=0) for name, values in steps.sums.items()},
        }
        run["energy_hold_j"] += hold_before
        # The sum over all ticks is one of the partial sums, but for its rounding.
        highest = float(np.cumsum(steps.work_j[rows]).max())
        run["energy_peak_j"] = max(0.0, highest, run["energy_j"])
        run["speed_at_touch_m_s"] = speed_at_touch
        # Copies, because a view would keep its whole block in memory.
        run["deepest"] = {
            "t_s": ticks.time[deepest],
            "tick": steps.first + deepest,
            "hip_m": ticks.hip[deepest].copy(),
            "proxy_m": ticks.proxy[deepest].copy(),
        }
        run["touch"] = ticks.proxy[start].copy()
        run["leave"] = ticks.proxy[end - 1].copy()
        return run


def episode_count(report: Report) -> int:
    """How many episodes a replay had, also those that its report does not list."""
    return len(report["episodes"]) + report.get("episodes_left_out", {"count": 0})["count"]


# Distances that are held in memory at a time, about 50 MB.
PAIRS_AT_ONCE = 2_000_000


class CurveRuler:
    """Arc length along a fixture's strokes.

    fixture: one with a `curve`
    """

    def __init__(self, fixture: Fixture) -> None:
        self.points = flattened(fixture.points, fixture.ignore_axis)
        self._axis = fixture.ignore_axis
        self.stroke = fixture.curve.stroke
        lengths = [arc_lengths(stroke.points, closed=False) for stroke in fixture.strokes]
        self.arclength = np.concatenate(lengths)

    @staticmethod
    def of(fixture: Fixture) -> CurveRuler | None:
        """The ruler of a fixture, or `None` when it was not drawn as a curve."""
        return None if fixture.curve is None else CurveRuler(fixture)

    def locate(self, place: Array) -> Report:
        """The stroke, the arc length [m] and the index of the planned point nearest to a place."""
        k = int(self.nearest(place[None])[0])
        return {"stroke": int(self.stroke[k]), "s_m": float(self.arclength[k]), "point": k}

    def nearest(self, places: Array) -> NDArray[np.intp]:
        """(n,) index of the planned point nearest to each of (n, 3) places, by brute force."""
        flat = flattened(places, self._axis)
        parts = np.array_split(flat, 1 + len(flat) * len(self.points) // PAIRS_AT_ONCE)
        squares = (((part[:, None] - self.points) ** 2).sum(2) for part in parts)
        return np.concatenate([distances.argmin(1) for distances in squares])


# Name -> (the robot's limit, the number of the report that it bounds)
LIMITS = {
    "force": ("force_limit_n", "force_max_n"),
    "force_step": ("force_step_limit_n", "force_step_max_n"),
    "speed": ("speed_limit_m_s", "session.speed_max_m_s"),
}


class Metrics:
    """Sums, maxima and episodes over a replay.

    fixture: the fixture that is replayed
    engine: as `make_engine` gives it
    robot: whose limits to watch, or `None`
    """

    def __init__(self, fixture: Fixture, engine: Any, robot: Robot | None) -> None:
        # As reported; a limit that the robot does not have is absent.
        self._robot = {}
        if robot is not None:
            self._robot = {"name": robot.name, "rate_hz": robot.rate_hz}
            for name, (key, _) in LIMITS.items():
                if getattr(robot, key) is not None:
                    self._robot |= {key: getattr(robot, key), f"{name}_over_ticks": 0}
        self._parameters = parameters = engine.parameters
        # Of the proxy from the fixture [m]; a guide alone forbids nothing.
        self._measure = None if fixture.region is None else engine.distance
        self._distance = np.inf
        self._ruler = CurveRuler.of(fixture)
        # A passive episode moves the proxy by no more than what the rule leaves open: the band, or
        # how far lines and arcs are from the curve.
        has_pieces = parameters.rule == "exact" and fixture.pieces
        self._episodes = Episodes(fixture.pieces.error if has_pieces else parameters.band)
        self._states = np.zeros(len(STATES), dtype=np.int64)
        self._state_s = np.zeros(len(STATES))
        self._sums = defaultdict(float)
        self._peaks = defaultdict(float)
        self._start_s = self._end_s = 0.0
        self._force_step = Largest()
        # In how many ticks the engine said each of its words.
        self.status = dict.fromkeys((flag.name.lower() for flag in Status), 0)

    def note_status(self, status: NDArray[np.uint8]) -> None:
        """Count what the engine said of each tick."""
        for flag in Status:
            self.status[flag.name.lower()] += int(np.count_nonzero(status & flag))

    def update(self, steps: Steps) -> None:
        """Take in the next ticks."""
        ticks = steps.ticks
        if steps.first == 0:
            self._start_s = float(ticks.time[0])
        self._end_s = float(ticks.time[-1] + steps.dt[-1])
        if self._measure is not None:
            self._distance = min(self._distance, float(self._measure(ticks.proxy).min()))
        # The ticks in which the robot would have objected. A Franka arm refuses a change of torque
        # above 1 N·m from one tick to the next (about 1.2 N at the tip at a reach of 0.85 m) and
        # stops at its reflex threshold.
        limited = {"force": steps.force_n, "force_step": steps.force_step_n, "speed": steps.speed}
        for name, (key, _) in LIMITS.items():
            if key in self._robot:
                is_over = limited[name] > self._robot[key]
                self._robot[f"{name}_over_ticks"] += int(np.count_nonzero(is_over))
        self._episodes.update(steps)
        self._states += np.bincount(ticks.state + 1, minlength=len(STATES))
        self._state_s += np.bincount(ticks.state + 1, steps.dt, minlength=len(STATES))
        # The step from tick k to k + 1 belongs to the tick that shows it.
        self._force_step.update(steps.force_step_n, steps.first + 1)
        for name, values in steps.peaks.items():
            self._peaks[name] = max(self._peaks[name], float(values.max()))
        summands = {
            **steps.sums,
            "contact_ticks": steps.held,
            "contact_s": steps.dt[steps.held],
            "fast": row_norms(steps.dhip) > self._parameters.r1,
            "penetration2": steps.ticks.penetration**2,
            "force2": steps.force_n**2,
            "lag2_path": steps.sliding[-1] ** 2 * steps.sums["slide_m"],
        }
        for name, values in summands.items():
            self._sums[name] += float(values.sum())

    def report(self) -> Report:
        """The contract's keys, and this project's own."""
        sums, peaks = self._sums, self._peaks
        ticks = int(self._states.sum())
        contact_ticks = max(1.0, sums["contact_ticks"])

        def rms(squares: str, count: float) -> float:
            return float(np.sqrt(sums[squares] / count))

        # The paper's proxy moves at most r1 a tick (eq. 5); the robust rule says when its
        # iterations ran out.
        is_paper = self._parameters.rule == "paper"
        data = {
            "ticks": ticks,
            "duration_s": self._end_s - self._start_s,
            "contact_ticks": int(sums["contact_ticks"]),
            "contact_s": sums["contact_s"],
            **self._episodes.report(self._ruler),
            "penetration_max_m": peaks["penetration_max_m"],
            "penetration_rms_m": rms("penetration2", ticks),
            "penetration_contact_rms_m": rms("penetration2", contact_ticks),
            "force_max_n": peaks["force_max_n"],
            "force_rms_n": rms("force2", ticks),
            "force_contact_rms_n": rms("force2", contact_ticks),
            "force_step_max_n": peaks["force_step_max_n"],
            "force_step_max_tick": self._force_step.tick,
            "bad_hip_ticks": self.status["bad_hip"],
            "inside_ticks": self.status["inside"],
            "too_fast_ticks": int(sums["fast"]) if is_paper else self.status["limit"],
            "energy_j": sums["energy_j"],
            "energy_hold_j": sums["energy_hold_j"],
            "states": dict(zip(map(str, STATES), self._states.tolist(), strict=True)),
            "states_s": dict(zip(map(str, STATES), self._state_s.tolist(), strict=True)),
        }
        if self._measure is not None:
            data |= {
                "overlap_max_m": peaks["overlap_max_m"],
                "clearance_min_m": self._distance - self._parameters.R,
                "entrenched_ticks": int(self._states[STATES.index(2)]),
            }
        if sums["press_path"] > 0:
            data["friction"] = sums["drag_work"] / sums["press_path"]
        if sums["slide_m"] > 0:
            data["slide_m"] = sums["slide_m"]
            data["lag_max_m"] = peaks["lag_max_m"]
            data["lag_rms_m"] = rms("lag2_path", sums["slide_m"])
        if self._robot:
            data["robot"] = self._robot
        return data


# Edges of the histogram of a tick's time [µs], each 1.1 % above the one before: a clock is no more
# exact.
EDGES_US = 1e-3 * 2.0 ** (np.arange(40 * 64 + 1) / 64)


class StepTimes:
    """A histogram of the engine's time per tick, each bin 1.1 % wide.

    The native engine times each tick itself; any other is stepped and timed from Python.
    """

    def __init__(self) -> None:
        self._counts = np.zeros(len(EDGES_US) - 1, dtype=np.int64)
        self._max_us = 0.0
        self.ticks = 0

    def run(self, engine: Any, hip: Array) -> Trace:
        """`engine.run(hip)`, timed."""
        self.ticks += len(hip)
        trace, micros = timed(engine, hip)
        self._counts += np.histogram(np.clip(micros, *EDGES_US[[0, -1]]), EDGES_US)[0]
        self._max_us = max(self._max_us, float(micros.max(initial=0.0)))
        return trace

    def report(self) -> dict[str, float]:
        """Median, 99th and 99.9th percentile, and maximum [µs]."""
        total = np.cumsum(self._counts)
        bins = np.searchsorted(total, np.multiply((0.5, 0.99, 0.999), total[-1]))
        quantiles = np.minimum(np.sqrt(EDGES_US[bins] * EDGES_US[bins + 1]), self._max_us)
        names = ("median", "p99", "p999", "max")
        return dict(zip(names, [*quantiles.tolist(), self._max_us], strict=True))


def timed(engine: Any, hip: Array) -> tuple[Trace, Array]:
    """`engine.run(hip)`, and the time of each tick (n,) [µs].

    The native engine times itself around each step; any other is stepped from Python.
    """
    if hasattr(engine, "run_timed"):
        return engine.run_timed(hip)
    steps = []
    clock = [time.perf_counter_ns()]
    for place in hip:
        steps.append(engine.step(place))
        clock.append(time.perf_counter_ns())
    return Trace.of(steps), np.diff(clock) / 1e3
