"""bench(stages) -> one document: all trials measured, fronts marked; as JSON and as CSV."""

from __future__ import annotations

import csv
import io
import json
import os
import platform
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.bench.peers import Peer
from vfplan.bench.pipeline import extract_scenes, plan_scenes, register_scenes, sample_scenes
from vfplan.bench.proxy import proxy_scenes
from vfplan.bench.record import (
    FEWEST_REPEATS,
    Advance,
    BenchRun,
    Record,
    judge_chosen,
    mark_pareto,
    measure_runs,
    summaries,
)
from vfplan.errors import InputError, SettingError
from vfplan.io.files import MAX_TEXT_BYTES, read_whole, to_json_types
from vfplan.io.writing import write_whole
from vfplan.planning.settings import FixtureSettings
from vfplan.planning.tolerance import RATE_HZ, choose

# The runs of each scene of a stage, from: quick, tolerance [m], peers.
STAGES: dict[str, Callable[..., Iterable[list[BenchRun]]]] = {
    "extract": extract_scenes, "sample": sample_scenes, "register": register_scenes,
    "proxy": proxy_scenes, "plan": plan_scenes,
}  # fmt: skip

Bar = Callable[[str, int], AbstractContextManager[Advance]]

# Number of timed rounds; the medians of seven spread by some percent.
REPEATS = 7

# The same in a quick run.
QUICK_REPEATS = FEWEST_REPEATS

# Time for a tick of a 1 kHz controller [µs].
BUDGET_US = 1e6 / RATE_HZ

FORMAT = "vfplan-bench"
VERSION = "1.0"


def bench(
    stages: Iterable[str] = tuple(STAGES),
    *,
    quick: bool = False,
    tolerance_m: float = FixtureSettings.tolerance_m,
    peers: Sequence[Peer] = (),
    progress: Bar = lambda label, total: nullcontext(lambda n: None),
) -> dict[str, Any]:
    """Measure error against run time.

    Parameters
    ----------
    stages
        Which; see `STAGES`.
    quick
        Fewer scenes, settings and repeats: under a minute instead of under ten.
    tolerance_m
        For the settings that are chosen by it [m].
    peers
        Outside programs, used by stage "proxy".
    progress
        A `with` block around each scene, given its name and how many steps it has; yields what is
        called with each step.

    Returns
    -------
    dict
        The document of docs/accuracy.md: `results`, `peers`, `machine`, `chosen`, ...

    Raises
    ------
    SettingError
        An unknown stage, a tolerance out of range, a peer that failed.
    """
    wanted = list(stages)
    unknown = [stage for stage in wanted if stage not in STAGES]
    if unknown or not wanted:
        raise SettingError(
            f"stages are {unknown or wanted}. Give some of {', '.join(STAGES)}",
            code="unknown-stage",
        )
    ordered = [stage for stage in STAGES if stage in wanted]
    choice = choose(tolerance_m, 5e-3)
    for peer in peers:
        peer.check()
    repeats = QUICK_REPEATS if quick else REPEATS
    started = time.perf_counter()
    records: list[Record] = []
    refused: list[Record] = []
    for stage in ordered:
        for runs in STAGES[stage](quick, tolerance_m, peers):
            label = f"{stage}: {runs[0].scene}"
            with progress(label, len(runs) * (1 + repeats)) as advance:
                measured, unusable = measure_runs(stage, runs, repeats, advance)
            records += measured
            refused += unusable
    mark_pareto(records)
    judge_chosen(records, tolerance_m)
    document: dict[str, Any] = {
        "format": FORMAT, "version": VERSION, "stages": ordered, "quick": quick,
        "tolerance_m": tolerance_m, "budget_us": BUDGET_US, "chosen": dict(vars(choice)),
        "results": records,
        "peers": [{"name": p.name, "command": p.command, "ran": True} for p in peers],
        "machine": describe_machine(),
        "elapsed_s": time.perf_counter() - started,
    }  # fmt: skip
    if refused:
        document["refused"] = refused
    document["summary"] = summaries(document)
    return document


COLUMNS = (
    "stage", "scene", "method", "settings", "error_rms", "error_max", "unit", "time_us_median",
    "time_us_low", "time_us_high", "time_us_p99", "time_us_p999", "time_us_max", "repeats",
    "pareto", "chosen", "peer", "points", "force_rms_n", "force_max_n", "surface_error_m",
    "lines_and_arcs", "inside_m", "followed_rms_m", "followed_ticks", "ticks", "clearance_min_m",
    "lag_rms_m", "friction", "meets_tolerance", "follows", "time_over_cheapest",
)  # fmt: skip
NEEDED_KEYS = ("stages", "results", "tolerance_m", "budget_us", "machine", "peers", "elapsed_s")
TEXT_KEYS = ("stage", "scene", "method", "unit")
NUMBER_KEYS = ("error_rms", "error_max", "time_us_median", "time_us_low", "time_us_high")


def write_json(document: dict[str, Any], path: Path) -> None:
    """Write the document; numbers that are not finite become null."""
    text = json.dumps(to_json_types(document), indent=1, allow_nan=False) + "\n"
    write_whole(path, [text.encode()], overwrite=True)


def write_csv(document: dict[str, Any], path: Path) -> None:
    """Write one row a result; settings as `name=value` pairs, what does not apply is empty."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS, extrasaction="ignore", restval="")
    writer.writeheader()
    for result in document["results"]:
        pairs = [f"{name}={value}" for name, value in result["settings"].items()]
        writer.writerow(result | {"settings": " ".join(pairs)})
    write_whole(path, [text.getvalue().encode()], overwrite=True)


def read_document(path: str | Path) -> dict[str, Any]:
    """Read what `write_json` wrote.

    Raises `InputError` for a file that is missing, no JSON, no bench of this version, or damaged.
    """

    def refuse(text: str, code: str = "damaged-bench", within: str = "") -> InputError:
        return InputError(text, where=f"{path}{within}", code=code)

    try:
        document = json.loads(read_whole(Path(path), MAX_TEXT_BYTES).decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise refuse(f"is not JSON: {error}. Give a bench.json", "not-json") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise refuse(f"is no document of format {FORMAT!r}. Give a bench.json", "no-bench")
    if str(document.get("version", "")).split(".")[0] != VERSION.split(".")[0]:
        raise refuse(
            f"is of version {document.get('version')!r}, and {VERSION} is read. Measure again",
            "other-version",
        )
    missing = [name for name in NEEDED_KEYS if name not in document]
    if missing:
        raise refuse(f"lacks {', '.join(missing)}. Measure again")
    results = document["results"]
    if not isinstance(results, list) or not results:
        raise refuse("holds no results. Measure again")
    for i, result in enumerate(results):
        fault = fault_of_result(result)
        if fault:
            raise refuse(f"{fault}. Measure again", within=f": results[{i}]")
    return document


def fault_of_result(result: Any) -> str:
    """What a diagram needs and this result lacks; empty where it has everything."""
    if not isinstance(result, dict) or not isinstance(result.get("settings"), dict):
        return "is no result with its settings"
    for name in TEXT_KEYS:
        if not isinstance(result.get(name), str):
            return f"{name} is {result.get(name)!r}, and no text"
    for name in NUMBER_KEYS:
        value = result.get(name)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return f"{name} is {value!r}, and no number"
    if result["unit"] not in ("m", "px") or not isinstance(result.get("pareto"), bool):
        return "unit or pareto is none that a bench writes"
    return ""


def describe_machine() -> dict[str, Any]:
    """Processor, cores, system, Python, NumPy; the clock's own cost [µs]."""
    processor = platform.processor() or platform.machine()
    # Other systems have no such file.
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        named = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
        if named:
            processor = named[0]
    affinity = getattr(os, "sched_getaffinity", None)
    cores = os.cpu_count() if affinity is None else len(affinity(0))
    instants = [time.perf_counter_ns() for _ in range(2001)]
    return {
        "processor": processor,
        "cores": cores,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "clock_us": float(np.median(np.diff(instants))) / 1e3,
    }
