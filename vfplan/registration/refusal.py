"""Faults of the markers that are sure: no fixture is made from them.

A `Diagnosis` warns of what is suspicious, once in twenty to a hundred good sets. What is refused
here is beyond doubt: from good markers it comes less than once in ten thousand sets, whatever their
layout (docs/registration.md has the measurement). An outlier is never among it: errors with heavy
tails are common, and look like one.
"""

from __future__ import annotations

import numpy as np

from vfplan.errors import MarkerError
from vfplan.registration import layout, residuals
from vfplan.registration.diagnosis import Diagnosis
from vfplan.registration.labelling import Relabelling, name_labelling
from vfplan.registration.result import Registration

# Given to `swapped_labels`. Its F of (ν, ν) is for independent sums of squares; these share their
# noise, and a good set passes less often: at worst 1e-5 of four markers' sets, fewer of more.
SURE_EXCHANGE = 2.5e-5
# Residuals over the stated sigmas: beyond it the sigmas, or the markers, are others.
MAX_OVER_SIGMA = 10.0
# Along u and v; more is another unit, not a printer's stretch.
MAX_SCALE_FACTOR = 2.0


def refuse_sure_faults(registration: Registration, diagnosis: Diagnosis) -> None:
    """Refuse markers that are surely wrong and still in the fit.

    Raises MarkerError: labels exchanged or in another order, residuals far beyond the stated
        sigmas, or a scale that is not the known one
    """
    if diagnosis.swapped:
        _refuse_exchanged(registration)
    if diagnosis.relabelled:
        _refuse_relabelled(registration, diagnosis.relabelled)
    _refuse_beyond_sigma(registration)
    if layout.one_to_blame(registration.fit) is None:
        _refuse_scale(diagnosis)


def _refuse_exchanged(registration: Registration) -> None:
    fit = registration.fit
    everyone = residuals.solve(fit.problem)
    pair = layout.swapped_labels(everyone, SURE_EXCHANGE)
    if pair is None:
        extent, error = layout.extent_and_error(fit)
        pair = layout.swapped_labels(fit) if extent < layout.MIN_EXTENT * error else None
    if pair is None or not fit.used[list(pair)].any():
        return
    a, b = (registration.labels[i] for i in pair)
    rms = float(np.sqrt((everyone.vectors**2).sum(axis=1).mean()))
    raise MarkerError(
        f"the labels of {a} and {b} are exchanged: as labelled the markers miss their places by "
        f"{rms * 1e3:.3g} mm rms, with these two swapped they fit; correct the labels, or have "
        "both left out with --robust"
    )


def _refuse_relabelled(registration: Registration, other: Relabelling) -> None:
    fit = registration.fit
    moved = [i for i, j in enumerate(other.order) if i != j]
    if not other.sure or not fit.used[moved].any():
        return
    everyone = residuals.solve(fit.problem)
    rms = float(np.sqrt((everyone.vectors**2).sum(axis=1).mean()))
    what = "the labels are wrong, and more than one other labelling fits"
    if other.alone:
        what = name_labelling(other.order, registration.labels)
    raise MarkerError(
        f"{what}: as labelled the markers miss their places by {rms * 1e3:.3g} mm rms, so by "
        f"{other.rms_m * 1e3:.3g} mm; correct the labels"
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
