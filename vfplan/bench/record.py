"""What the bench measures, side by side, and how it is written down: runs in, results out.

A run is one method with one set of settings on one scene. It is repeated; its error is scored once
(every method here is deterministic), its time by the median over all repeats."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError
from vfplan.geometry import ROUNDING_M
from vfplan.replaying.timing import timed as timed_run

Array = NDArray[np.float64]
Setting = str | float | int | bool | None
Record = dict[str, Any]
Advance = Callable[[int], None]

SMALLEST_ERROR_M = ROUNDING_M
"""Errors below a nanometre [m] are rounding, and count as equal."""

FEWEST_REPEATS = 3
"""Number of timed repeats after which a slow run is timed well enough."""

TIMED_ENOUGH_S = 0.25
"""Time [s] that a run must have taken for that."""


def errors_of(distances: Any, **figures: Any) -> Record:
    """RMS and maximum of distances of any shape, and the other figures of a record."""
    d = np.abs(np.asarray(distances, float))
    return {"error_rms": float(np.sqrt(np.mean(d**2))), "error_max": float(d.max()), **figures}


@dataclass(frozen=True, eq=False)
class BenchRun:
    """One point of a work-precision diagram, yet to be measured."""

    # What is compared, by whom, how it is set
    scene: str
    method: str
    settings: dict[str, Setting]
    # Does the work once: the answer and the times of its parts (K,) [µs] (one element for a call,
    # one a tick for an engine)
    run: Callable[[], tuple[Any, Array]]
    # From the answer to `errors_of` it, and the unit of the errors, "px" or "m"
    score: Callable[[Any], Record]
    unit: str
    # Whether these are the settings that `vfplan.planning.tolerance` takes from the tolerance
    chosen: bool = False
    # Whether an outside program does it
    peer: bool = False

    @property
    def head(self) -> Record:
        """What a record of it begins with."""
        return {"scene": self.scene, "method": self.method, "settings": self.settings}


def time_us(repeats: list[Array]) -> Record:
    """Median and tail of the parts' times, and how far the repeats' medians spread [µs].

    Parameters
    ----------
    repeats
        A (K,) array of times for each repeat. Of several parts, as ticks are, each counts with its
        shortest time over the repeats: what the work takes where the system interrupts nothing. A
        single call counts as often as it ran.
    """
    times = np.min(repeats, axis=0) if len(repeats[0]) > 1 else np.concatenate(repeats)
    median, p99, p999 = np.quantile(times, [0.5, 0.99, 0.999])
    low, high = np.quantile([np.median(repeat) for repeat in repeats], [0.25, 0.75])
    return {
        "time_us_median": float(median),
        "time_us_p99": float(p99),
        "time_us_p999": float(p999),
        "time_us_max": float(times.max()),
        "time_us_low": float(min(low, median)),
        "time_us_high": float(max(high, median)),
    }


def mark_pareto(records: list[Record]) -> None:
    """Set `pareto` in every record: nothing of its stage and scene is as good and cheaper.

    A record is dominated when another's `error_rms` and `time_us_median` are both no larger and
    one of them is smaller. Errors are compared as `comparable_error` rounds them: two programs of
    one rule differ in the last bits.
    """
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in records:
        groups.setdefault((record["stage"], record["scene"]), []).append(record)
    for group in groups.values():
        values = np.array([[comparable_error(r), r["time_us_median"]] for r in group])
        for record, is_on_front in zip(group, non_dominated(values), strict=True):
            record["pareto"] = bool(is_on_front)


def comparable_error(record: Record) -> float:
    """The RMS error to six digits, and to a nanometre where it is one in metres."""
    error = float(f"{record['error_rms']:.6g}")
    if record.get("unit") == "m":
        error = max(error, SMALLEST_ERROR_M)
    return error


def judge_chosen(records: list[Record], tolerance_m: float) -> None:
    """Say of each chosen record whether it keeps the tolerance, and how far from cheapest it is.

    `meets_tolerance`
        The surface's error (`surface_error_m` and `inside_m`; in stage sample `error_max`) is
        within it: what `--tolerance` promises.
    `follows`
        Stage proxy: so is the proxy's RMS error, along the surface too, over the ticks that an
        engine can follow (`followed_rms_m`).
    `time_over_cheapest`
        Its median time over that of the cheapest record of its stage and scene that keeps the
        surface as well and the proxy as close, to the tolerance or as the chosen one does.
    """
    for chosen in records:
        if not chosen.get("chosen") or chosen["stage"] not in ("sample", "proxy"):
            continue
        followed_m = chosen.get("followed_rms_m", 0.0)
        allowed_m = max(followed_m, tolerance_m)
        times = []
        for rival in records:
            if rival["stage"] != chosen["stage"] or rival["scene"] != chosen["scene"]:
                continue
            keeps_proxy = rival.get("followed_rms_m", 0.0) <= allowed_m
            if keeps_surface(rival, tolerance_m) and keeps_proxy:
                times.append(rival["time_us_median"])
        chosen["meets_tolerance"] = keeps_surface(chosen, tolerance_m)
        if "followed_rms_m" in chosen:
            chosen["follows"] = bool(followed_m <= tolerance_m)
        chosen["time_over_cheapest"] = None
        if times:
            chosen["time_over_cheapest"] = chosen["time_us_median"] / min(times)


def keeps_surface(record: Record, tolerance_m: float) -> bool:
    """Whether the rendered surface is within the tolerance of the planned one."""
    surface_m = record.get("surface_error_m", record["error_max"])
    return bool(max(surface_m, record.get("inside_m", 0.0)) <= tolerance_m)


def non_dominated(values: Array) -> NDArray[np.bool_]:
    """(N,) which rows of (N, K) no other row beats: as small in every column, smaller in one."""
    no_larger = (values[:, None, :] <= values[None, :, :]).all(axis=2)
    smaller = (values[:, None, :] < values[None, :, :]).any(axis=2)
    return ~(no_larger & smaller).any(axis=0)


def timed(work: Callable[[], Any]) -> tuple[Any, Array]:
    """The answer of a call, and its time as (1,) [µs]."""
    started = time.perf_counter_ns()
    answer = work()
    return answer, np.array([(time.perf_counter_ns() - started) / 1e3])


def measure_runs(
    stage: str, runs: Sequence[BenchRun], repeats: int, advance: Advance = lambda count: None
) -> tuple[list[Record], list[Record]]:
    """Measure the runs of one scene: a record for each, and those that refused their input.

    Every round does each run once, in another order each time; the first round warms caches up
    and gives the answers to score, and is not timed. Slow runs stop after the first rounds.

    Parameters
    ----------
    stage
        The records' stage.
    runs
        Of one scene.
    repeats
        Timed rounds, at most.
    advance
        Called with 1 for each run in each round, len(runs) * (1 + repeats) times in all.
    """
    rng = np.random.default_rng(0)
    records: dict[int, Record] = {}
    refused: list[Record] = []
    for i, bench_run in enumerate(runs):
        head = {"stage": stage, **bench_run.head}
        try:
            answer, _ = bench_run.run()
            records[i] = head | bench_run.score(answer) | {"unit": bench_run.unit}
        except InputError as error:
            refused.append(head | {"message": error.message})
        advance(1)
    times: dict[int, list[Array]] = {i: [] for i in records}
    spent_s = dict.fromkeys(records, 0.0)
    for _ in range(repeats):
        for i in rng.permutation(len(runs)):
            advance(1)
            if i not in records:
                continue
            if len(times[i]) >= FEWEST_REPEATS and spent_s[i] > TIMED_ENOUGH_S:
                continue
            _, us = runs[i].run()
            times[i].append(us)
            spent_s[i] += 1e-6 * us.sum()
    for i, record in records.items():
        record |= time_us(times[i]) | {"repeats": len(times[i])}
        if runs[i].chosen:
            record["chosen"] = True
        if runs[i].peer:
            record["peer"] = True
    return list(records.values()), refused


def timed_ticks(engine: Any, hips: Array) -> tuple[Any, Array]:
    """Run a path from its first HIP on: the trace, and the time of each tick (T,) [µs]."""
    engine.reset(hips[0])
    return timed_run(engine, hips)
