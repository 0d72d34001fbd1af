"""bench(stages) -> one document: every stage's trials measured, fronts marked."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, get_args

from vfplan.engine.tolerance import choose
from vfplan.errors import SettingError
from vfplan.study.bench.document import FORMAT, VERSION, describe_machine
from vfplan.study.bench.peers import Peer, nanoflann_hint
from vfplan.study.bench.record import Refusal, Result, Trial, judge_chosen, mark_pareto, run_trials

Stage = Literal["extract", "sample", "register", "proxy", "feel", "plan"]
STAGES: tuple[Stage, ...] = get_args(Stage)
_MODULES = {
    "extract": "extracting",
    "sample": "sampling",
    "register": "registering",
    "proxy": "proxy",
    "feel": "feel",
    "plan": "planning",
}
REPEATS = {True: 3, False: 7}
TOLERANCE_M = 1e-5
BUDGET_US = 1000.0  # a tick of a 1 kHz controller


def bench(
    stages: Iterable[Stage] = STAGES,
    *,
    quick: bool = False,
    tolerance_m: float = TOLERANCE_M,
    peers: Sequence[Peer] = (),
    surface: Path | None = None,
    progress: Callable[[str, int, int], None] = lambda label, done, total: None,
) -> dict[str, Any]:
    """Measure error against run time.

    stages: which; see `STAGES`
    quick: fewer scenes, settings and repeats: under a minute instead of under ten
    tolerance_m: for the settings that are chosen by it [m]
    peers: outside programs for stage "proxy"
    surface: a mesh file (PLY or STL, mm), e.g. a bone's: one more scene of stage "proxy".
    progress: told the scene at work, how many of its runs are done, and of how many
    Returns the document of docs/accuracy.md: `results`, `peers`, `machine`, `chosen`, ...
    Raises SettingError: an unknown stage, a tolerance that is none, a peer that failed
    """
    wanted = _checked(stages)
    choice = choose(tolerance_m, 5e-3)
    for peer in peers:
        peer.check()
    began = time.perf_counter()
    records: list[dict[str, Any]] = []
    refused: list[dict[str, Any]] = []
    for stage in wanted:
        for trials in _scenes(stage, quick, tolerance_m, peers, surface):
            results, refusals = _measure(stage, trials, REPEATS[quick], progress)
            records += [result.record() for result in results]
            refused += [refusal.record() for refusal in refusals]
    mark_pareto(records)
    judge_chosen(records, tolerance_m)
    return {
        "format": FORMAT,
        "version": VERSION,
        "stages": list(wanted),
        "quick": quick,
        "tolerance_m": tolerance_m,
        "budget_us": BUDGET_US,
        "chosen": {name: getattr(choice, name) for name in choice.__dataclass_fields__},
        "results": records,
        **({"refused": refused} if refused else {}),
        "peers": _peers(peers, "proxy" in wanted),
        "machine": describe_machine(),
        "elapsed_s": time.perf_counter() - began,
    }


def _checked(stages: Iterable[Stage]) -> tuple[Stage, ...]:
    given = list(stages)
    unknown = [stage for stage in given if stage not in STAGES]
    if unknown or not given:
        raise SettingError(f"stages {unknown or given}: allowed are {', '.join(STAGES)}")
    return tuple(stage for stage in STAGES if stage in given)


def _scenes(
    stage: Stage,
    quick: bool,
    tolerance_m: float,
    peers: Sequence[Peer],
    surface: Path | None,
) -> Iterator[list[Trial]]:
    module = import_module(f"vfplan.study.bench.{_MODULES[stage]}")
    if stage == "proxy":
        return module.scenes(quick, tolerance_m, peers, surface)
    return module.scenes(quick, tolerance_m)


def _measure(
    stage: Stage, trials: list[Trial], repeats: int, progress: Callable[[str, int, int], None]
) -> tuple[list[Result], list[Refusal]]:
    label, total, done = f"{stage}: {trials[0].scene}", len(trials) * (1 + repeats), 0

    def advance(n: int) -> None:
        nonlocal done
        done += n
        progress(label, done, total)

    progress(label, 0, total)
    return run_trials(stage, trials, repeats, advance)


def _peers(peers: Sequence[Peer], wanted: bool) -> list[dict[str, Any]]:
    """What ran beside us, and what could have."""
    ran = [{"name": p.name, "command": p.command, "ran": True} for p in peers] if wanted else []
    if wanted and not any("nanoflann" in p.name for p in peers):
        ran.append({"name": "nanoflann", "ran": False, "message": nanoflann_hint()})
    return ran
