"""Run trials side by side: interleaved, so that a slow minute of the machine hits every method."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vfplan.errors import InputError
from vfplan.study.bench.record import Errors, Refusal, Result, Trial

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
