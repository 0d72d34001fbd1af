"""What each marker says about the fit: residual, leverage, leave-one-out error, studentised F."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vfplan.registration.models import Affine, Array, marker_rows, root_of_inverse
from vfplan.registration.problem import Problem


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
        return np.linalg.norm(_deleted_vectors(fit), axis=1)
    problem, n = fit.problem, len(fit.used)
    if fit.used.sum() - 1 < problem.model.minimal:
        return np.where(fit.used, np.nan, np.linalg.norm(fit.vectors, axis=1))
    keep = fit.used & ~np.eye(n, dtype=bool)
    weights = problem.weights * keep[:, :, None]
    m = problem.model.solve(problem.s[None], problem.y[None], weights)
    error = problem.y - np.einsum("nak,nk->na", m, problem.x)
    spread = _second_extent(problem.s, keep)
    return np.where(spread > 1e-6, np.linalg.norm(error, axis=1), np.nan)


def _deleted_vectors(fit: Fit) -> Array:
    return without_itself(fit.vectors, np.eye(3) - fit.hat * fit.used[:, None, None])


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
    """(N,) externally studentised F of each marker, of 3 and ν - 3 degrees of freedom.

    q = eᵀ W (I - H)⁻¹ e is what the sum of squares loses without the marker; F is (q/3) over the
    mean square of the others (R. D. Cook and S. Weisberg, "Residuals and influence in regression",
    1982). A marker the fit did not use is tested as a new observation, which is the same F. NaN
    where no degree of freedom is left.
    """
    problem = fit.problem
    rest_dof = fit.dof - 3 * fit.used
    deleted = _deleted_vectors(fit)
    lost = (problem.weights * fit.vectors * deleted).sum(axis=1)
    outside = np.eye(3) + fit.hat
    new = np.linalg.solve(outside, fit.vectors[:, :, None])[:, :, 0]
    lost = np.where(fit.used, lost, (problem.weights * fit.vectors * new).sum(axis=1))
    sse = fit.variance * fit.dof
    floor = problem.floor_m**2
    rest = np.maximum(sse - lost * fit.used, floor)
    f = (lost / 3) / (rest / np.maximum(rest_dof, 1))
    f = np.where(lost > floor, f, 0.0)
    return np.where((rest_dof > 0) & np.isfinite(lost), f, np.nan)


def f_limit(n: int, dof: int, alpha: float = 0.05) -> float:
    """F that a good marker exceeds with probability α/N (Bonferroni): α for any of N markers."""
    from scipy.special import fdtri

    return float(fdtri(3.0, float(dof), 1 - alpha / n))
