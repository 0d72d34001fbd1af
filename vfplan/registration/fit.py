"""A fitted transform, and what each marker says about it: residual, leverage, leave-one-out, F.

Fisher's F distribution stands here, because importing scipy.special takes a quarter of the time of
planning a fixture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from vfplan.geometry.lines import Array, Flags
from vfplan.registration.models import (
    MAX_CONDITION,
    Affine,
    Orthogonal,
    Problem,
    marker_rows,
    root_of_inverse,
)


def f_exceeds(dof: ArrayLike, other_dof: ArrayLike, f: ArrayLike) -> Array:
    """The probability that F of these degrees of freedom exceeds f >= 0."""
    share = np.divide(other_dof, np.multiply(dof, f) + other_dof)
    a, b = np.divide(other_dof, 2), np.divide(dof, 2)
    return _beta_share(share, a, b, _log_beta(a, b))


def f_quantile(dof: ArrayLike, other_dof: ArrayLike, probability: float) -> Array:
    """What F of these degrees of freedom stays below with a probability."""
    a, b = np.broadcast_arrays(np.divide(dof, 2), np.divide(other_dof, 2))
    # Newton's method for log F, whose distribution is nearly symmetric; in bounds, which are halved
    # where a step would lead out of them.
    log_f, low, high = np.zeros(a.shape), np.full(a.shape, -700.0), np.full(a.shape, 700.0)
    log_beta = _log_beta(a, b)
    for _ in range(100):
        f = np.exp(log_f)
        excess = 1 - probability - _beta_share(b / (a * f + b), b, a, log_beta)
        low, high = np.where(excess < 0, log_f, low), np.where(excess < 0, high, log_f)
        x = a * f / (a * f + b)
        density = np.exp(a * np.log(x) + b * np.log1p(-x) - log_beta)
        tried = log_f - excess / np.maximum(density, 1e-300)
        tried = np.where((low <= tried) & (tried <= high), tried, (low + high) / 2)
        largest_step = np.abs(tried - log_f).max(initial=0.0)
        log_f = tried
        if not largest_step >= 1e-12:
            break
    return np.exp(log_f)


def _beta_share(x: ArrayLike, a: ArrayLike, b: ArrayLike, log_beta: ArrayLike) -> Array:
    """The regularised incomplete beta function I_x(a, b), by its continued fraction.

    `log_beta` is the logarithm of the beta function of a and b.

    NIST's Digital Library of Mathematical Functions, 8.17.22, evaluated from the front. It
    converges quickly below the mean; above it I_x(a, b) = 1 - I_(1-x)(b, a).
    """
    x, a, b = np.broadcast_arrays(x, a, b)
    is_above = x > (a + 1) / (a + b + 2)
    x = np.where(is_above, 1 - x, x)
    a, b = np.where(is_above, b, a), np.where(is_above, a, b)
    d = 1 / (1 - (a + b) * x / (a + 1))
    c, fraction = np.ones_like(d), d
    for m in range(1, 10_000):
        for factor in (
            m * (b - m) / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            d = 1 / (1 + factor * x * d)
            c = 1 + factor * x / c
            fraction = fraction * c * d
        if not (np.abs(c * d - 1) >= 1e-15).any():  # Of no number it never is.
            break
    x = np.maximum(x, np.finfo(float).tiny)
    share = fraction / a * np.exp(a * np.log(x) + b * np.log1p(-x) - log_beta)
    return np.where(is_above, 1 - share, share)


def _log_beta(a: ArrayLike, b: ArrayLike) -> Array:
    """The logarithm of the beta function."""
    log_gamma = np.vectorize(math.lgamma, otypes=[float])
    return log_gamma(a) + log_gamma(b) - log_gamma(np.add(a, b))


# A set of good markers is suspected once in a hundred: of an outlier, of mistaken labels, or of
# larger residuals than stated.
GOOD_SET_PROBABILITY = 0.01

# What good markers or touched points show once in 10,000 sets has another cause.
RARE_PROBABILITY = 1e-4


@dataclass(frozen=True, eq=False)
class Fit:
    """A problem and its least squares solution."""

    problem: Problem
    # (3, k+1) the transform in normalised coordinates.
    m: Array
    # (N,) the markers that the fit rests on.
    used: Flags
    # (N, 3) target minus transformed source [m].
    vectors: Array
    # (N, 3, 3) the hat matrix's diagonal blocks H_i; of a marker not used, what it would be.
    hat: Array
    # Estimated variance of a target coordinate of weight 1 [m²].
    variance: float
    # Degrees of freedom, 3 N - p.
    dof: int
    # (3 (k+1), p) A, so that variance times A Aᵀ is the covariance of row-major M.
    covariance_root: Array

    @property
    def covariance(self) -> Array:
        """(3 (k+1), 3 (k+1)) covariance of row-major M."""
        return self.variance * self.covariance_root @ self.covariance_root.T

    @property
    def leverage(self) -> Array:
        """(N,) share of each marker in its own prediction: the mean of its block's diagonal."""
        return np.trace(self.hat, axis1=1, axis2=2) / 3


def fit_model(problem: Problem, used: Flags | None = None) -> Fit:
    """Fit the markers that are `used` (N,), by default all of them."""
    if used is None:
        used = np.ones(len(problem.s), dtype=bool)
    model, weights = problem.model, problem.weights
    m = model.solve(problem.s[used], problem.y[used], weights[used])
    vectors = problem.y - problem.x @ m.T
    dof = 3 * int(used.sum()) - model.parameters
    squares = float((weights[used] * vectors[used] ** 2).sum())

    # How the mapped markers move with the parameters, and from it the parameters' covariance.
    tangent = model.tangent(m)
    jacobian = (marker_rows(problem.x) @ tangent).reshape(len(used), 3, -1)
    weighted = np.sqrt(weights)[:, :, None] * jacobian
    inverse_root = root_of_inverse(weighted[used].reshape(-1, model.parameters))
    spread = jacobian @ inverse_root
    hat = spread @ np.swapaxes(spread, 1, 2) * weights[:, None, :]
    return Fit(problem, m, used, vectors, hat, squares / dof, dof, tangent @ inverse_root)


def fit_similarity(problem: Problem, used: Flags) -> Fit:
    """Fit a similarity to the markers that are `used` (N,), whatever the problem's own model."""
    similarity = Orthogonal(problem.model.dimension, None, "similarity")
    return fit_model(replace(problem, model=similarity), used)


def leave_one_out(fit: Fit) -> Array:
    """(N,) error at each marker of the fit without it [m]; NaN where that is undetermined.

    For the affine model it is (I - H_i)⁻¹ e_i, exact without another fit (R. D. Cook and
    S. Weisberg, "Residuals and influence in regression", 1982, section 2.2). Every other model is
    fitted again without each marker.
    """
    problem, used = fit.problem, fit.used
    if isinstance(problem.model, Affine):
        self_share = fit.hat * used[:, None, None]
        return np.linalg.norm(_solve_blocks(np.eye(3) - self_share, fit.vectors), axis=1)
    errors = np.linalg.norm(fit.vectors, axis=1)
    for i in np.flatnonzero(used):
        others = used & (np.arange(len(used)) != i)
        errors[i] = np.nan
        s = problem.s[others]
        # How far the others spread beside the line that fits them best.
        width = np.linalg.svd(s - s.mean(axis=0), compute_uv=False)[1]
        if others.sum() >= problem.model.minimal and width > 1 / MAX_CONDITION:
            m = problem.model.solve(s, problem.y[others], problem.weights[others])
            errors[i] = np.linalg.norm(problem.y[i] - m @ problem.x[i])
    return errors


def studentised_f(fit: Fit) -> Array:
    """(N,) F of each marker against the others, with 3 and ν - 3 degrees of freedom.

    q = eᵀ W (I - H)⁻¹ e is what the sum of squares loses without the marker, and F is q / 3 over
    the mean square of the others (Cook and Weisberg, section 2.2). A marker that the fit did not
    use is tested as a new observation, which gives the same F. NaN where no degree of freedom is
    left to judge by.
    """
    problem, used, vectors = fit.problem, fit.used, fit.vectors
    sign = np.where(used, -1.0, 1.0)[:, None, None]
    deleted = _solve_blocks(np.eye(3) + sign * fit.hat, vectors)
    lost = (problem.weights * vectors * deleted).sum(axis=1)
    floor = problem.rounding_floor_m**2
    total = float((problem.weights * vectors**2)[used].sum())
    others = np.maximum(total - lost * used, floor)
    others_dof = fit.dof - 3 * used
    f = (lost / 3) / (others / np.maximum(others_dof, 1))
    f[lost <= floor] = 0.0  # The fit is exact, but for rounding.
    f[~(others_dof > 0) | ~np.isfinite(lost)] = np.nan
    return f


@cache
def f_limit(n: int, dof: int, probability: float = GOOD_SET_PROBABILITY) -> float:
    """F of 3 and `dof` degrees of freedom that any of n good markers exceeds so seldom.

    The probability is shared evenly among the markers (Bonferroni).
    """
    return float(f_quantile(3, dof, 1 - probability / n))


def _solve_blocks(blocks: Array, vectors: Array) -> Array:
    """(N, 3) solutions of N systems; NaN where the block is singular."""
    regular = np.linalg.svd(blocks, compute_uv=False)[:, -1] > 1e-9
    solutions = np.full_like(vectors, np.nan)
    solutions[regular] = np.linalg.solve(blocks[regular], vectors[regular][:, :, None])[:, :, 0]
    return solutions
