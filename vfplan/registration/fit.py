"""A solved fit, what each marker says about it, and which markers agree.

Residual, leverage, leave-one-out error and studentised F of each. Which agree is found without a
random number: least trimmed squares (P. J. Rousseeuw, J. Am. Stat. Assoc. 79, 1984) over the maps
through all minimal subsets finds the half that agrees best; a forward search (A. C. Atkinson
and M. Riani, "Robust diagnostic regression analysis", 2000) then takes in one marker after another
as long as the next one's studentised F stays below the limit that also flags outliers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, islice
from math import comb

import numpy as np

from vfplan.errors import SettingError
from vfplan.registration.models import (
    Affine,
    Array,
    Orthogonal,
    marker_rows,
    root_of_inverse,
)
from vfplan.registration.problem import Problem

MAX_SUBSETS = 500_000
_CHUNK = 10_000
# RMS extent of the layout's narrow direction over the error of a marker: less explains nothing.
MIN_EXTENT = 3.0
REST_EXTENT = 2.0  # of what is left without a bad marker: fewer, so that its error is less known


@dataclass(frozen=True, eq=False)
class Fit:
    """A solved problem."""

    problem: Problem
    m: Array  # (3, k+1) the transform in normalised coordinates
    used: np.ndarray  # (N,) markers the fit rests on
    vectors: Array  # (N, 3) target minus prediction [m]
    # (N, 3, 3) diagonal blocks of the hat matrix; for a marker not used, what it would be
    hat: Array
    variance: float  # σ̂² [m²] of a weight of 1
    dof: int  # ν = 3 N - p
    # (3 (k+1), p) A with A Aᵀ σ̂² the covariance of row-major M: the inverse of a triangle with a
    # positive diagonal, which no rounding can turn, as it can the axes of equal eigenvalues
    root: Array

    @property
    def covariance(self) -> Array:
        """(3 (k+1), 3 (k+1)) of row-major M."""
        return self.variance * self.root @ self.root.T

    @property
    def leverage(self) -> Array:
        """(N,) mean of each hat block's diagonal; for the affine model the leverage h."""
        return np.trace(self.hat, axis1=1, axis2=2) / 3


def solve(problem: Problem, used: np.ndarray | None = None) -> Fit:
    """Fit the markers in `used` (all by default) and everything that follows linearly from it."""
    used = np.ones(len(problem.s), dtype=bool) if used is None else used
    model, weights = problem.model, problem.weights
    m = model.solve(problem.s[used], problem.y[used], weights[used])
    vectors = problem.y - problem.x @ m.T
    tangent = model.tangent(m)
    jacobian = (marker_rows(problem.x) @ tangent).reshape(len(used), 3, -1)
    root = np.sqrt(weights)[:, :, None] * jacobian
    # Columns have unlike units (radians, metres): scale them, or rounding decides the rank.
    inverse = root_of_inverse(root[used].reshape(-1, root.shape[2]))
    unit = inverse @ inverse.T
    dof = 3 * int(used.sum()) - model.parameters
    sse = float((weights[used] * vectors[used] ** 2).sum())
    variance = sse / dof
    hat = np.einsum("nap,pq,nbq,nb->nab", jacobian, unit, jacobian, weights, optimize=True)
    return Fit(problem, m, used, vectors, hat, variance, dof, tangent @ inverse)


def leave_one_out(fit: Fit) -> Array:
    """(N,) [m] error at each marker of the fit without it; NaN where that fit is undetermined.

    Affine: (I - H_i)⁻¹ e_i, exact without refitting. Otherwise every fit is done.
    """
    if isinstance(fit.problem.model, Affine):
        rest = np.eye(3) - fit.hat * fit.used[:, None, None]
        return np.linalg.norm(without_itself(fit.vectors, rest), axis=1)
    problem, n = fit.problem, len(fit.used)
    if fit.used.sum() - 1 < problem.model.minimal:
        return np.where(fit.used, np.nan, np.linalg.norm(fit.vectors, axis=1))
    keep = fit.used & ~np.eye(n, dtype=bool)
    weights = problem.weights * keep[:, :, None]
    m = problem.model.solve(problem.s[None], problem.y[None], weights)
    error = problem.y - np.einsum("nak,nk->na", m, problem.x)
    spread = _second_extent(problem.s, keep)
    return np.where(spread > 1e-6, np.linalg.norm(error, axis=1), np.nan)


def without_itself(vectors: Array, rest: Array) -> Array:
    """(N, 3) residuals of the fits without each marker, from I - H (N, 3, 3); NaN if singular."""
    open_ = np.linalg.svd(rest, compute_uv=False)[:, -1] > 1e-9
    found = np.full_like(vectors, np.nan)
    found[open_] = np.linalg.solve(rest[open_], vectors[open_][:, :, None])[:, :, 0]
    return found


def _second_extent(s: Array, keep: np.ndarray) -> Array:
    count = keep.sum(axis=1)[:, None]
    centred = s - (keep @ s / count)[:, None, :]
    return np.linalg.svd(centred * keep[:, :, None], compute_uv=False)[:, 1]


def studentised_f(fit: Fit) -> Array:
    """(N,) externally studentised F of each marker against the transform."""
    return f_of_each(fit.problem, fit.used, fit.vectors, fit.hat, fit.dof)


def f_of_each(problem: Problem, used: np.ndarray, vectors: Array, hat: Array, dof: int) -> Array:
    """(N,) externally studentised F of each marker, of 3 and ν - 3 degrees of freedom.

    q = eᵀ W (I - H)⁻¹ e is what the sum of squares loses without the marker; F is (q/3) over the
    mean square of the others (R. D. Cook and S. Weisberg, "Residuals and influence in regression",
    1982). A marker the fit did not use is tested as a new observation, which is the same F. NaN
    where no degree of freedom is left.
    """
    own, floor = used[:, None, None], problem.floor_m**2
    deleted = without_itself(vectors, np.eye(3) + np.where(own, -hat, hat))
    lost = (problem.weights * vectors * deleted).sum(axis=1)
    rest = np.maximum((problem.weights * vectors**2)[used].sum() - lost * used, floor)
    rest_dof = dof - 3 * used
    f = np.where(lost > floor, (lost / 3) / (rest / np.maximum(rest_dof, 1)), 0.0)
    return np.where((rest_dof > 0) & np.isfinite(lost), f, np.nan)


def f_limit(n: int, dof: int, alpha: float = 0.05) -> float:
    """F that a good marker exceeds with probability α/N (Bonferroni): α for any of N markers."""
    from scipy.special import fdtri

    return float(fdtri(3.0, float(dof), 1 - alpha / n))


def extent_and_error(fit: Fit) -> tuple[float, float]:
    """RMS extent [m] across the transformed layout, and the error [m] of a marker an axis."""
    used = fit.problem.s[fit.used]
    moved = (used - used.mean(axis=0)) @ fit.m[:, :-1].T
    extent = np.linalg.svd(moved, compute_uv=False)[1] / np.sqrt(len(used))
    return float(extent), float(np.sqrt(fit.variance))


def one_to_blame(fit: Fit) -> int | None:
    """The one marker without which the others agree where the transform does not explain them all.

    A similarity judges a planar affine fit, which follows a bad marker.
    """
    extent, error = extent_and_error(fit)
    if extent >= MIN_EXTENT * error:
        return None
    if isinstance(fit.problem.model, Affine) and fit.problem.model.dimension == 2:
        fit = solve(replace(fit.problem, model=Orthogonal(2, None, "similarity")), fit.used)
    if fit.dof < 6:
        return None
    f = np.nan_to_num(np.where(fit.used, studentised_f(fit), 0.0))
    worst = int(f.argmax())
    rest = solve(fit.problem, fit.used & (np.arange(len(f)) != worst))
    extent, error = extent_and_error(rest)
    alone = f[worst] > f_limit(len(f), rest.dof) and extent >= REST_EXTENT * error
    return worst if alone else None


def agreeing(problem: Problem, alpha: float = 0.05) -> np.ndarray:
    """(N,) bool: the markers that a robust fit rests on; `alpha` as in `f_limit`.

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
    core = list(_best_subset(problem, half))
    m = problem.model.through(problem.s[core], problem.y[core])
    used = np.zeros(n, dtype=bool)
    used[[*core, *np.argsort(_squares(problem, m), kind="stable")[:half]]] = True
    return _grow(problem, used, alpha)


def _half(n: int, problem: Problem) -> int:
    """Markers in the trimmed sum: the most outliers are tolerated, a residual is left."""
    least = problem.model.parameters // 3 + 1
    return min(n, max((n + problem.model.minimal + 1) // 2, least))


def _best_subset(problem: Problem, half: int) -> tuple[int, ...]:
    """The minimal subset whose map leaves the least trimmed sum of squares."""
    every = combinations(range(len(problem.s)), problem.model.minimal)
    best: tuple[float, tuple[int, ...]] = np.inf, ()
    while chunk := list(islice(every, _CHUNK)):
        index = np.array(chunk)
        index = index[spans(problem, index)]
        if len(index):
            m = problem.model.through(problem.s[index], problem.y[index])
            score = np.partition(_squares(problem, m), half - 1, axis=1)[:, :half].sum(axis=1)
            least = int(score.argmin())
            best = min(best, (float(score[least]), tuple(index[least].tolist())))
    return best[1]


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


def _grow(problem: Problem, used: np.ndarray, alpha: float) -> np.ndarray:
    while not used.all():
        fit = solve(problem, used)
        f = np.where(used, np.inf, studentised_f(fit))
        nearest = int(np.argmin(f))
        if f[nearest] > f_limit(len(used), fit.dof, alpha):
            break
        used = used.copy()
        used[nearest] = True
    return used
