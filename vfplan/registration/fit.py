"""From markers to a registration: the one call."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from vfplan.errors import MarkerError, SettingError
from vfplan.registration.geometry import check_handedness
from vfplan.registration.labelling import better_labelling, name_labelling
from vfplan.registration.layout import (
    MIN_EXTENT,
    extent_and_error,
    one_to_blame,
    swapped_labels,
)
from vfplan.registration.models import ModelName
from vfplan.registration.perspective import perspective
from vfplan.registration.problem import Problem, make_problem
from vfplan.registration.residuals import Fit, f_limit, solve
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
    seen_from: ArrayLike | None = None,
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
    seen_from
        (3,) direction in the target frame from which a planar image is looked at, u to the right
        and v down; a mirrored set of markers is then refused. Without it a mirrored planar set
        cannot be told from one that is turned over; a mirrored 3-D set is always refused.

    Raises
    ------
    MarkerError
        Positions that determine no transform: non-finite, too few, coincident, collinear (or for a
        3-D affine coplanar), mirrored, or not explained by any transform.
    SettingError
        An unknown model, a direction without length, a pixel spacing that is missing or out of
        range, or more markers than a robust search allows.
    """
    facing = _direction(seen_from, "seen_from")
    problem = make_problem(source, target, model, pixel_spacing, sigma, labels)
    fit = solve(problem, _agreeing(problem) if robust else None)
    check_handedness(fit, facing)
    names = tuple(range(len(problem.s)) if labels is None else labels)
    _check_explained(fit, names, square=pixel_spacing is not None)
    spacing = None if pixel_spacing is None else problem.normaliser.spacing
    return Registration(
        model,
        names,
        np.array(source, dtype=np.float64),
        np.array(target, dtype=np.float64),
        fit,
        robust,
        spacing,
    )


def _agreeing(problem: Problem) -> np.ndarray:
    """The markers that agree; all of them where perspective explains those that do not."""
    used = agreeing(problem)
    if used.all():
        return used
    seen = perspective(solve(problem))
    if seen is None or (seen.studentised_f > f_limit(len(used), seen.dof - 3)).any():
        return used
    return np.ones(len(used), dtype=bool)


def _check_explained(fit: Fit, labels: Sequence[str | int], *, square: bool) -> None:
    """Refuse a transform that is not larger than its own error across the layout.

    Markers that coincide or lie on a line to within their error, labels all wrong, a wrong unit.
    Two labels exchanged, or one bad marker, are left to the diagnosis, which names them.
    """
    extent, error = extent_and_error(fit)
    if extent >= MIN_EXTENT * error or swapped_labels(fit) is not None:
        return
    better = better_labelling(solve(fit.problem), square=square)
    cause = "wrong labels or units, or markers on a line or in one place?"
    if better is not None and better.sure and better.alone:
        cause = name_labelling(better.order, labels)
    elif one_to_blame(fit) is not None:
        return
    raise MarkerError(
        f"the transform does not explain the markers: they spread {extent * 1e3:.3g} mm across "
        f"the layout and miss their places by {error * 1e3:.3g} mm an axis; at most a third is "
        f"allowed ({cause})"
    )


def _direction(value: ArrayLike | None, name: str) -> np.ndarray | None:
    if value is None:
        return None
    array = np.array(value, dtype=np.float64)
    if array.shape != (3,) or not np.isfinite(array).all() or not array.any():
        raise SettingError(f"{name} is {value!r}; three finite numbers, not all 0, are wanted")
    return array
