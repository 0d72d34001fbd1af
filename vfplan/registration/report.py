"""The error along a curve, and a registration as data for `--json`: units in the names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vfplan.errors import CheckFailed
from vfplan.registration.diagnosis import Diagnosis, diagnose
from vfplan.registration.models import Array
from vfplan.registration.result import Registration


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


def outside_hull(markers: Array, points: Array) -> np.ndarray:
    """(M,) bool: points (M, k) outside the convex hull of markers (N, k); flat hulls in 3-D too."""
    from scipy.spatial import ConvexHull

    centre = markers.mean(axis=0)
    _, extent, axes = np.linalg.svd(markers - centre, full_matrices=False)
    basis = axes[extent > extent[0] * 1e-9]
    flat, inside = (markers - centre) @ basis.T, (points - centre) @ basis.T
    planes = ConvexHull(flat).equations
    tolerance = 1e-9 * extent[0]
    beyond = (inside @ planes[:, :-1].T + planes[:, -1] > tolerance).any(axis=1)
    off = np.linalg.norm((points - centre) - inside @ basis, axis=1) > 1e-6 * extent[0]
    return beyond | off


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
