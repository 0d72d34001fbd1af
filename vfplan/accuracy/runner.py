"""Run trials side by side: interleaved, so that a slow minute of the machine hits every method."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vfplan.accuracy.record import Errors, Result, Trial

Advance = Callable[[int], None]


def run_trials(
    stage: str, trials: Sequence[Trial], repeats: int, advance: Advance = lambda n: None
) -> list[Result]:
    """Measure the trials of one scene.

    Every round runs each trial once, in another order each time; the first round warms caches up
    and gives the answers to score, and is not timed.

    Parameters
    ----------
    stage
        The results' stage.
    trials
        Of one scene.
    repeats
        Timed rounds.
    advance
        Told 1 after every round of a trial.
    """
    rng = np.random.default_rng(0)
    errors: list[Errors] = []
    for trial in trials:
        errors.append(trial.score(trial.run()[0]))
        advance(1)
    times: list[list[np.ndarray]] = [[] for _ in trials]
    for _ in range(repeats):
        for i in rng.permutation(len(trials)):
            times[i].append(trials[i].run()[1])
            advance(1)
    return [Result(stage, t, e, us) for t, e, us in zip(trials, errors, times, strict=True)]
