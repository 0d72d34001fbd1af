"""bench(stages) -> one document: all trials measured, fronts marked; as JSON and as CSV."""

from __future__ import annotations

import csv
import io
import json
import os
import platform
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from vfplan.bench.peers import Peer
from vfplan.bench.record import Advance, Record, judge_chosen, mark_pareto, run_trials
from vfplan.bench.summary import summaries
from vfplan.errors import InputError, SettingError
from vfplan.io.files import read_whole
from vfplan.io.json_types import to_json_types
from vfplan.io.staging import write_whole
from vfplan.planning.tolerance import choose

Stage = Literal["extract", "sample", "register", "proxy", "plan"]
STAGES: tuple[Stage, ...] = get_args(Stage)
Bar = Callable[[str, int], AbstractContextManager[Advance]]
REPEATS = {True: 3, False: 7}
TOLERANCE_M = 1e-5
BUDGET_US = 1000.0  # a tick of a 1 kHz controller


def bench(
    stages: Iterable[Stage] = STAGES,
    *,
    quick: bool = False,
    tolerance_m: float = TOLERANCE_M,
    peers: Sequence[Peer] = (),
    progress: Bar = lambda label, total: nullcontext(lambda n: None),
) -> dict[str, Any]:
    """Measure error against run time.

    stages: which; see `STAGES`
    quick: fewer scenes, settings and repeats: under a minute instead of under ten
    tolerance_m: for the settings that are chosen by it [m]
    peers: outside programs, used by stage "proxy"
    progress: a `with` block around each scene, given its name and how many runs it has; yields what
        is told of each run
    Returns the document of docs/accuracy.md: `results`, `peers`, `machine`, `chosen`, ...
    Raises SettingError: an unknown stage, a tolerance that is none, a peer that failed
    """
    wanted = _checked(stages)
    choice = choose(tolerance_m, 5e-3)
    for peer in peers:
        peer.check()
    began = time.perf_counter()
    records: list[Record] = []
    refused: list[Record] = []
    for stage in wanted:
        scenes = import_module(f"vfplan.bench.{stage}").scenes
        more = (peers,) if stage == "proxy" else ()
        for trials in scenes(quick, tolerance_m, *more):
            label, repeats = f"{stage}: {trials[0].scene}", REPEATS[quick]
            with progress(label, len(trials) * (1 + repeats)) as advance:
                measured, unusable = run_trials(stage, trials, repeats, advance)
            records += measured
            refused += unusable
    mark_pareto(records)
    judge_chosen(records, tolerance_m)
    document = {
        "format": FORMAT,
        "version": VERSION,
        "stages": list(wanted),
        "quick": quick,
        "tolerance_m": tolerance_m,
        "budget_us": BUDGET_US,
        "chosen": {name: getattr(choice, name) for name in choice.__dataclass_fields__},
        "results": records,
        **({"refused": refused} if refused else {}),
        "peers": [{"name": p.name, "command": p.command, "ran": True} for p in peers],
        "machine": describe_machine(),
        "elapsed_s": time.perf_counter() - began,
    }
    return document | {"summary": summaries(document)}


def _checked(stages: Iterable[Stage]) -> tuple[Stage, ...]:
    given = list(stages)
    unknown = [stage for stage in given if stage not in STAGES]
    if unknown or not given:
        raise SettingError(f"stages {unknown or given}: allowed are {', '.join(STAGES)}")
    return tuple(stage for stage in STAGES if stage in given)


FORMAT = "vfplan-bench"
VERSION = "1.0"
MOST_BYTES = 256 * 2**20
COLUMNS = (
    "stage", "scene", "method", "settings", "error_rms", "error_max", "unit", "time_us_median",
    "time_us_low", "time_us_high", "time_us_p99", "time_us_p999", "time_us_max", "repeats",
    "pareto", "chosen", "peer", "points", "force_rms_n", "force_max_n", "surface_error_m",
    "lines_and_arcs", "inside_m", "followed_rms_m", "followed_ticks", "ticks", "clearance_min_m",
    "lag_rms_m", "friction", "meets_tolerance", "follows", "time_over_cheapest",
)  # fmt: skip
_NEEDED = ("stages", "results", "tolerance_m", "budget_us", "machine", "peers", "elapsed_s")
_TEXTS = ("stage", "scene", "method", "unit")
_NUMBERS = ("error_rms", "error_max", "time_us_median", "time_us_low", "time_us_high")


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
        pairs = " ".join(f"{k}={v}" for k, v in result["settings"].items())
        writer.writerow(result | {"settings": pairs})
    write_whole(path, [text.getvalue().encode()], overwrite=True)


def read_document(path: str | Path) -> dict[str, Any]:
    """Read what `write_json` wrote.

    Raises `InputError` for a file that is missing, no JSON, no bench of this version, or damaged.
    """
    try:
        document = json.loads(read_whole(Path(path), MOST_BYTES).decode("utf-8"))
    except ValueError as error:
        raise InputError(f"is not JSON: {error}", where=str(path)) from None
    found = document.get("format") if isinstance(document, dict) else None
    if found != FORMAT:
        raise InputError(f"format {found!r}: {FORMAT!r} is wanted", where=str(path))
    if str(document.get("version", "")).split(".")[0] != VERSION.split(".")[0]:
        raise InputError(f"version {document.get('version')!r}: {VERSION} is read", where=str(path))
    missing = [name for name in _NEEDED if name not in document]
    if missing:
        raise InputError(f"lacks {', '.join(missing)}", where=str(path))
    _check_results(document["results"], str(path))
    return document


def _check_results(results: Any, where: str) -> None:
    """Everything that a diagram is drawn from is there, and a finite number where one is needed."""
    if not isinstance(results, list) or not results:
        raise InputError("holds no results", where=where)
    for i, result in enumerate(results):
        at = f"{where}: results[{i}]"
        if not isinstance(result, dict) or not isinstance(result.get("settings"), dict):
            raise InputError("is no result with its settings", where=at)
        for name in (*_TEXTS, *_NUMBERS):
            value, kind = result.get(name), str if name in _TEXTS else (int, float)
            if isinstance(value, bool) or not isinstance(value, kind):
                wanted = "a text" if name in _TEXTS else "a number"
                raise InputError(f"{name} {value!r}: {wanted} is wanted", where=at)
        if result["unit"] not in ("m", "px") or not isinstance(result.get("pareto"), bool):
            raise InputError("unit or pareto is none that a bench writes", where=at)


def describe_machine() -> dict[str, Any]:
    """Processor, cores, system, Python, NumPy; the clock's own cost [µs]."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0))
        if hasattr(os, "sched_getaffinity")
        else os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "clock_us": _clock_us(),
    }


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _clock_us() -> float:
    ticks = [time.perf_counter_ns() for _ in range(2001)]
    return float(np.median(np.diff(ticks))) / 1e3
