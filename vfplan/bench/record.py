"""What the bench measures, side by side, and how it is written down: trials in, results out.

A trial is one method with one set of settings on one scene. It runs several times; its error is
scored once (every method here is deterministic), its time by the median over all runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError
from vfplan.replaying import timing

Array = NDArray[np.float64]
Setting = str | float | int | bool | None


Record = dict[str, Any]


def errors_of(distances: Any, **more: Any) -> Record:
    """RMS and maximum of distances of any shape, and what else is told of them."""
    d = np.abs(np.asarray(distances, float))
    return {"error_rms": float(np.sqrt(np.mean(d**2))), "error_max": float(d.max()), **more}


@dataclass(frozen=True, eq=False)
class Trial:
    """One point of a work-precision diagram, yet to be measured."""

    # What is compared, by whom, how it is set
    scene: str
    method: str
    settings: dict[str, Setting]
    # Does the work once: the answer and the times of its parts (K,) [µs] (one element for a call,
    # one a tick for an engine)
    run: Callable[[], tuple[Any, Array]]
    score: Callable[[Any], Record]  # answer -> `errors_of` it
    unit: str  # of the errors: "px" or "m"
    # Whether these are the settings that `vfplan.planning.tolerance` takes from the tolerance
    chosen: bool = False
    peer: bool = False  # whether an outside program does it

    @property
    def head(self) -> Record:
        """What a record of it begins with."""
        return {"scene": self.scene, "method": self.method, "settings": self.settings}


def time_us(runs: list[Array]) -> Record:
    """Median and tail of the parts' times, and how far the runs' medians spread [µs].

    runs: (repeats, K). Of several parts, as ticks are, each counts with its least time over the
        runs: what the work takes where the system interrupts nothing. A single call counts as often
        as it ran.
    """
    if len(runs[0]) > 1:
        everything = np.min(runs, axis=0)
    else:
        everything = np.concatenate(runs)
    median, p99, p999 = np.quantile(everything, [0.5, 0.99, 0.999])
    low, high = np.quantile([np.median(run) for run in runs], [0.25, 0.75])
    found = {
        "median": median, "p99": p99, "p999": p999, "max": everything.max(),
        "low": min(low, median), "high": max(high, median),
    }  # fmt: skip
    return {f"time_us_{name}": float(value) for name, value in found.items()}


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
        for record, front in zip(group, non_dominated(values), strict=True):
            record["pareto"] = bool(front)


def comparable_error(record: Record) -> float:
    """The RMS error to six digits, and to a nanometre where it is one in metres."""
    error = float(f"{record['error_rms']:.6g}")
    if record.get("unit") == "m":
        error = max(error, 1e-9)
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
        surface as well and the proxy as near, to the tolerance or as the chosen one does.
    """
    for chosen in (r for r in records if r.get("chosen") and r["stage"] in ("sample", "proxy")):
        own = chosen.get("followed_rms_m", 0.0)
        near = max(own, tolerance_m)
        rivals = [r for r in records if all(r[k] == chosen[k] for k in ("stage", "scene"))]
        within = [
            r["time_us_median"]
            for r in rivals
            if _surface_within(r, tolerance_m) and r.get("followed_rms_m", 0.0) <= near
        ]
        chosen["meets_tolerance"] = _surface_within(chosen, tolerance_m)
        if "followed_rms_m" in chosen:
            chosen["follows"] = bool(own <= tolerance_m)
        chosen["time_over_cheapest"] = chosen["time_us_median"] / min(within) if within else None


def _surface_within(record: Record, tolerance_m: float) -> bool:
    worst = record.get("surface_error_m", record["error_max"])
    return bool(max(worst, record.get("inside_m", 0.0)) <= tolerance_m)


def non_dominated(values: Array) -> NDArray[np.bool_]:
    """(N,) which rows of (N, K) no other row beats: as small in every column, smaller in one."""
    no_larger = (values[:, None, :] <= values[None, :, :]).all(axis=2)
    smaller = (values[:, None, :] < values[None, :, :]).any(axis=2)
    return ~(no_larger & smaller).any(axis=0)


def timed(work: Callable[[], Any]) -> tuple[Any, Array]:
    """The answer of a call, and its time as (1,) [µs]."""
    began = time.perf_counter_ns()
    answer = work()
    return answer, np.array([(time.perf_counter_ns() - began) / 1e3])


Advance = Callable[[int], None]
FEWEST, ENOUGH_S = 3, 0.25  # a trial timed so often and for so long sits out the other rounds


def run_trials(
    stage: str, trials: Sequence[Trial], repeats: int, advance: Advance = lambda n: None
) -> tuple[list[Record], list[Record]]:
    """Measure the trials of one scene: a record a trial, and those that refused their input.

    Every round runs each trial once, in another order each time; the first round warms caches up
    and gives the answers to score, and is not timed. Slow trials run in the first rounds only.

    stage: the records' stage
    trials: of one scene
    repeats: timed rounds, at most
    advance: told 1 for each trial in each round, len(trials) * (1 + repeats) in all
    """
    rng = np.random.default_rng(0)
    records: dict[int, Record] = {}
    refused: list[Record] = []
    for i, trial in enumerate(trials):
        head = {"stage": stage, **trial.head}
        try:
            records[i] = head | trial.score(trial.run()[0]) | {"unit": trial.unit}
        except InputError as error:
            refused.append(head | {"message": error.message})
        advance(1)
    times: dict[int, list[Array]] = {i: [] for i in records}
    for _ in range(repeats):
        for i in rng.permutation(len(trials)):
            if i in records and not _enough(times[i]):
                times[i].append(trials[i].run()[1])
            advance(1)
    for i, record in records.items():
        record |= time_us(times[i]) | {"repeats": len(times[i])}
        record |= {flag: True for flag in ("chosen", "peer") if getattr(trials[i], flag)}
    return list(records.values()), refused


def _enough(times: list[Array]) -> bool:
    return len(times) >= FEWEST and 1e-6 * sum(run.sum() for run in times) > ENOUGH_S


def timed_ticks(engine: Any, hips: Array) -> tuple[Any, Array]:
    """Run a path from its first HIP on: the trace, and the time of each tick (T,) [µs]."""
    engine.reset(hips[0])
    return timing.timed(engine, hips)
