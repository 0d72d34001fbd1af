"""Markers to a registration, and the refusal of those that are surely wrong.

A `Diagnosis` warns of what is suspicious, once in twenty to a hundred good sets. What is refused
here is beyond doubt: from good markers it comes less than once in ten thousand sets, whatever their
layout (docs/registration.md has the measurement). An outlier is never among it: errors with heavy
tails are common, and look like one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vfplan.errors import MarkerError, SettingError
from vfplan.registration.bounds import perspective
from vfplan.registration.fit import (
    MIN_EXTENT,
    Fit,
    agreeing,
    extent_and_error,
    f_limit,
    one_to_blame,
    solve,
)
from vfplan.registration.labelling import Relabelling, better_labelling, name_labelling
from vfplan.registration.models import Array, ModelName, Orthogonal, homogeneous
from vfplan.registration.problem import Problem, make_problem
from vfplan.registration.result import Registration

if TYPE_CHECKING:
    from vfplan.registration.diagnosis import Diagnosis

# Residuals over the stated sigmas: beyond it the sigmas, or the markers, are others.
MAX_OVER_SIGMA = 10.0
# Along u and v; more is another unit, not a printer's stretch.
MAX_SCALE_FACTOR = 2.0


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
    if not (seen and seen.told) or (seen.studentised_f > f_limit(len(used), seen.dof - 3)).any():
        return used
    return np.ones(len(used), dtype=bool)


def _check_explained(fit: Fit, labels: Sequence[str | int], *, square: bool) -> None:
    """Refuse a transform that is not larger than its own error across the layout.

    Markers that coincide or lie on a line to within their error, labels all wrong, a wrong unit.
    Two labels exchanged, or one bad marker, are left to the diagnosis, which names them.
    """
    extent, error = extent_and_error(fit)
    if extent >= MIN_EXTENT * error:
        return
    better = better_labelling(solve(fit.problem), square=square)
    surely = better is not None and better.sure and better.alone
    if surely and better.pair and fit.used[list(better.pair)].any():
        return
    if not surely and one_to_blame(fit) is not None:
        return
    cause = "wrong labels or units, or markers on a line or in one place?"
    if better is not None and better.seems and better.alone:
        cause = name_labelling(better.order, labels)
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


def check_handedness(fit: Fit, seen_from: Array | None) -> None:
    """Refuse markers that fit only a mirror image.

    A 3-D source shows it by itself. A planar one fits its mirror image as well (turned over), so
    it is checked against `seen_from`, the direction from which the image is looked at, if given.

    Raises MarkerError: the markers are mirrored
    """
    if fit.problem.model.dimension == 3:
        if _is_mirrored(fit):
            raise MarkerError(
                "the markers are mirrored: they fit a mirror image far better than any rotation "
                "(look for one axis with the wrong sign, two axes or two labels exchanged)"
            )
    elif seen_from is not None:
        normal = np.cross(fit.m[:, 0], fit.m[:, 1])
        faces = -normal / np.linalg.norm(normal)
        if not faces @ seen_from > 0:
            raise MarkerError(
                f"the markers are mirrored: the image faces {faces.round(3).tolist()} in the "
                f"target frame, but is said to be seen from {seen_from.tolist()}"
            )


def _is_mirrored(fit: Fit) -> bool:
    from scipy.special import fdtri

    problem, used = fit.problem, fit.used
    if not isinstance(problem.model, Orthogonal):
        return bool(np.linalg.det(fit.m[:, :3]) < 0)
    flipped = problem.s[used] * [1.0, 1.0, -1.0]
    y, w = problem.y[used], problem.weights[used]
    error = y - homogeneous(flipped) @ problem.model.solve(flipped, y, w).T
    mirrored = max(float((w * error**2).sum()), problem.floor_m**2)
    # Flat layouts fit both ways; only a mirror image that fits far better than noise allows is one.
    return fit.variance * fit.dof > mirrored * fdtri(float(fit.dof), float(fit.dof), 0.999)


def refuse_sure_faults(registration: Registration, diagnosis: Diagnosis) -> None:
    """Refuse markers that are surely wrong and still in the fit.

    Raises MarkerError: labels exchanged or in another order, residuals far beyond the stated
        sigmas, or a scale that is not the known one
    """
    if diagnosis.relabelled:
        _refuse_relabelled(registration, diagnosis.relabelled)
    _refuse_beyond_sigma(registration)
    if one_to_blame(registration.fit) is None:
        _refuse_scale(diagnosis)


def _refuse_relabelled(registration: Registration, other: Relabelling) -> None:
    fit = registration.fit
    moved = [i for i, j in enumerate(other.order) if i != j]
    if not other.sure or not fit.used[moved].any():
        return
    everyone = solve(fit.problem)
    rms = float(np.sqrt((everyone.vectors**2).sum(axis=1).mean()))
    what = "the labels are wrong, and more than one other labelling fits"
    if other.alone:
        what = name_labelling(other.order, registration.labels)
    raise MarkerError(
        f"{what}: as labelled the markers miss their places by {rms * 1e3:.3g} mm rms, so by "
        f"{other.rms_m * 1e3:.3g} mm; correct the labels, or leave them out with --robust"
    )


def _refuse_beyond_sigma(registration: Registration) -> None:
    unit = registration.fit.problem.sigma_unit_m
    if unit is not None and registration.sigma_m > MAX_OVER_SIGMA * unit:
        raise MarkerError(
            f"the residuals are {registration.sigma_m / unit:.3g} times what the stated sigmas "
            f"allow; at most {MAX_OVER_SIGMA:g} times is allowed (wrong labels, or a marker to "
            "leave out with --robust?)"
        )


def _refuse_scale(diagnosis: Diagnosis) -> None:
    if not diagnosis.spacing_departure or not diagnosis.spacing_departure_sigma:
        return
    for departure, sigma in zip(
        diagnosis.spacing_departure, diagnosis.spacing_departure_sigma, strict=True
    ):
        factor = 1 + departure
        sure = abs(departure) > 4 * sigma
        if sure and not 1 / MAX_SCALE_FACTOR <= factor <= MAX_SCALE_FACTOR:
            raise MarkerError(
                f"the markers give {factor:.4g} times the known scale; at most "
                f"{MAX_SCALE_FACTOR:g} times, either way, is allowed (millimetres for metres, or a "
                "wrong pixel spacing?)"
            )
