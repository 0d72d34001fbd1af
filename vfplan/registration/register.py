"""Markers to a registration, and the registration as data for `--json`: units in the names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vfplan.errors import MarkerError, SettingError
from vfplan.registration.bounds import TargetError, perspective, target_error
from vfplan.registration.diagnosis import Diagnosis, diagnose
from vfplan.registration.fit import (
    MIN_EXTENT,
    Fit,
    agreeing,
    extent_and_error,
    f_limit,
    one_to_blame,
    solve,
)
from vfplan.registration.labelling import better_labelling, name_labelling
from vfplan.registration.models import Array, ModelName, Orthogonal, homogeneous
from vfplan.registration.problem import Problem, make_problem
from vfplan.registration.result import Registration


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


def describe(
    registration: Registration,
    points: ArrayLike | None = None,
    *,
    diagnosis: Diagnosis | None = None,
    error: TargetError | None = None,
) -> dict[str, Any]:
    """The registration, its markers, and its predicted error along source `points` (M, 2|3).

    What has no meaning for this source or model is absent; what cannot be known is `None`.
    """
    diagnosis = diagnosis or diagnose(registration)
    report: dict[str, Any] = {
        "model": registration.model,
        "markers": len(registration.labels),
        "T_robot_image": registration.T_target_source,
        "fre_rms_m": registration.fre_rms_m,
        "fle_rms_m": registration.fle_rms_m,
        "loo_rms_m": registration.loo_rms_m,
        "degrees_of_freedom": registration.dof,
        "condition": registration.condition,
        "residuals": describe_markers(registration),
        "outliers": list(registration.outliers),
        "suspects": [{"label": k, "reason": why} for k, why in diagnosis.suspects.items()],
        "labellings": diagnosis.labellings,
        **_geometry(registration, diagnosis),
    }
    if registration.robust:
        report["robust"] = {"used": int(registration.used.sum())}
    if diagnosis.swapped:
        report["swapped_labels"] = list(diagnosis.swapped)
    seen = registration.perspective
    if seen is not None:
        report["perspective"] = {"p_value": seen.p_value, "said": seen.said}
    if diagnosis.relabelled:
        other, labels = diagnosis.relabelled, registration.labels
        report["better_labelling" if other.seems else "rival_labelling"] = {
            "labels": [labels[j] for j in other.order],
            "fre_rms_m": other.rms_m,
            "gain": other.gain,
        }
    if registration.fit.problem.sigma_unit_m is not None:
        ratio = registration.sigma_m / registration.fit.problem.sigma_unit_m
        report["residuals_over_stated_sigma"] = ratio
    if points is not None:
        error = error or target_error(registration, points)
        report |= {"tre_rms_m": float(np.sqrt((error.rms_m**2).mean()))}
        report["tre"] = _target(registration, points, error)
    return report


def describe_markers(registration: Registration) -> list[dict[str, Any]]:
    """One entry a marker: residual, leverage, leave-one-out error, studentised F."""
    residuals = registration.residuals_m
    return [
        {
            "label": label,
            "residual_m": float(residuals[i]),
            "vector_m": registration.residual_vectors_m[i],
            "leverage": float(registration.leverage[i]),
            "loo_m": float(registration.loo_m[i]),
            "f": float(registration.studentised_f[i]),
            "used": bool(registration.used[i]),
        }
        for i, label in enumerate(registration.labels)
    ]


def _geometry(registration: Registration, diagnosis: Diagnosis) -> dict[str, Any]:
    found = registration.geometry
    planar = registration.source.shape[1] == 2
    unit = "_m_per_px" if planar else ""
    report: dict[str, Any] = {
        f"scale{unit}": found.scale,
        f"axis_scales{unit}": found.axis_scales,
        f"singular_values{unit}": found.singular_values,
        "anisotropy": found.anisotropy,
        "shear": found.shear,
    }
    if found.normal is not None:
        report["plane_normal"] = found.normal
        report["image_faces"] = -found.normal
    if diagnosis.spacing_departure is not None:
        report["spacing_departure"] = list(diagnosis.spacing_departure)
        report["spacing_departure_sigma"] = list(diagnosis.spacing_departure_sigma or ())
    return report


def _target(registration: Registration, points: ArrayLike, error: TargetError) -> dict[str, Any]:
    worst = error.worst
    place = np.atleast_2d(np.asarray(points, dtype=float))[worst]
    return {
        "rms_m": float(np.sqrt((error.rms_m**2).mean())),
        "max_rms_m": float(error.rms_m.max()),
        "bound95_max_m": float(error.bound95_m[worst]),
        "curve95_max_m": float(error.curve95_m.max()),
        "worst_point": worst,
        "worst_source": place[: registration.source.shape[1]],
        "worst_target_m": registration.apply(place[None])[0],
        "points_outside_markers": int(error.outside_hull.sum()),
        "points_extrapolated": int(error.extrapolated.sum()),
    }
