"""From markers to a registration: the one call."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from vfplan.registration.models import ModelName
from vfplan.registration.problem import make_problem
from vfplan.registration.residuals import solve
from vfplan.registration.result import Registration
from vfplan.registration.robust import agreeing


def fit_registration(
    source: ArrayLike,
    target: ArrayLike,
    *,
    model: ModelName = "affine",
    robust: bool = False,
    labels: Sequence[str] | None = None,
    pixel_spacing: float | tuple[float, float] | None = None,
    sigma: ArrayLike | None = None,
) -> Registration:
    """Fit the transform source -> target that markers determine, with its error everywhere.

    Parameters
    ----------
    source
        (N, 2) pixels u, v, or (N, 3) [m].
    target
        (N, 3) the same markers in the robot's frame [m].
    model
        "affine" (the paper's ordinary least squares), "similarity" or "rigid".
    robust
        Leave out the markers that do not agree with the others (they are named in `outliers` and
        false in `used`); every minimal subset is tried, so the result is deterministic.
    labels
        (N,) the markers' names, each once; their indices when `None`.
    pixel_spacing
        (along u, along v) [m/px], or one number; needed for "rigid" from pixels. For "similarity"
        only its ratio counts.
    sigma
        (N,) or (N, 3) standard deviation of each target position an axis [m]. Only ratios count:
        the size of the error is estimated from the residuals.

    Raises
    ------
    MarkerError
        Positions that determine no transform: non-finite, too few, coincident, collinear (or for a
        3-D affine coplanar).
    SettingError
        An unknown model, a pixel spacing that is missing or out of range, or more markers than a
        robust search allows.
    """
    given = tuple(labels) if labels is not None else tuple(range(len(np.atleast_1d(source))))
    problem = make_problem(source, target, model, pixel_spacing, sigma, given)
    return Registration(
        model,
        given,
        np.array(source, dtype=np.float64),
        np.array(target, dtype=np.float64),
        solve(problem, agreeing(problem) if robust else None),
    )
