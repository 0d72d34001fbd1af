"""What may be wrong with a registration, named: suspects, symmetry, reach, scale."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from vfplan.errors import CheckFailed
from vfplan.registration import layout, residuals
from vfplan.registration import warnings as warn
from vfplan.registration.labelling import Relabelling, better_labelling
from vfplan.registration.models import Array, Orthogonal
from vfplan.registration.result import Registration
from vfplan.registration.robust import agreeing

# Above this share in its own prediction a marker's error moves the fit and leaves no residual.
UNCHECKED_LEVERAGE = 0.9
QUICK_SUBSETS = 20_000

Label = str | int


@dataclass(frozen=True)
class Diagnosis:
    """What the markers say against themselves."""

    suspects: dict[Label, str]  # label -> why it is suspected
    swapped: tuple[Label, Label] | None  # two labels that seem exchanged; `None` when none do
    # Another labelling that fits far better, or as well; `None` when none does
    relabelled: Relabelling | None
    # Labellings that fit the layout equally well, 1 when it has no symmetry; `None`: not checked
    labellings: int | None
    unchecked: tuple[Label, ...]  # labels of markers no other marker checks (leverage above 0.9)
    # Scale found over the known one, minus 1; along u and v for the affine model
    spacing_departure: tuple[float, ...] | None
    spacing_departure_sigma: tuple[float, ...] | None  # standard errors of the departures
    warnings: tuple[str, ...]  # one sentence for each of these that a user should read


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


def diagnose(registration: Registration) -> Diagnosis:
    """Everything the markers say against themselves; nothing is repaired or dropped."""
    fit, labels = registration.fit, registration.labels
    everyone = fit if fit.used.all() else residuals.solve(fit.problem)
    pair = layout.swapped_labels(everyone)
    swapped = None if pair is None else (labels[pair[0]], labels[pair[1]])
    relabelled = better_labelling(everyone, square=registration.pixel_spacing is not None)
    labellings = layout.symmetries(fit)
    unchecked = tuple(
        label
        for label, h, used in zip(labels, fit.leverage, fit.used, strict=True)
        if used and h > UNCHECKED_LEVERAGE
    )
    departure, sigma = _departure(registration)
    suspects = _suspects(registration, swapped)
    warnings = (
        *warn.label_warnings(registration, swapped, relabelled, labellings),
        *(() if swapped else warn.suspect_warnings(registration, suspects)),
        *warn.perspective_warning(registration),
        *warn.layout_warnings(registration, labellings, unchecked),
        *warn.scale_warnings(registration, departure, sigma),
    )
    return Diagnosis(
        suspects, swapped, relabelled, labellings, unchecked, departure, sigma, warnings
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
        layout.outside_hull(problem.s[registration.used], s),
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


def _suspects(registration: Registration, swapped: tuple[Label, Label] | None) -> dict[Label, str]:
    suspects: dict[Label, str] = {}
    if swapped:
        suspects |= {a: f"its label and {b}'s seem exchanged" for a, b in (swapped, swapped[::-1])}
    n, labels = int(registration.used.sum()), registration.labels
    for i, label in enumerate(labels):
        if label not in registration.outliers or label in suspects:
            continue
        limit = residuals.f_limit(n, int(registration.studentised_dof[i]))
        size = registration.residuals_m[i] * 1e3
        verb = "stays in the fit" if registration.used[i] else "left out of the fit"
        f = registration.studentised_f[i]
        suspects[label] = f"residual {size:.3g} mm, F {f:.3g} over {limit:.3g}; {verb}"
    alone = layout.one_to_blame(registration.fit)
    if alone is not None:
        why = "no transform explains it with the others, which agree without it"
        suspects.setdefault(labels[alone], why)
    for label in _masked(registration):
        suspects.setdefault(label, "disagrees with the markers that agree best")
    return suspects


def _masked(registration: Registration) -> list[Label]:
    """Markers that a robust search would leave out: several bad ones hide each other's F."""
    problem = registration.fit.problem
    if (
        registration.perspective
        or registration.robust
        or comb(len(problem.s), problem.model.minimal) > QUICK_SUBSETS
    ):
        return []
    used = agreeing(problem, alpha=0.01)
    return [label for label, good in zip(registration.labels, used, strict=True) if not good]


def _departure(
    registration: Registration,
) -> tuple[tuple[float, ...] | None, tuple[float, ...] | None]:
    """Scale over the known scale, minus 1, and its standard error."""
    known = registration.pixel_spacing
    planar = registration.source.shape[1] == 2
    if planar and known is None:
        return None, None
    if registration.model == "affine":
        return _affine_departure(registration, known if planar else np.ones(3))
    return _free_scale_departure(registration, known if planar else np.ones(3))


def _affine_departure(
    registration: Registration, known: Array
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    k = len(known)
    columns = registration.T_target_source[:3, :k]
    lengths = np.linalg.norm(columns, axis=0)
    c = registration.covariance.reshape(3, k + 1, 3, k + 1)
    unit = columns / lengths
    variance = [unit[:, j] @ c[:, j, :, j] @ unit[:, j] for j in range(k)]
    sigma = np.sqrt(np.maximum(variance, 0.0)) / known
    return tuple((lengths / known - 1).tolist()), tuple(sigma.tolist())


def _free_scale_departure(
    registration: Registration, known: Array
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    fit, used = registration.fit, registration.used
    problem = fit.problem
    free = Orthogonal(problem.model.dimension, None, "similarity")
    m = free.solve(problem.s[used], problem.y[used], problem.weights[used])
    scale = float(np.linalg.norm(m[:, 0])) / problem.normaliser.radius
    spread = float((problem.weights[used].mean(axis=1) @ (problem.s[used] ** 2)).sum())
    sigma = registration.sigma_m / (scale * problem.normaliser.radius * np.sqrt(spread))
    # A similarity normalises by the spacing's ratio alone; the known spacing is the unit there too.
    return (scale - 1,), (float(sigma),)
