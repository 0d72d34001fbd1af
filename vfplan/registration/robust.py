"""Which markers agree: a search over every minimal subset, with no random number in it.

Least trimmed squares (P. J. Rousseeuw and K. Van Driessen, Data Min. Knowl. Discov. 12, 2006) over
all minimal subsets finds the half that agrees best; a forward search (A. C. Atkinson and M. Riani,
"Robust diagnostic regression analysis", 2000) then takes in one marker after another as long as the
next one's studentised F stays below the limit that also flags outliers.
"""

from __future__ import annotations

from itertools import combinations, islice
from math import comb

import numpy as np

from vfplan.errors import SettingError
from vfplan.registration import residuals
from vfplan.registration.models import Array
from vfplan.registration.problem import Problem

MAX_SUBSETS = 500_000
_CHUNK = 10_000
_BEST = 10  # starts that are concentrated to the end


def agreeing(problem: Problem, alpha: float = 0.05) -> np.ndarray:
    """(N,) bool: the markers that a robust fit rests on; `alpha` as in `residuals.f_limit`.

    Raises SettingError: more minimal subsets than can be searched
    """
    n, size = len(problem.s), problem.model.minimal
    subsets = comb(n, size)
    if subsets > MAX_SUBSETS:
        raise SettingError(
            f"a robust fit searches all {subsets} subsets of {size} of {n} markers; at most "
            f"{MAX_SUBSETS} are allowed"
        )
    half = _half(n, problem)
    starts = sorted(_best_subsets(problem, half))[:_BEST]
    concentrated = (_concentrate(problem, np.array(subset), half) for _, subset in starts)
    _, core = min(concentrated, key=lambda found: (found[0], found[1]))
    used = np.zeros(n, dtype=bool)
    used[list(core)] = True
    return _grow(problem, used, alpha)


def _half(n: int, problem: Problem) -> int:
    """Markers in the trimmed sum: the most outliers are tolerated, a residual is left."""
    least = problem.model.parameters // 3 + 1
    return min(n, max((n + problem.model.minimal + 1) // 2, least))


def _best_subsets(problem: Problem, half: int) -> list[tuple[float, tuple[int, ...]]]:
    every = combinations(range(len(problem.s)), problem.model.minimal)
    best: list[tuple[float, tuple[int, ...]]] = []
    while chunk := list(islice(every, _CHUNK)):
        index = np.array(chunk)
        index = index[spans(problem, index)]
        if not len(index):
            continue
        m = problem.model.through(problem.s[index], problem.y[index])
        score = np.partition(_squares(problem, m), half - 1, axis=1)[:, :half].sum(axis=1)
        order = np.argsort(score, kind="stable")[:_BEST]
        best += [(float(score[i]), tuple(index[i].tolist())) for i in order]
    return best


def spans(problem: Problem, index: np.ndarray) -> np.ndarray:
    """Subsets that are not themselves collinear (3-D affine: coplanar)."""
    s = problem.s[index]
    edges = s - s.mean(axis=1, keepdims=True)
    squared = np.linalg.eigvalsh(np.swapaxes(edges, 1, 2) @ edges)[:, ::-1]
    rank = problem.model.dimension if problem.model.name == "affine" else 2
    return squared[:, rank - 1] > 1e-6


def _squares(problem: Problem, m: Array) -> Array:
    """(..., N) weighted squared residuals of every marker under M (..., 3, k+1)."""
    error = problem.y - problem.x @ np.swapaxes(m, -1, -2)
    return (problem.weights * error**2).sum(axis=-1)


def _concentrate(problem: Problem, subset: np.ndarray, half: int) -> tuple[float, tuple[int, ...]]:
    """Fit, keep the `half` nearest markers, fit again, until the set stays."""
    m = problem.model.solve(problem.s[subset], problem.y[subset], problem.weights[subset])
    for _ in range(50):
        nearest = np.sort(np.argsort(_squares(problem, m), kind="stable")[:half])
        if np.array_equal(nearest, subset) or not spans(problem, nearest[None])[0]:
            break
        subset = nearest
        m = problem.model.solve(problem.s[subset], problem.y[subset], problem.weights[subset])
    score = np.sort(_squares(problem, m))[:half].sum()
    return float(score), tuple(nearest.tolist())


def _grow(problem: Problem, used: np.ndarray, alpha: float) -> np.ndarray:
    while not used.all():
        fit = residuals.solve(problem, used)
        f = np.where(used, np.inf, residuals.studentised_f(fit))
        nearest = int(np.argmin(f))
        if f[nearest] > residuals.f_limit(len(used), fit.dof, alpha):
            break
        used = used.copy()
        used[nearest] = True
    return used
