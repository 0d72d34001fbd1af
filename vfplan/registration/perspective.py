"""Perspective: what a camera that does not look straight on leaves in an affine fit.

A photograph of a plate is its homography, y = M x~ / (1 + q·s), with two parameters more than the
affine map. The residuals it leaves in an affine fit are not noise: they bend, and so does the error
along the curve, while each marker looks like an outlier. An F test of the two parameters tells.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vfplan.registration.models import Affine, Array, homogeneous, marker_rows, root_of_inverse
from vfplan.registration.problem import Problem
from vfplan.registration.residuals import Fit, solve, studentised_f, without_itself

PARAMETERS = 11
FEWEST_MARKERS = 6
# The bound is widened where good markers come once in ten sets: too wide does no harm, too narrow
# does. It is said, and counts in the predicted TRE, where they come once in 20,000: far beyond
# a strip of markers a homography of chance is so wide that one in ten thousand biases the TRE.
WIDENED = 0.1
SAID = 5e-5


@dataclass(frozen=True, eq=False)
class Perspective:
    """A homography that explains the markers better than the affine map."""

    # (3, 3) and (2,) in normalised coordinates: y = M x~ / (1 + q·s)
    m: Array
    q: Array
    root: Array  # (11, 11) A with A Aᵀ σ̂² the covariance of M's entries and q
    # σ̂² [m²] of a weight of 1, and 3 N - 11
    variance: float
    dof: int
    p_value: float  # probability of this much perspective from markers without any
    studentised_f: Array  # (N,) of each marker against the homography

    @property
    def sure(self) -> bool:
        """Whether it is said, and not only allowed for in the bound."""
        return self.p_value < SAID

    def apply(self, s: Array) -> Array:
        """Centred target positions (M, 3) [m] of normalised points (M, 2)."""
        return homogeneous(s) @ self.m.T / (1 + s @ self.q)[:, None]

    def rows(self, s: Array) -> Array:
        """(M, 3, 11): how the position of s moves with the parameters."""
        return _rows(self.m, self.q, s)


def perspective(fit: Fit) -> Perspective | None:
    """The homography of the markers used, where it explains what an affine map leaves.

    `None` for 3-D markers, for fewer than `FEWEST_MARKERS`, where the F test finds nothing, and
    where one bad marker explains the residuals better.
    """
    from scipy.special import fdtrc, fdtri

    problem, used = fit.problem, fit.used
    n = int(used.sum())
    if problem.model.dimension != 2 or n < FEWEST_MARKERS:
        return None
    if not isinstance(problem.model, Affine):
        fit = solve(replace(problem, model=Affine(2)), used)
    dof, sse = 3 * n - PARAMETERS, fit.variance * fit.dof
    limit = float(fdtri(2.0, float(dof), 1 - WIDENED))
    if not sse > n * problem.floor_m**2:
        return None
    after_a_step = max(_step(problem, fit.m, np.zeros(2), used)[1], problem.floor_m**2)
    if _gain(sse, after_a_step, dof) < limit / 2:
        return None
    m, q = _homography(problem, fit.m, used)
    if not (1 + problem.s @ q > 0).all():
        return None
    error = problem.y - _positions(m, q, problem.s)
    left = max(float((problem.weights * error**2)[used].sum()), problem.floor_m**2)
    gain = _gain(sse, left, dof)
    p_value = float(fdtrc(2.0, float(dof), gain))
    if gain < limit or p_value > _best_outlier(fit):
        return None
    root = root_of_inverse(_weighted(problem, m, q, used))
    # As `residuals.studentised_f`, of the linearised homography.
    spread = _rows(m, q, problem.s) @ root
    hat = np.einsum("nap,nbp,nb->nab", spread, spread, problem.weights)
    deleted = without_itself(error, np.eye(3) + np.where(used, -1.0, 1.0)[:, None, None] * hat)
    lost = (problem.weights * error * deleted).sum(axis=1)
    remaining = np.maximum(left - lost * used, problem.floor_m**2)
    f = (lost / 3) / (remaining / (dof - 3 * used))
    return Perspective(m, q, root, left / dof, dof, p_value, f)


def _gain(sse: float, left: float, dof: int) -> float:
    return (sse - left) / 2 / (left / dof)


def _positions(m: Array, q: Array, s: Array) -> Array:
    return homogeneous(s) @ m.T / (1 + s @ q)[:, None]


def _rows(m: Array, q: Array, s: Array) -> Array:
    below = (1 + s @ q)[:, None, None]
    linear = marker_rows(homogeneous(s)).reshape(len(s), 3, 9) / below
    bent = -_positions(m, q, s)[:, :, None] * s[:, None, :] / below
    return np.concatenate([linear, bent], axis=2)


def _weighted(problem: Problem, m: Array, q: Array, used: np.ndarray) -> Array:
    rows = np.sqrt(problem.weights)[:, :, None] * _rows(m, q, problem.s)
    return rows[used].reshape(-1, PARAMETERS)


def _step(problem: Problem, m: Array, q: Array, used: np.ndarray) -> tuple[Array, float]:
    """Gauss-Newton's step, and the sum of squares that the linear problem leaves after it."""
    error = np.sqrt(problem.weights) * (problem.y - _positions(m, q, problem.s))
    rows, right = _weighted(problem, m, q, used), error[used].ravel()
    step = np.linalg.lstsq(rows, right, rcond=None)[0]
    return step, float(((right - rows @ step) ** 2).sum())


def _homography(problem: Problem, m: Array, used: np.ndarray) -> tuple[Array, Array]:
    q = np.zeros(2)
    for _ in range(30):
        step, _ = _step(problem, m, q, used)
        m, q = m + step[:9].reshape(3, 3), q + step[9:]
        if np.abs(step[9:]).max() < 1e-12:
            break
    return m, q


def _best_outlier(fit: Fit) -> float:
    """Probability, over all markers, of the worst marker's F in the affine fit."""
    from scipy.special import fdtrc

    f = studentised_f(fit)[fit.used]
    n, dof = len(f), fit.dof - 3
    return min(1.0, n * float(fdtrc(3.0, float(dof), np.nanmax(f)))) if np.isfinite(f).any() else 1
