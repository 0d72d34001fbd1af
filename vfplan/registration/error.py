"""The registration's error at other points than the markers, and the bounds that it stays within.

The fit's parameters have the covariance C of M (row-major, normalised coordinates). At a point with
x~ = [s, 1] the transform errs by δ = (I₃ ⊗ x~ᵀ) vec(δM), a normal vector of covariance
Σ = (I₃ ⊗ x~ᵀ) C (I₃ ⊗ x~). For the affine model with equal weights this is σ² h I₃ with the
leverage h = x~ᵀ (XᵀX)⁻¹ x~. For the rigid model its trace is the formula of J. M. Fitzpatrick,
J. B. West and C. R. Maurer, "Predicting error in rigid-body point-based registration", IEEE TMI 17
(1998).

The pointwise bound b(r) covers each point with probability 0.95, hence all of a curve less often.
The bound of the curve is κ b(r). With A Aᵀ the parameters' covariance in units of σ² and ω uniform
on the unit sphere of their p dimensions, the largest ratio along the curve is
g(ω) = max_r |J_r A ω| / b(r). The error's size does not depend on its direction ω, and its square
over p is F-distributed with p and ν degrees of freedom. So

    P(the whole curve within κ b) = E_ω[ F_cdf(κ² / (p g(ω)²); p, ν) ],

and κ solves P = 0.95. The expectation is over fixed directions, the points of a sequence that fills
the sphere evenly (R. D. Richtmyer, LA-1342, 1951), so the same input gives the same bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.registration.distributions import f_exceeds, f_quantile
from vfplan.registration.models import Array, homogeneous, marker_rows

if TYPE_CHECKING:
    from vfplan.registration.registration import Registration

# Probability that an error stays within its bound, and that an interval holds the true value.
PROBABILITY = 0.95

# Number of directions of the expectation. With this many κ is within 0.2 % of its limit.
DIRECTIONS = 8192

# Number of points of the curve that κ is taken over. The error changes slowly along it, so more
# points give the same.
CURVE_POINTS = 64


@dataclass(frozen=True, eq=False)
class TargetError:
    """The predicted target registration error along a curve of M points."""

    # (M,) predicted RMS error at each point [m].
    rms_m: Array
    # (M,) bound at each point, with probability 0.95 for that point [m].
    bound95_m: Array
    # (M,) bound for all points at once, with probability 0.95 [m].
    curve95_m: Array
    # Index of the point with the largest bound.
    worst: int
    # (M,) whether a point is predicted worse than every marker: it lies beyond them.
    is_extrapolated: NDArray[np.bool_]


def target_error(registration: Registration, points: ArrayLike) -> TargetError:
    """The predicted error along a curve (M, 2|3) given in the source frame."""
    rms_m = registration.tre_m(points)
    curve95_m = registration.tre95_curve_m(points)
    at_markers_m = registration.tre_m(registration.source[registration.used])
    return TargetError(
        rms_m=rms_m,
        bound95_m=registration.tre95_m(points),
        curve95_m=curve95_m,
        worst=int(curve95_m.argmax()),
        is_extrapolated=rms_m > at_markers_m.max() * (1 + 1e-9),
    )


def error_rows(s: Array, root: Array) -> Array:
    """(M, 3, p) J_r A: how the error at normalised points s (M, k) follows from p unit normals."""
    return marker_rows(homogeneous(s)).reshape(len(s), 3, -1) @ root


def pointwise_bound(covariances: Array, dof: int) -> Array:
    """(M,) radius [m] that an error stays within with 0.95, for covariances (M, 3, 3) [m²].

    |δ|² is a sum of three squares weighted by Σ's eigenvalues λ. G. E. P. Box ("Some theorems on
    quadratic forms", Ann. Math. Stat. 25, 1954) replaces it by Σλ times an F variable of
    (Σλ)²/Σλ² and `dof` degrees of freedom. That is exact where the eigenvalues that are not 0 are
    equal, as they are for the affine model.
    """
    eigenvalues = np.maximum(np.linalg.eigvalsh(covariances), 0.0)
    total = eigenvalues.sum(axis=1)
    squares = (eigenvalues**2).sum(axis=1)
    freedom = np.full_like(total, 3.0)
    np.divide(total**2, squares, out=freedom, where=squares > 0)
    return np.sqrt(total * f_quantile(freedom, dof, PROBABILITY))


def whole_curve_factor(rows: Array, pointwise_m: Array, dof: int) -> float:
    """κ of at least 1, by which the pointwise bound must grow to hold for all points at once.

    rows: (M, 3, p) [m] of `error_rows`, times the standard deviation
    pointwise_m: (M,) the points' own bounds [m]
    dof: degrees of freedom of the standard deviation
    """
    if not pointwise_m.max() > 0:
        return 1.0  # An exact fit has no error to bound.
    p = rows.shape[2]
    chosen = np.linspace(0, len(rows) - 1, min(len(rows), CURVE_POINTS)).round().astype(int)
    directions = _directions(p)
    # The g(ω)² of each direction ω.
    largest = np.zeros(DIRECTIONS)
    for row in rows[chosen] / pointwise_m[chosen, None, None]:
        np.maximum(largest, ((row @ directions) ** 2).sum(axis=0), out=largest)

    # Neighbours of the sorted values are nearly equal, so their mean stands for all of them.
    largest = np.sort(largest).reshape(-1, 16).mean(axis=1)

    def probability(kappa: float) -> float:
        return 1 - float(f_exceeds(p, dof, kappa**2 / (p * largest)).mean())

    low, high = 0.0, 1.0
    while probability(high) < PROBABILITY:
        low, high = high, 2 * high
    while high - low > 1e-5 * high:
        middle = (low + high) / 2
        if probability(middle) < PROBABILITY:
            low = middle
        else:
            high = middle
    return max(1.0, high)


@cache
def _directions(p: int) -> Array:
    """(p, DIRECTIONS) unit vectors, evenly over the sphere."""
    # Multiples of the square roots of primes, one a parameter, are Richtmyer's sequence.
    primes = np.array([2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37])
    steps = np.arange(1, DIRECTIONS + 1)[:, None]
    uniform = np.mod(steps * np.sqrt(primes[:p]) + 0.5, 1.0)
    quantile = NormalDist().inv_cdf
    normal = np.reshape([quantile(share) for share in uniform.flat], uniform.shape)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.ascontiguousarray(normal.T)
