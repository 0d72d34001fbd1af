"""Faults of the markers that are sure: no fixture is made from them.

A `Diagnosis` warns of what is suspicious, once in twenty to a hundred good sets. What is refused
here is beyond doubt: from good markers it comes less than once in ten thousand sets, whatever their
layout (docs/registration.md has the measurement).
"""

from __future__ import annotations

from math import comb

import numpy as np

from vfplan.errors import MarkerError
from vfplan.registration import layout, residuals
from vfplan.registration.diagnosis import QUICK_SUBSETS, Diagnosis
from vfplan.registration.models import Array
from vfplan.registration.residuals import Fit
from vfplan.registration.result import Registration
from vfplan.registration.robust import agreeing

# Given to `swapped_labels`. Its F of (ν, ν) is for independent sums of squares; these share their
# noise, and a good set passes less often: at worst 1e-4 of four markers' sets, fewer of more.
SURE_EXCHANGE = 5e-4
# Given to `f_limit`, which is exact for noise as large at every marker and along every axis; with
# one axis three times as noisy, or markers that differ fourfold, this is still less than 1e-4.
GROSS = 1e-8
# Along u and v; more is another unit, not a printer's stretch.
MAX_SCALE_FACTOR = 2.0


def refuse_sure_faults(registration: Registration, diagnosis: Diagnosis) -> None:
    """Refuse markers that are surely wrong and still in the fit.

    Raises
    ------
    MarkerError
        Exchanged labels, a marker grossly out of place, or a scale that is not the known one.
    """
    if diagnosis.swapped:
        _refuse_exchanged(registration)
    if diagnosis.suspects and not registration.robust:
        _refuse_gross(registration)
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


def _refuse_gross(registration: Registration) -> None:
    bad = gross_outliers(registration.fit)
    if not bad.any():
        return
    good = residuals.solve(registration.fit.problem, ~bad)
    distance = np.linalg.norm(good.vectors, axis=1) * 1e3
    named = ", ".join(str(registration.labels[i]) for i in np.flatnonzero(bad))
    away = ", ".join(f"{d:.3g}" for d in distance[bad])
    verb, them = ("lies", "it") if bad.sum() == 1 else ("lie", "them")
    raise MarkerError(
        f"{named} {verb} {away} mm from where the other markers put {them}, which agree to "
        f"{np.sqrt(good.variance) * 1e3:.2g} mm an axis; measure again, correct the file, or have "
        f"{them} left out with --robust"
    )


def gross_outliers(fit: Fit) -> np.ndarray:
    """(N,) bool: markers in the fit that noise does not explain, even unequal noise.

    By the search of a robust fit where that is quick, which also sees several that hide each
    other; else, or where it sees none, one by one by their studentised F.
    """
    problem, n = fit.problem, int(fit.used.sum())
    if comb(len(problem.s), problem.model.minimal) <= QUICK_SUBSETS:
        bad = ~agreeing(problem, alpha=GROSS)
        if bad.any():
            return bad
    if fit.dof <= 3:
        return np.zeros(len(problem.s), dtype=bool)
    f: Array = np.nan_to_num(residuals.studentised_f(fit))
    return fit.used & (f > residuals.f_limit(n, fit.dof - 3, GROSS))


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
