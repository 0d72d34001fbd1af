"""What a diagnosis warns of, in words."""

from __future__ import annotations

import numpy as np

from vfplan.registration import residuals
from vfplan.registration.labelling import Relabelling, name_labelling
from vfplan.registration.result import Registration

LONG_LAYOUT = 10.0

Label = str | int


def label_warnings(
    registration: Registration,
    swapped: tuple[Label, Label] | None,
    other: Relabelling | None,
    labellings: int | None,
) -> tuple[str, ...]:
    """Labels exchanged, in another order, or that these markers cannot show."""
    if swapped:
        return (f"the labels of {swapped[0]} and {swapped[1]} seem exchanged: check both",)
    if other is None or (not other.seems and (labellings or 1) > 1):
        return ()  # of a symmetric layout that is said anyway
    name = name_labelling(other.order, registration.labels)
    if other.seems:
        return (
            f"it seems that {name}: so the markers would miss their places by "
            f"{other.rms_m * 1e3:.3g} mm rms only; check the labels",
        )
    return (
        f"these {len(registration.labels)} markers cannot show how they are labelled: they miss "
        f"their places by {registration.fre_rms_m * 1e3:.3g} mm rms, and if {name}, by "
        f"{other.rms_m * 1e3:.3g} mm; check the labels, or add a marker",
    )


def suspect_warnings(registration: Registration, suspects: dict[Label, str]) -> tuple[str, ...]:
    """Each suspect marker; a single one with how far it is off, and how the others fit then."""
    names = list(suspects)
    if len(names) == 1 and not registration.perspective:
        used, one = registration.used, registration.labels.index(names[0])
        rest = used & (np.arange(len(used)) != one)
        if used[one] and 3 * rest.sum() > registration.fit.problem.model.parameters:
            left = residuals.solve(registration.fit.problem, rest).vectors[rest]
            return (
                f"suspect marker {names[0]}: it is {registration.loo_m[one] * 1e3:.3g} mm from "
                "where the others put it, and without it they fit to "
                f"{np.sqrt((left**2).sum(axis=1).mean()) * 1e3:.3g} mm rms; it stays in the fit: "
                "check it, and correct it or leave it out with --robust",
            )
    return tuple(f"suspect marker {label}: {why}" for label, why in suspects.items())


def perspective_warning(registration: Registration) -> tuple[str, ...]:
    """A camera that does not look straight on."""
    seen = registration.perspective
    if seen is None or not seen.sure:
        return ()
    left = np.sqrt(3 * seen.variance)
    return (
        "the markers show perspective, as a camera that does not look straight on gives: a "
        f"homography leaves {left * 1e3:.3g} mm a marker, the {registration.model} model "
        f"{np.sqrt(3) * registration.sigma_m * 1e3:.3g} mm; the bounds are widened by what the "
        "model misses; rectify the picture",
    )


def layout_warnings(
    registration: Registration, labellings: int | None, unchecked: tuple[Label, ...]
) -> tuple[str, ...]:
    """A layout that hides errors: symmetric, long, or with markers that nothing checks."""
    found = []
    if labellings is not None and labellings > 1:
        found.append(
            f"the markers' layout is symmetric: {labellings} labellings fit it equally well, so "
            "markers labelled in the wrong order leave no residual; move one marker"
        )
    if registration.condition > LONG_LAYOUT:
        found.append(
            f"the markers' layout is {registration.condition:.0f} times as long as wide: the error "
            "grows fast across it"
        )
    if unchecked:
        names = ", ".join(map(str, unchecked))
        found.append(
            f"no other marker checks {names}: an error there moves the fit and leaves no residual"
        )
    for a, b in _coincident(registration):
        found.append(f"markers {a} and {b} stand at the same place in the source")
    return tuple(found)


def _coincident(registration: Registration) -> list[tuple[Label, Label]]:
    s, labels = registration.fit.problem.s, registration.labels
    apart = np.linalg.norm(s[:, None] - s[None], axis=2)
    i, j = np.nonzero(np.triu(apart < 1e-6, 1))
    return [(labels[a], labels[b]) for a, b in zip(i, j, strict=True)]


def scale_warnings(
    registration: Registration,
    departure: tuple[float, ...] | None,
    sigma: tuple[float, ...] | None,
) -> tuple[str, ...]:
    """Residuals or a scale beyond what is known."""
    from scipy.special import chdtrc

    found = []
    if departure and sigma:
        worst = max(zip(departure, sigma, strict=True), key=lambda d: abs(d[0]))
        if abs(worst[0]) > 0.005 and abs(worst[0]) > 4 * worst[1]:
            found.append(
                f"the scale the markers give departs by {worst[0]:+.2%} from the known one "
                f"(standard error {worst[1]:.2%})"
            )
    unit = registration.fit.problem.sigma_unit_m
    if unit is not None:
        ratio = registration.sigma_m / unit
        if chdtrc(registration.dof, registration.dof * ratio**2) < 0.01:
            found.append(f"the residuals are {ratio:.1f} times what the stated sigmas allow")
    return tuple(found)
