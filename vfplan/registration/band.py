"""A bound on the registration error that holds for a whole curve at once.

The pointwise bound b(r) covers each point with probability 0.95, hence all of a curve less often.
The band κ b(r) covers them all: with A Aᵀ the parameters' covariance in units of σ̂² and ω uniform
on the unit sphere of its p dimensions, the largest ratio along the curve is
g(ω) = max_r |X_r A ω| / b(r); the error's size in that direction does not depend on ω, and its
square over p is F(p, ν); so

    P(curve within κ b) = E_ω[ F_cdf(κ² / (p g(ω)²); p, ν) ],

and κ solves P = 0.95. The expectation is over fixed directions, so the same input gives the same
band. Scheffé's band (H. Scheffé, "The Analysis of Variance", 1959) would cover the whole plane and
is wider than a curve needs.
"""

from __future__ import annotations

import numpy as np

from vfplan.registration.models import Array

DIRECTIONS = 4096
MAX_POINTS = 100  # the error varies smoothly along a curve: more points change nothing


def curve_factor(
    covariance: Array, x: Array, pointwise: Array, dof: int, probability: float = 0.95
) -> float:
    """κ ≥ 1, by which the pointwise bound must grow to hold for all points at once.

    Parameters
    ----------
    covariance
        (3 (k+1), 3 (k+1)) of row-major M.
    x
        (M, k+1) the curve's points x~.
    pointwise
        (M,) their pointwise bounds [m].
    dof
        Degrees of freedom of the covariance.
    """
    if not pointwise.max() > 0:  # an exact fit: nothing to widen
        return 1.0
    index = _thinned(pointwise)
    root = _root(covariance)
    omega = np.random.default_rng(20260101).standard_normal((DIRECTIONS, root.shape[1]))
    omega /= np.linalg.norm(omega, axis=1, keepdims=True)
    largest = np.zeros(DIRECTIONS)
    moves = (omega @ root.T).reshape(DIRECTIONS, 3, -1)
    for i in np.array_split(index, max(1, len(index) // 50)):
        error = np.einsum("dai,mi->dma", moves, x[i], optimize=True)
        ratio = np.einsum("dma,dma->dm", error, error) / pointwise[i] ** 2
        np.maximum(largest, ratio.max(axis=1), out=largest)
    return max(1.0, _solve(largest, root.shape[1], dof, probability))


def _thinned(pointwise: Array) -> np.ndarray:
    index = np.linspace(0, len(pointwise) - 1, min(len(pointwise), MAX_POINTS)).round().astype(int)
    return np.unique(np.append(index, pointwise.argmax()))


def _root(covariance: Array) -> Array:
    """A (P, p) with A Aᵀ = C, p its rank; scaled first, so that units do not decide the rank."""
    scale = np.sqrt(np.diag(covariance))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    keep = values > 1e-9 * values.max()
    return scale[:, None] * vectors[:, keep] * np.sqrt(values[keep])


def _solve(largest_squared: Array, p: int, dof: int, probability: float) -> float:
    from scipy.special import fdtr

    def lacking(kappa: float) -> float:
        return float(fdtr(p, dof, kappa**2 / (p * largest_squared)).mean()) - probability

    low, high = 0.0, 1.0
    while (above := lacking(high)) < 0:
        low, high = high, 1.5 * high
    below = lacking(low) if low else -probability
    # Regula falsi in the Illinois form: each evaluation is 4096 values of F.
    side = 0
    for _ in range(50):
        kappa = (low * above - high * below) / (above - below)
        value = lacking(kappa)
        if abs(value) < 1e-7:
            return kappa
        if value > 0:
            high, above, below, side = kappa, value, below / (1 + (side == 1)), 1
        else:
            low, below, above, side = kappa, value, above / (1 + (side == -1)), -1
    return high
