"""The registration's error at other points than the markers, and the bounds that it stays within.

The fit's parameters have the covariance C of M (row-major, normalised coordinates). At a point with
x~ = [s, 1] the transform errs by δ = (I₃ ⊗ x~ᵀ) vec(δM), a normal vector of covariance
Σ = (I₃ ⊗ x~ᵀ) C (I₃ ⊗ x~). For the affine model with equal weights this is σ̂² h I₃ with the
leverage h = x~ (XᵀX)⁻¹ x~ᵀ; for the rigid model its trace is the formula of J. M. Fitzpatrick,
J. B. West and C. R. Maurer, IEEE TMI 17 (1998).

The pointwise bound b(r) covers each point with probability 0.95, hence all of a curve less often.
The band κ b(r) covers them all: with A Aᵀ the parameters' covariance in units of σ̂² and ω uniform
on the unit sphere of its p dimensions, the largest ratio along the curve is
g(ω) = max_r |X_r A ω| / b(r); the error's size in that direction does not depend on ω, and its
square over p is F(p, ν); so

    P(curve within κ b) = E_ω[ F_cdf(κ² / (p g(ω)²); p, ν) ],

and κ solves P = 0.95. The expectation is over fixed directions, the points of a Richtmyer sequence
(R. D. Richtmyer, LA-1342, 1951), and A is unique: the same input gives the same band on every
processor, within 2e-3 of the integral. Scheffé's band (H. Scheffé, "The Analysis of Variance",
1959) would cover the whole plane and is wider than a curve needs.
"""

from __future__ import annotations

import numpy as np

from vfplan.registration.models import Array

DIRECTIONS = 8192
TOGETHER = 8
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37)  # as many as the affine model of a solid has
MAX_POINTS = 100  # the error varies smoothly along a curve: more points change nothing


def tre_covariance(covariance: Array, x: Array) -> Array:
    """Σ (M, 3, 3) [m²] at x~ (M, k+1), from C (3 (k+1), 3 (k+1))."""
    k1 = x.shape[1]
    c = covariance.reshape(3, k1, 3, k1)
    return np.einsum("mi,aibj,mj->mab", x, c, x, optimize=True)


def rms(covariances: Array) -> Array:
    """RMS length (M,) [m] of an error with these covariances (M, 3, 3)."""
    return np.sqrt(np.maximum(np.trace(covariances, axis1=1, axis2=2), 0.0))


def bound(covariances: Array, dof: int, probability: float = 0.95) -> Array:
    """Radius (M,) [m] that the error's length stays below with this probability.

    δᵀδ is a sum of three squares weighted by Σ's eigenvalues λ; G. E. P. Box (Ann. Math. Stat. 25,
    1954) replaces it by one F variable of (Σλ)²/Σλ² and `dof` degrees of freedom, times Σλ. Exact
    when the non-zero eigenvalues are equal, as they are for the affine model.
    """
    from scipy.special import fdtri

    eigenvalues = np.maximum(np.linalg.eigvalsh(covariances), 0.0)
    total = eigenvalues.sum(axis=1)
    squares = (eigenvalues**2).sum(axis=1)
    freedom = np.divide(total**2, squares, out=np.full_like(total, 3.0), where=squares > 0)
    return np.sqrt(total * fdtri(freedom, float(dof), probability))


def curve_factor(parts: Array, pointwise: Array, dof: int, probability: float = 0.95) -> float:
    """κ ≥ 1, by which the pointwise bound must grow to hold for all points at once.

    parts: (M, 3, p) J_r A σ̂ at the curve's points: how the error there follows from p independent
        parameters of unit variance [m]; A of `residuals.Fit.root`
    pointwise: (M,) the points' own bounds [m]
    dof: degrees of freedom of σ̂
    """
    if not pointwise.max() > 0:  # an exact fit: nothing to widen
        return 1.0
    index = np.linspace(0, len(parts) - 1, min(len(parts), MAX_POINTS)).round().astype(int)
    directions = np.ascontiguousarray(_directions(parts.shape[2]).T)
    largest = np.zeros(DIRECTIONS)
    for part in parts[index] / pointwise[index, None, None]:
        np.maximum(largest, ((part @ directions) ** 2).sum(axis=0), out=largest)
    # F varies little among neighbours of the sorted values: their means do.
    means = np.sort(largest).reshape(-1, TOGETHER).mean(axis=1)
    return max(1.0, _solve(means, parts.shape[2], dof, probability))


def _directions(p: int) -> Array:
    """(DIRECTIONS, p) unit vectors, evenly over the sphere."""
    from scipy.special import ndtri

    uniform = np.mod(np.arange(1, DIRECTIONS + 1)[:, None] * np.sqrt(PRIMES[:p]) + 0.5, 1.0)
    normal = ndtri(uniform)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _solve(largest_squared: Array, p: int, dof: int, probability: float) -> float:
    from scipy.optimize import brentq
    from scipy.special import fdtr

    def lacking(kappa: float) -> float:
        return float(fdtr(p, dof, kappa**2 / (p * largest_squared)).mean()) - probability

    high = 1.0
    while lacking(high) < 0:
        high *= 1.5
    return float(brentq(lacking, 1e-9, high, xtol=1e-12))
