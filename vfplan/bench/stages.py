"""bench(stages) -> one document, as JSON: all runs measured, fronts marked."""

from __future__ import annotations

import os
import platform
import re
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


def bench(
    stages: Sequence[str] = tuple(STAGES),
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
        A tolerance out of range, a peer that failed.
    """
    ordered = [stage for stage in STAGES if stage in stages]
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
        "format": "vfplan-bench", "version": "1.0", "stages": ordered, "quick": quick,
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


def describe_machine() -> dict[str, Any]:
    """Processor, cores, system, Python, NumPy."""
    processor = platform.processor() or platform.machine()
    # Other systems have no such file.
    with suppress(OSError):
        named = re.search("model name\\s*: (.*)", Path("/proc/cpuinfo").read_text())
        if named:
            processor = named[1]
    affinity = getattr(os, "sched_getaffinity", None)
    cores = os.cpu_count() if affinity is None else len(affinity(0))
    return {
        "processor": processor,
        "cores": cores,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
