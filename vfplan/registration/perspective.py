"""Whether the slice was photographed at an angle: an F test of a homography against an affine map.

A camera that looks at a plane from the side sees a homography of it (R. Hartley and A. Zisserman,
"Multiple view geometry in computer vision", 2004, ch. 8), with two parameters more than an affine
map. No model here follows them, and no error bound counts them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vfplan.registration.distributions import f_exceeds
from vfplan.registration.fit import fit_model, studentised_f
from vfplan.registration.models import Affine, Array, homogeneous, marker_rows
from vfplan.registration.problem import Problem
from vfplan.registration.registration import Registration

# Good markers show so much perspective once in 200 sets: it wants an answer.
SURE_PROBABILITY = 1 / 200

# Good markers show so much perspective once in ten sets: it is a note. With a smaller probability
# more sets of a slice tilted by 1 or 2 degrees would pass, although their bound does not hold.
POSSIBLE_PROBABILITY = 0.1


@dataclass(frozen=True, eq=False)
class PerspectiveTest:
    """Whether a homography explains planar markers better than an affine map does."""

    # Probability that good markers show as much perspective.
    p_value: float
    # RMS localisation error of a marker under the homography [m].
    fle_rms_m: float
    # Largest distance between the homography and the affine map at a marker [m].
    departure_m: float
    # Whether the probability is small, and no single bad marker explains the residuals as well.
    is_significant: bool

    @property
    def is_possible(self) -> bool:
        """Whether a person should think of it."""
        return self.is_significant or self.p_value < POSSIBLE_PROBABILITY


def perspective_test(registration: Registration) -> PerspectiveTest | None:
    """F test of the two parameters that a homography has more than an affine map.

    `None` for markers in space, for fewer than six, and for an exact fit. All markers count, also
    those that a robust fit left out.
    """
    problem = registration.fit.problem
    n = len(problem.s)
    # Fewer than twice as many markers as an affine map needs leave hardly a residual to judge by.
    if problem.model.dimension != 2 or n < 2 * Affine(2).minimal:
        return None
    affine = fit_model(replace(problem, model=Affine(2)))
    affine_squares = affine.variance * affine.dof
    if not affine_squares > n * problem.rounding_floor_m**2:
        return None
    h = fit_homography(problem, affine.m)
    if not (1 + problem.s @ h[9:] > 0).all():
        return None  # A marker would lie behind the camera.

    mapped = _homography(h, problem.s)
    dof = 3 * n - len(h)
    squares = float((problem.weights * (problem.y - mapped) ** 2).sum())
    squares = max(squares, problem.rounding_floor_m**2)
    f = max(affine_squares - squares, 0.0) / 2 / (squares / dof)
    p_value = float(f_exceeds(2, dof, f))

    # The probability that any marker of a good set is as much of an outlier as the worst one here.
    f_of_markers = np.nan_to_num(studentised_f(affine))
    outlier_probability = n * float(f_exceeds(3, affine.dof - 3, f_of_markers.max()))
    return PerspectiveTest(
        p_value=p_value,
        fle_rms_m=float(np.sqrt(3 * squares / dof)),
        departure_m=float(np.linalg.norm(mapped - problem.x @ affine.m.T, axis=1).max()),
        is_significant=p_value < min(SURE_PROBABILITY, outlier_probability),
    )


def fit_homography(problem: Problem, m: Array) -> Array:
    """(11,) the homography of least weighted squares: row-major M, then q of 1 + q·s.

    By Gauss-Newton from the affine map M (3, 3).
    """
    root = np.sqrt(problem.weights)
    h = np.append(m, [0.0, 0.0])
    for _ in range(30):
        depth = (1 + problem.s @ h[9:])[:, None, None]
        mapped = _homography(h, problem.s)
        linear = marker_rows(problem.x).reshape(len(problem.s), 3, 9) / depth
        bend = -mapped[:, :, None] * problem.s[:, None, :] / depth
        rows = np.concatenate([linear, bend], axis=2) * root[:, :, None]
        error = root * (problem.y - mapped)
        step = np.linalg.lstsq(rows.reshape(-1, len(h)), error.ravel(), rcond=None)[0]
        h = h + step
        if np.abs(step[9:]).max() < 1e-12:
            break
    return h


def _homography(h: Array, s: Array) -> Array:
    """(N, 3) positions M x~ / (1 + q·s) of s (N, 2), for row-major M and then q in h (11,)."""
    return homogeneous(s) @ h[:9].reshape(3, 3).T / (1 + s @ h[9:])[:, None]
