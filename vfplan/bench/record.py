"""What the bench measures, side by side, and how it is written down: runs in, results out.

A run is one method with one set of settings on one scene. It is repeated; its error is scored once
(every method here is deterministic), its time by the median over all repeats.

What a bench says: a table, and a sentence a stage on the chosen setting, its error, its time, and
the peers': medians over the scenes. The chosen setting is the one that `vfplan plan` takes without
options, or that `--tolerance` leads to.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vfplan.display import duration, length, three_digits
from vfplan.errors import InputError
from vfplan.geometry import ROUNDING_M
from vfplan.replaying.metrics import timed as timed_run

Array = NDArray[np.float64]
Setting = str | float | int | bool | None
Record = dict[str, Any]
Advance = Callable[[int], None]

# Errors below a nanometre [m] are rounding, and count as equal.
SMALLEST_ERROR_M = ROUNDING_M

# Number of timed repeats after which a slow run is timed well enough.
FEWEST_REPEATS = 3

# Time [s] that a run must have taken for that.
TIMED_ENOUGH_S = 0.25


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


def time_us(repeats: list[Array]) -> Record:
    """Median and tail of the parts' times [µs].

    Parameters
    ----------
    repeats
        A (K,) array of times for each repeat. Of several parts, as ticks are, each counts with its
        shortest time over the repeats: what the work takes where the system interrupts nothing. A
        single call counts as often as it ran.
    """
    times = np.min(repeats, axis=0) if len(repeats[0]) > 1 else np.concatenate(repeats)
    median, tail = np.quantile(times, [0.5, 0.999])
    return {"time_us_median": float(median), "time_us_p999": float(tail)}


def mark_pareto(records: list[Record]) -> None:
    """Set `pareto` in every record: nothing of its stage and scene is as good and cheaper.

    A record is dominated when another's `error_rms` and `time_us_median` are both no larger and
    one of them is smaller. Errors are compared as `comparable_error` rounds them: two programs of
    one rule differ in the last bits.
    """
    for group in grouped(records, "stage", "scene").values():
        values = np.array([[comparable_error(r), r["time_us_median"]] for r in group])
        for record, own in zip(group, values, strict=True):
            is_beaten = (values <= own).all(axis=1) & (values < own).any(axis=1)
            record["pareto"] = not is_beaten.any()


def grouped(records: list[Record], *names: str) -> dict[Any, list[Record]]:
    """The records by what they have under some names, in order."""
    groups: dict[Any, list[Record]] = {}
    for record in records:
        groups.setdefault(itemgetter(*names)(record), []).append(record)
    return groups


def comparable_error(record: Record) -> float:
    """The RMS error to six digits, and to a nanometre where it is one in metres."""
    error = float(f"{record['error_rms']:.6g}")
    return max(error, SMALLEST_ERROR_M) if record.get("unit") == "m" else error


def judge_chosen(records: list[Record], tolerance_m: float) -> None:
    """Say of each chosen record whether its surface keeps the tolerance, `meets_tolerance`.

    The error of a surface is `surface_error_m` and `inside_m`, and in stage sample `error_max`.
    """
    for record in records:
        if record.get("chosen") and record["stage"] in ("sample", "proxy"):
            surface_m = record.get("surface_error_m", record["error_max"])
            largest_m = max(surface_m, record.get("inside_m", 0.0))
            record["meets_tolerance"] = bool(largest_m <= tolerance_m)


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
        Called with how many runs are done; with len(runs) * (1 + repeats) in all.
    """
    rng = np.random.default_rng(0)
    measured: list[tuple[BenchRun, Record, list[Array]]] = []
    refused: list[Record] = []
    for bench_run in runs:
        head = {name: getattr(bench_run, name) for name in ("scene", "method", "settings")}
        head = {"stage": stage, **head}
        try:
            answer, _ = bench_run.run()
            record = head | bench_run.score(answer) | {"unit": bench_run.unit}
            measured.append((bench_run, record, []))
        except InputError as error:
            refused.append(head | {"message": error.message})
        advance(1)
    for _ in range(repeats):
        for i in rng.permutation(len(measured)):
            bench_run, _, times = measured[i]
            spent_s = 1e-6 * sum(us.sum() for us in times)
            if len(times) < FEWEST_REPEATS or spent_s <= TIMED_ENOUGH_S:
                times.append(bench_run.run()[1])
            advance(1)
        advance(len(refused))
    for bench_run, record, times in measured:
        record |= time_us(times) | {"repeats": len(times)}
        record |= {name: True for name in ("chosen", "peer") if getattr(bench_run, name)}
    return [record for _, record, _ in measured], refused


def timed_ticks(engine: Any, hips: Array) -> tuple[Any, Array]:
    """Run a path from its first HIP on: the trace, and the time of each tick (T,) [µs]."""
    engine.reset(hips[0])
    return timed_run(engine, hips)


class StageLook(NamedTuple):
    """How a stage is shown: a title, what its times are of, and in which unit they are drawn."""

    title: str
    part: str
    time_unit: str
    # What a user could take instead: methods that are not this project's own.
    peers: tuple[str, ...]


# Every stage by its name.
LOOKS = {
    "extract": StageLook("extract: the drawn line, one call a slice", "call", "ms",
                         ("hue + thinning", "mask (the paper's)")),
    "sample": StageLook("sample: surface of the cloud, one tick of the engine on it", "tick", "µs",
                        ("the paper's density",)),
    "register": StageLook("register: target registration error, one fit", "call", "µs",
                          ("bare least squares",)),
    "proxy": StageLook("proxy: against the exact proxy, one tick", "tick", "µs",
                       ("paper", "nanoflann_peer", "nearest-point penalty")),
    "plan": StageLook("plan: slice and markers to fixture, one call", "call", "ms",
                      ("the paper's: every mask pixel",)),
}  # fmt: skip


def error_text(result: Record, key: str = "error_rms") -> str:
    """An error with its unit."""
    return length(result[key]) if result["unit"] == "m" else f"{three_digits(result[key])} px"


def time_text(us: float) -> str:
    """A time given in microseconds, in the unit that suits it."""
    return duration(1e-6 * us)


def summaries(document: dict[str, Any]) -> dict[str, str]:
    """A sentence for each stage of a bench's document that has a chosen setting."""
    # Stage proxy comes last: it is what the controller does a thousand times a second.
    stages = sorted(document["stages"], key=lambda stage: stage == "proxy")
    sentences = {}
    for stage in stages:
        results = [r for r in document["results"] if r["stage"] == stage]
        if any(result.get("chosen") for result in results):
            sentences[stage] = stage_sentence(stage, results)
    return sentences


def stage_sentence(stage: str, results: list[Record]) -> str:
    """Time and error of the chosen setting over all scenes, and of each peer."""
    (_, chosen), *peers = clouds(stage, results).items()
    part = LOOKS[stage].part
    sentence = (
        f"Over {len(chosen)} scenes, a {part} of the chosen setting {cost_text(part, chosen)}"
    )
    for method, best in peers:
        sentence += f"; {method} {cost_text(part, best)}"
        if len(best) < len(chosen):
            sentence += f" on {len(best)} of them"
    return sentence + "."


def clouds(stage: str, results: list[Record]) -> dict[str, list[Record]]:
    """One record a scene: of the chosen setting, and of each peer's setting that errs least."""
    groups = {"chosen": [result for result in results if result.get("chosen")]}
    outside = [result["method"] for result in results if result.get("peer")]
    for method in dict.fromkeys([*LOOKS[stage].peers, *outside]):
        own = grouped([r for r in results if r["method"] == method], "scene")
        if own:
            groups[method] = [min(rs, key=itemgetter("error_rms")) for rs in own.values()]
    return groups


def cost_text(part: str, records: list[Record]) -> str:
    """What the records take and how far they err, in the median and at most."""
    time = time_text(float(np.median([r["time_us_median"] for r in records])))
    tail = (
        f" (p99.9 {time_text(max(r['time_us_p999'] for r in records))})" if part == "tick" else ""
    )
    typical = records[0] | {"error_rms": float(np.median([r["error_rms"] for r in records]))}
    worst = max(records, key=itemgetter("error_rms"))
    return f"takes {time}{tail} and errs by {error_text(typical)} RMS ({error_text(worst)} at most)"


KEY = (
    "* on the front: nothing on this scene is both faster and nearer to the truth",
    "> the setting that is chosen: a plan's own, or what --tolerance leads to",
)
SHORT_KEY = "Of each method the setting with the least error is listed; -o DIR writes all."


def table_lines(document: dict[str, Any], stages: list[str]) -> list[str]:
    """A table of each scene, cheapest first, under one header a stage, and the key."""
    lines = []
    for stage in stages:
        results = [r for r in document["results"] if r["stage"] == stage]
        median = f"median a {LOOKS[stage].part}"
        header = table_row("", median, "p99.9", "error RMS", "at most", "method", "settings")
        lines.append(f"{stage}: " + header.strip())
        for scene, scene_results in grouped(results, "scene").items():
            lines.append(f"  {scene}")
            visible = best_of_each_method(scene_results)
            lines += map(result_row, sorted(visible, key=lambda r: r["time_us_median"]))
    for refusal in document.get("refused", ()):
        if refusal["stage"] in stages:
            what = f"{refusal['method']} {settings_text(refusal['settings'])}"
            lines.append(f"refused: {refusal['scene']}: {what}: {refusal['message']}")
    return [*lines, "", *KEY, SHORT_KEY]


def best_of_each_method(results: list[Record]) -> list[Record]:
    """Of each method the setting that errs least, and every chosen setting."""
    methods = grouped(results, "method")
    best = {name: min(found, key=itemgetter("error_rms")) for name, found in methods.items()}
    return [r for r in results if r.get("chosen") or best[r["method"]] is r]


def result_row(result: Record) -> str:
    """A result as a row of the table."""
    marks = "*" if result["pareto"] else " "
    if result.get("chosen"):
        marks += ">"
    times = [time_text(result[name]) for name in ("time_us_median", "time_us_p999")]
    errors = [error_text(result, name) for name in ("error_rms", "error_max")]
    return table_row(marks, *times, *errors, result["method"], settings_text(result["settings"]))


def table_row(
    marks: str, median: str, tail: str, rms: str, largest: str, method: str, settings: str
) -> str:
    """A row: four columns of numbers, then the method and its settings."""
    numbers = f"{median:>14}{tail:>14}{rms:>14}{largest:>14}"
    return f"  {marks:<2}{numbers}  {method:<30}{settings}".rstrip()


def settings_text(settings: dict[str, Any]) -> str:
    """Settings as a person reads them, with their units."""
    parts = []
    for name, value in settings.items():
        if name.endswith("_per_m"):
            parts.append(f"{name.removesuffix('_per_m')} {value / 1e3:.4g}/mm")
        elif name.endswith("_m"):
            parts.append(f"{name.removesuffix('_m')} {length(value)}")
        elif isinstance(value, float):
            parts.append(f"{name}={value:.4g}")
        else:
            parts.append(f"{name}={value}")
    return ", ".join(parts)
