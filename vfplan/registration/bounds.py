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

A photograph of a plate is its homography, y = M x~ / (1 + q·s), with two parameters more than the
affine map. The residuals it leaves in an affine fit are not noise: they bend, and so does the error
along the curve, while each marker looks like an outlier. An F test of the two parameters tells.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vfplan.errors import CheckFailed
from vfplan.registration.fit import Fit, f_of_each, solve, studentised_f
from vfplan.registration.models import (
    Affine,
    Array,
    homography,
    homography_rows,
    root_of_inverse,
)
from vfplan.registration.problem import Problem, outside_hull

if TYPE_CHECKING:
    from vfplan.registration.result import Registration

DIRECTIONS = 8192
TOGETHER = 8
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37)  # as many as the affine model of a solid has
MAX_POINTS = 100  # the error varies smoothly along a curve: more points change nothing
PARAMETERS = 11
FEWEST_MARKERS = 6
# The bound is widened where good markers come once in ten sets (few markers show perspective badly:
# once in four): too wide does no harm, too narrow does. It is warned of where good ones come once
# in 100, and counts in the predicted TRE where once in 20,000: far beyond a strip of markers a
# homography of chance is so wide that one in ten thousand biases it.
WIDENED, WIDENED_OF_FEW, FEW_MARKERS = 0.1, 0.25, 8
MOST_UNSEEN = 2.0  # of the model's own bound: far beyond a strip there is no other
SAID = 0.01
COUNTED = 5e-5


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
        parameters of unit variance [m]; A of `fit.Fit.root`
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


@dataclass(frozen=True, eq=False)
class TargetError:
    """The predicted target registration error along a curve."""

    rms_m: Array  # (M,) predicted RMS TRE at each point [m]
    bound95_m: Array  # (M,) bound at each point, probability 0.95 for that point [m]
    curve95_m: Array  # (M,) bound for all points at once, probability 0.95 [m]
    worst: int  # index of the point with the largest bound
    outside_hull: np.ndarray  # (M,) bool: outside the markers' convex hull
    extrapolated: np.ndarray  # (M,) bool: predicted worse than at every marker

    @property
    def warnings(self) -> tuple[str, ...]:
        """A sentence where part of the curve lies beyond the markers."""
        beyond = int((self.outside_hull | self.extrapolated).sum())
        if not beyond:
            return ()
        share = beyond / len(self.rms_m)
        return (
            f"{beyond} of {len(self.rms_m)} curve points ({share:.0%}) lie beyond the markers: "
            "the registration is extrapolated there",
        )


def target_error(registration: Registration, points: ArrayLike) -> TargetError:
    """The predicted error along a curve given in the source frame, (M, 2|3)."""
    rms = registration.tre_m(points)
    bound = registration.tre95_m(points)
    problem = registration.fit.problem
    s = registration.normalised(points)
    at_markers = registration.tre_m(registration.source[registration.used])
    return TargetError(
        rms,
        bound,
        registration.tre95_curve_m(points),
        int(bound.argmax()),
        outside_hull(problem.s[registration.used], s),
        rms > at_markers.max() * (1 + 1e-9),
    )


def check_max_tre(error: TargetError, limit_m: float) -> None:
    """The gate: the 95 % bound for the whole curve must stay below the limit everywhere.

    Raises CheckFailed: with the largest bound, where it is, and the limit
    """
    worst = int(error.curve95_m.argmax())
    value = float(error.curve95_m[worst])
    if not value <= limit_m:
        raise CheckFailed(
            f"the registration error may reach {value * 1e3:.3f} mm (95 % bound over the curve), "
            f"more than the {limit_m * 1e3:g} mm allowed",
            where=f"curve point {worst}",
        )


@dataclass(frozen=True, eq=False)
class Perspective:
    """The homography that explains the markers best."""

    # (11,) of y = M x~ / (1 + q·s) in normalised coordinates: row-major M, then q
    h: Array
    root: Array  # (11, 11) A with A Aᵀ σ̂² the covariance of `h`
    # σ̂² [m²] of a weight of 1, and 3 N - 11
    variance: float
    dof: int
    p_value: float  # probability of this much perspective from markers without any
    told: bool  # whether that is little, and no bad marker's doing: it widens every bound
    studentised_f: Array  # (N,) of each marker against the homography

    @property
    def sure(self) -> bool:
        """Whether it counts in the predicted TRE, and not only in the bound."""
        return self.p_value < COUNTED

    @property
    def said(self) -> bool:
        """Whether it is warned of."""
        return self.p_value < SAID

    def apply(self, s: Array) -> Array:
        """Centred target positions (M, 3) [m] of normalised points (M, 2)."""
        return homography(self.h, s)

    def rows(self, s: Array) -> Array:
        """(M, 3, 11): how the position of s moves with the parameters."""
        return homography_rows(self.h, s)


def perspective(fit: Fit) -> Perspective | None:
    """The homography of the markers used.

    `None` for 3-D markers and fewer than `FEWEST_MARKERS`. Where the F test finds nothing, or one
    bad marker explains the residuals better, it is not `told`.
    """
    from scipy.special import fdtrc

    problem, used = fit.problem, fit.used
    n = int(used.sum())
    if problem.model.dimension != 2 or n < FEWEST_MARKERS:
        return None
    if not isinstance(problem.model, Affine):
        fit = solve(replace(problem, model=Affine(2)), used)
    dof, sse = 3 * n - PARAMETERS, fit.variance * fit.dof
    if not sse > n * problem.floor_m**2:
        return None
    h = _homography(problem, np.append(fit.m, [0.0, 0.0]), used)
    if not (1 + problem.s @ h[9:] > 0).all():
        return None
    error = problem.y - homography(h, problem.s)
    left = max(float((problem.weights * error**2)[used].sum()), problem.floor_m**2)
    gain = max(sse - left, 0.0) / 2 / (left / dof)
    p_value = float(fdtrc(2.0, float(dof), gain))
    limit = WIDENED_OF_FEW if n <= FEW_MARKERS else WIDENED
    told = p_value < limit and p_value <= _best_outlier(fit)
    root = root_of_inverse(_weighted(problem, h, used))
    spread = homography_rows(h, problem.s) @ root
    hat = np.einsum("nap,nbp,nb->nab", spread, spread, problem.weights)
    f = f_of_each(problem, used, error, hat, dof)
    return Perspective(h, root, left / dof, dof, p_value, told, f)


def with_unseen(plain: Array, bent: Array, p_value: float) -> Array:
    """The model's bound, and the more of a homography's beyond it the less chance explains it."""
    return plain + (1 - p_value) ** 2 * np.clip(bent - plain, 0.0, MOST_UNSEEN * plain)


def _weighted(problem: Problem, h: Array, used: np.ndarray) -> Array:
    rows = np.sqrt(problem.weights)[:, :, None] * homography_rows(h, problem.s)
    return rows[used].reshape(-1, PARAMETERS)


def _homography(problem: Problem, h: Array, used: np.ndarray) -> Array:
    """The one of least squares, by Gauss-Newton from another."""
    for _ in range(30):
        error = np.sqrt(problem.weights) * (problem.y - homography(h, problem.s))
        step = np.linalg.lstsq(_weighted(problem, h, used), error[used].ravel(), rcond=None)[0]
        h = h + step
        if np.abs(step[9:]).max() < 1e-12:
            break
    return h


def _best_outlier(fit: Fit) -> float:
    """Probability, over all markers, of the worst marker's F in the affine fit."""
    from scipy.special import fdtrc

    f = studentised_f(fit)[fit.used]
    n, dof = len(f), fit.dof - 3
    return min(1.0, n * float(fdtrc(3.0, float(dof), np.nanmax(f)))) if np.isfinite(f).any() else 1
