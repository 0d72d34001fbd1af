"""What the bench measures, side by side, and how it is written down: runs in, results out.

A run is one method with one set of settings on one scene. It is repeated; its error is scored once
(every method here is deterministic), its time by the median over all repeats.

What a bench says: a table, and a sentence a stage on the chosen setting, its error, its time, and
the peers': medians over the scenes. The chosen setting is the one that `vfplan plan` takes without
options.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from vfplan.display import Advance, Report, duration, length, three_digits
from vfplan.engine.proxy import ProxyEngine, Trace
from vfplan.errors import InputError
from vfplan.geometry import ROUNDING_M
from vfplan.geometry.lines import Array
from vfplan.planning.settings import FixtureSettings

Setting = str | float | int | bool | None
Record = dict[str, Any]
Records = list[Record]
Settings = dict[str, Setting]

# How far the chosen settings may move the surface [m].
TOLERANCE_M = FixtureSettings.tolerance_m

# Errors below a nanometre [m] are rounding, and count as equal.
SMALLEST_ERROR_M = ROUNDING_M

# Number of timed repeats after which a slow run is timed well enough.
FEWEST_REPEATS = 3

# Time [µs] that a run must have taken for that.
TIMED_ENOUGH_US = 0.25e6


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
    settings: Settings
    # Does the work once: the answer and the times of its parts (K,) [µs] (one element for a call,
    # one a tick for an engine)
    run: Callable[[], tuple[Any, Array]]
    # From the answer to `errors_of` it, and the unit of the errors, "px" or "m"
    score: Callable[[Any], Record]
    unit: str
    # Whether these are the settings that a plan takes
    chosen: bool = False
    # Whether an outside program does it
    peer: bool = False


# The runs of a stage, scene by scene.
Scenes = Iterator[list[BenchRun]]


# What of a run stands in its record.
LISTED = ("scene", "method", "settings", "unit", "chosen", "peer")


def mark_pareto(records: Records) -> None:
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


def grouped(records: Records, *names: str) -> dict[Any, Records]:
    """The records by what they have under some names, in order."""
    groups = {}
    for record in records:
        groups.setdefault(itemgetter(*names)(record), []).append(record)
    return groups


def comparable_error(record: Record) -> float:
    """The RMS error to six digits, and to a nanometre where it is one in metres."""
    error = float(f"{record['error_rms']:.6g}")
    return max(error, SMALLEST_ERROR_M) if record.get("unit") == "m" else error


def timed(work: Callable[[], Any]) -> tuple[Any, Array]:
    """The answer of a call, and its time as (1,) [µs]."""
    started = time.perf_counter_ns()
    answer = work()
    return answer, np.array([(time.perf_counter_ns() - started) / 1e3])


def timed_ticks(engine: ProxyEngine, hips: Array) -> tuple[Trace, Array]:
    """Run a path from its first HIP on: the trace, and the time of each tick (T,) [µs]."""
    engine.reset(hips[0])
    return engine.run_timed(hips)


def measure_runs(
    stage: str, runs: Sequence[BenchRun], repeats: int, advance: Advance = lambda count: None
) -> tuple[Records, Records]:
    """Measure the runs of one scene: a record for each, and those that refused their input.

    Every round does each run once, in another order each time; the first round warms caches up
    and gives the answers to score, and is not timed. Slow runs stop after the first rounds. Of
    several parts, as ticks are, each counts with its shortest time over the rounds: what the work
    takes where the system interrupts nothing. A single call counts as often as it ran.

    Parameters
    ----------
    stage
        The records' stage.
    runs
        Of one scene.
    repeats
        Timed rounds, at most.
    advance
        Called with 1 after each of the 1 + `repeats` rounds.
    """
    rng = np.random.default_rng(0)
    measured, refused = [], []
    for bench_run in runs:
        record = {name: getattr(bench_run, name) for name in LISTED} | {"stage": stage}
        try:
            answer, _ = bench_run.run()
        except InputError as error:
            refused.append(record | {"message": error.message})
        else:
            measured.append((bench_run, record | bench_run.score(answer), []))
    advance(1)
    for _ in range(repeats):
        for i in rng.permutation(len(measured)):
            bench_run, _, times = measured[i]
            if len(times) < FEWEST_REPEATS or sum(us.sum() for us in times) <= TIMED_ENOUGH_US:
                times.append(bench_run.run()[1])
        advance(1)
    for _, record, times in measured:
        us = np.min(times, axis=0) if len(times[0]) > 1 else np.concatenate(times)
        record["time_us_median"], record["time_us_p999"] = np.quantile(us, [0.5, 0.999]).tolist()
    return [record for _, record, _ in measured], refused


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


def error_text(result: Record) -> str:
    """The RMS error with its unit."""
    error = result["error_rms"]
    return length(error) if result["unit"] == "m" else f"{three_digits(error)} px"


def summaries(document: Report) -> dict[str, str]:
    """A sentence for each stage of a bench's document that has a chosen setting."""
    results_of = grouped(document["results"], "stage")
    sentences = {}
    # Stage proxy comes last: it is what the controller does a thousand times a second.
    for stage in sorted(results_of, key=lambda stage: stage == "proxy"):
        results = results_of[stage]
        if any(result.get("chosen") for result in results):
            sentences[stage] = stage_sentence(stage, results)
    return sentences


def stage_sentence(stage: str, results: Records) -> str:
    """Time and error of the chosen setting over all scenes, and of each peer."""
    (_, chosen), *peers = clouds(stage, results).items()
    part = LOOKS[stage].part
    sentence = f"Over {len(chosen)} scenes, a {part} at default settings {cost_text(part, chosen)}"
    for method, best in peers:
        sentence += f"; {method} {cost_text(part, best)}"
        if len(best) < len(chosen):
            sentence += f" on {len(best)} of them"
    return sentence + "."


def clouds(stage: str, results: Records) -> dict[str, Records]:
    """One record a scene: of the chosen setting, and of each peer's setting that errs least."""
    groups = {"chosen": [result for result in results if result.get("chosen")]}
    outside = [result["method"] for result in results if result.get("peer")]
    for method in dict.fromkeys([*LOOKS[stage].peers, *outside]):
        own = grouped([r for r in results if r["method"] == method], "scene")
        if own:
            groups[method] = [min(rs, key=itemgetter("error_rms")) for rs in own.values()]
    return groups


def cost_text(part: str, records: Records) -> str:
    """What the records take and how far they err, in the median and at most."""
    time = duration(1e-6 * float(np.median([r["time_us_median"] for r in records])))
    if part == "tick":
        time += f" (p99.9 at most {duration(1e-6 * max(r['time_us_p999'] for r in records))})"
    typical = records[0] | {"error_rms": float(np.median([r["error_rms"] for r in records]))}
    worst = max(records, key=itemgetter("error_rms"))
    errors = f"{error_text(typical)} (at most {error_text(worst)})"
    return f"takes a median of {time}, with a median RMS error of {errors}"


def table_lines(document: Report) -> list[str]:
    """Time and error on each scene: of each method, the setting that errs least."""
    lines = []
    for (stage, scene), results in grouped(document["results"], "stage", "scene").items():
        lines.append(f"{stage}: {scene}")
        for method, settings in grouped(results, "method").items():
            best = min(settings, key=itemgetter("error_rms"))
            time = duration(1e-6 * best["time_us_median"])
            lines.append(f"  {time:>10}{error_text(best):>12} RMS  {method}")
    refusals = ["refused: {scene}: {method}: {message}".format(**r) for r in document["refused"]]
    return lines + refusals
