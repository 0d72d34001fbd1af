"""A registration as data for `--json`: every number with its unit in its name."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vfplan.registration.diagnosis import Diagnosis, TargetError, diagnose, target_error
from vfplan.registration.result import Registration


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
        report["perspective"] = {"p_value": seen.p_value, "said": seen.sure}
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
    columns = zip(
        registration.labels,
        registration.residuals_m,
        registration.residual_vectors_m,
        registration.leverage,
        registration.loo_m,
        registration.studentised_f,
        registration.used,
        strict=True,
    )
    return [
        {
            "label": label,
            "residual_m": float(residual),
            "vector_m": vector,
            "leverage": float(leverage),
            "loo_m": float(loo),
            "f": float(f),
            "used": bool(used),
        }
        for label, residual, vector, leverage, loo, f, used in columns
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
