"""What the bench measures, side by side, and how it is written down: trials in, results out.

A trial is one method with one set of settings on one scene. It runs several times; its error is
scored once (every method here is deterministic), its time by the median over all runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError

Array = NDArray[np.float64]
Setting = str | float | int | bool | None


class Errors(NamedTuple):
    """How far an answer is from the truth, in the trial's unit; `more` is named in the JSON."""

    rms: float
    max: float
    more: dict[str, Any] = {}  # noqa: RUF012 - a NamedTuple's default is never written to

    @classmethod
    def of(cls, distances: Any, **more: Any) -> Errors:
        """RMS and maximum of distances, any shape."""
        d = np.abs(np.asarray(distances, float))
        return cls(float(np.sqrt(np.mean(d**2))), float(d.max()), more)


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
    score: Callable[[Any], Errors]  # answer -> `Errors`
    unit: str  # of the errors: "px" or "m"
    # Whether these are the settings that `vfplan.engine.tolerance` takes from the tolerance
    chosen: bool = False
    peer: bool = False  # whether an outside program does it


@dataclass(frozen=True, eq=False)
class Refusal:
    """A trial whose method found its input unusable, and said so."""

    stage: str
    trial: Trial
    message: str

    def record(self) -> dict[str, Any]:
        """As the JSON holds it."""
        t = self.trial
        names = {"scene": t.scene, "method": t.method, "settings": t.settings}
        return {"stage": self.stage, **names, "message": self.message}


@dataclass(frozen=True, eq=False)
class Result:
    """A measured trial."""

    stage: str  # "extract", "sample", "register", "proxy", "feel" or "plan"
    trial: Trial  # what was measured
    errors: Errors  # against the truth
    times: list[Array] = field(repr=False)  # (repeats, K) [µs]

    @property
    def time_us(self) -> dict[str, float]:
        """Medians and tails over all parts of all runs [µs]."""
        everything = np.concatenate(self.times)
        medians = np.array([np.median(run) for run in self.times])
        q = np.quantile(everything, [0.5, 0.99, 0.999])
        low, high = np.quantile(medians, [0.25, 0.75])
        return {
            "time_us_median": float(q[0]),
            "time_us_p99": float(q[1]),
            "time_us_p999": float(q[2]),
            "time_us_max": float(everything.max()),
            "time_us_low": float(min(low, q[0])),
            "time_us_high": float(max(high, q[0])),
        }

    def record(self) -> dict[str, Any]:
        """The result as the JSON holds it, `pareto` aside."""
        t = self.trial
        data = {
            "stage": self.stage,
            "scene": t.scene,
            "method": t.method,
            "settings": t.settings,
            "error_rms": self.errors.rms,
            "error_max": self.errors.max,
            "unit": t.unit,
            **self.time_us,
            "repeats": len(self.times),
            **self.errors.more,
        }
        if t.chosen:
            data["chosen"] = True
        if t.peer:
            data["peer"] = True
        return data


def mark_pareto(records: list[dict[str, Any]]) -> None:
    """Set `pareto` in every record: nothing of its stage and scene is as good and cheaper.

    A record is dominated when another's `error_rms` and `time_us_median` are both no larger and
    one of them is smaller.
    """
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for record in records:
        groups.setdefault((record["stage"], record["scene"]), []).append(record)
    for group in groups.values():
        values = np.array([[r["error_rms"], r["time_us_median"]] for r in group])
        for record, front in zip(group, non_dominated(values), strict=True):
            record["pareto"] = bool(front)


def judge_chosen(records: list[dict[str, Any]], tolerance_m: float) -> None:
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


def _surface_within(record: dict[str, Any], tolerance_m: float) -> bool:
    worst = record.get("surface_error_m", record["error_max"])
    return bool(max(worst, record.get("inside_m", 0.0)) <= tolerance_m)


def non_dominated(values: Array) -> NDArray[np.bool_]:
    """(N,) which rows of (N, K) no other row beats: as small in every column, smaller in one."""
    no_larger = (values[:, None, :] <= values[None, :, :]).all(axis=2)
    smaller = (values[:, None, :] < values[None, :, :]).any(axis=2)
    return ~(no_larger & smaller).any(axis=0)


def timed(work: Callable[[], Any]) -> tuple[Any, Array]:
    """The answer of a call, and its time as (1,) [µs]."""
    import time

    began = time.perf_counter_ns()
    answer = work()
    return answer, np.array([(time.perf_counter_ns() - began) / 1e3])


Advance = Callable[[int], None]
FEWEST, ENOUGH_S = 3, 0.25  # a trial timed so often and for so long sits out the other rounds


def run_trials(
    stage: str, trials: Sequence[Trial], repeats: int, advance: Advance = lambda n: None
) -> tuple[list[Result], list[Refusal]]:
    """Measure the trials of one scene: their results, and the trials that refused their input.

    Every round runs each trial once, in another order each time; the first round warms caches up
    and gives the answers to score, and is not timed. Slow trials run in the first rounds only.

    stage: the results' stage
    trials: of one scene
    repeats: timed rounds, at most
    advance: told 1 for each trial in each round, len(trials) * (1 + repeats) in all
    """
    rng = np.random.default_rng(0)
    errors: dict[int, Errors] = {}
    refused: list[Refusal] = []
    for i, trial in enumerate(trials):
        try:
            errors[i] = trial.score(trial.run()[0])
        except InputError as error:
            refused.append(Refusal(stage, trial, error.message))
        advance(1)
    times: dict[int, list[np.ndarray]] = {i: [] for i in errors}
    for _ in range(repeats):
        for i in rng.permutation(len(trials)):
            if i in errors and not _enough(times[i]):
                times[i].append(trials[i].run()[1])
            advance(1)
    return [Result(stage, trials[i], errors[i], times[i]) for i in errors], refused


def _enough(times: list[np.ndarray]) -> bool:
    return len(times) >= FEWEST and 1e-6 * sum(run.sum() for run in times) > ENOUGH_S


def timed_ticks(engine: Any, hips: Array) -> tuple[Any, Array]:
    """Run a path from its first HIP on: the trace, and the time of each tick (T,) [µs].

    The native engine times itself around each step; any other is stepped from Python.
    """
    engine.reset(hips[0])
    if hasattr(engine, "run_timed"):
        return engine.run_timed(hips)
    steps, times = [], np.empty(len(hips))
    for i, hip in enumerate(hips):
        began = time.perf_counter_ns()
        steps.append(engine.step(hip))
        times[i] = (time.perf_counter_ns() - began) / 1e3
    return stack(steps), times


def stack(steps: list[Any]) -> Any:
    """Steps as a `Trace`."""
    from vfplan.engine.parameters import Trace

    return Trace(
        proxy=np.array([s.proxy for s in steps]),
        normal=np.array([s.normal for s in steps]),
        force=np.array([s.force for s in steps]),
        state=np.array([s.state for s in steps], np.int8),
        status=np.array([s.status for s in steps], np.uint8),
    )
