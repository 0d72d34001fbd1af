"""Outliers among the markers: judged by an F test, and left out by a robust fit.

A marker is an outlier if it lies further from where the others put it than chance explains. A plain
fit keeps it and names it. A robust fit rests on the markers alone that agree with each other.

They are found without a random number. Least trimmed squares (P. J. Rousseeuw, "Least median of
squares regression", J. Am. Stat. Assoc. 79, 1984) over the transforms through all minimal subsets
finds the half of the markers that agrees best. A forward search (A. C. Atkinson and M. Riani,
"Robust diagnostic regression analysis", 2000) then takes in one marker after another, for as long
as the next one fits.
"""

from __future__ import annotations

from itertools import combinations, islice
from math import comb
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError
from vfplan.findings import Finding, doubt, note
from vfplan.geometry import ROWS_AT_ONCE
from vfplan.registration.fit import Fit, f_limit, fit_model, studentised_f
from vfplan.registration.models import Array, rms_length
from vfplan.registration.problem import MAX_CONDITION, Problem

if TYPE_CHECKING:
    from vfplan.registration.registration import Registration

# All minimal subsets are tried, and this many take some seconds.
MAX_SUBSETS = 500_000

# The forward search stops before a good marker once in twenty sets. That leaves out a good marker
# now and then, and seldom takes in a wrong one.
STOP_PROBABILITY = 0.05


def outlier_limits(fit: Fit) -> Array:
    """(N,) the F that one of the markers exceeds in one good set of a hundred, at each."""
    marker_count = int(fit.used.sum())
    limits = np.full(len(fit.used), np.inf)
    for i, is_used in enumerate(fit.used):
        dof = fit.dof - 3 * int(is_used)
        if dof > 0:
            limits[i] = f_limit(marker_count, dof)
    return limits


def is_outlier(fit: Fit) -> NDArray[np.bool_]:
    """(N,) the markers whose F is above its limit, and those that a robust fit left out."""
    return (np.nan_to_num(studentised_f(fit)) > outlier_limits(fit)) | ~fit.used


def single_outlier(registration: Registration) -> tuple[int, float] | None:
    """The marker of largest F, and the RMS residual of the others without it [m].

    `None` where no marker is an outlier, or the others do not agree either.
    """
    f = np.where(registration.used, np.nan_to_num(registration.studentised_f), 0.0)
    worst = int(f.argmax())
    others = registration.used & (np.arange(len(f)) != worst)
    problem = registration.fit.problem
    has_residual = 3 * others.sum() > problem.model.parameters
    if not f[worst] > outlier_limits(registration.fit)[worst] or not has_residual:
        return None
    without = fit_model(problem, others)
    others_m = rms_length(without.vectors[others])
    if others_m > registration.fre_rms_m / 2:
        return None
    return worst, others_m


def outlier_findings(registration: Registration) -> list[Finding]:
    """Markers further from the others' prediction than chance explains, and those left out."""
    findings = []
    for i, label in enumerate(registration.labels):
        if label not in registration.outliers:
            continue
        place = registration.place_px(i)
        distance_m = float(registration.residuals_m[i])
        if not registration.used[i]:
            text = (
                f"Marker {label} was left out: it lies {1e3 * distance_m:.2f} mm from where the "
                "others put it. Touch it again to have it count."
            )
            findings.append(note("marker-left-out", "register", text, place_px=place))
            continue
        if np.isfinite(registration.loo_m[i]):
            distance_m = float(registration.loo_m[i])
        text = (
            f"Marker {label} lies {1e3 * distance_m:.2f} mm from where the others put it. Touch it "
            "again, or leave it out with --robust."
        )
        findings.append(doubt("marker-suspect", "register", text, place_px=place))
    return findings


def consistent_markers(problem: Problem) -> NDArray[np.bool_]:
    """(N,) the markers that a robust fit rests on.

    Raises SettingError: more minimal subsets than can be searched
    """
    n, minimal = len(problem.s), problem.model.minimal
    subset_count = comb(n, minimal)
    if subset_count > MAX_SUBSETS:
        raise SettingError(
            f"a robust fit searches all {subset_count} subsets of {minimal} of {n} markers, and "
            f"at most {MAX_SUBSETS} are allowed. Give fewer markers, or leave --robust out",
            code="robust-too-many",
            numbers={"subsets": subset_count},
        )
    # As few markers as still leave a residual, and at least half of them.
    half = max((n + minimal + 1) // 2, problem.model.parameters // 3 + 1)
    half = min(n, half)

    # The minimal subset whose transform leaves the least sum over the half that fits it best.
    subsets = combinations(range(n), minimal)
    smallest_sum, best_subset = np.inf, []
    while block := list(islice(subsets, ROWS_AT_ONCE)):
        index = np.array(block)
        index = index[is_spread_out(problem, index)]
        if not len(index):
            continue
        squares = _squares(problem, _through(problem, index))
        sums = np.partition(squares, half - 1, axis=1)[:, :half].sum(axis=1)
        candidate = int(sums.argmin())
        if sums[candidate] < smallest_sum:
            smallest_sum, best_subset = float(sums[candidate]), index[candidate].tolist()
    squares = _squares(problem, _through(problem, np.array([best_subset])))[0]
    used = np.zeros(n, dtype=bool)
    used[best_subset] = True
    used[np.argsort(squares, kind="stable")[:half]] = True

    # Take in the marker that fits best, until the best of the others does not fit.
    while not used.all():
        fit = fit_model(problem, used)
        f = np.where(used, np.inf, studentised_f(fit))
        next_marker = int(np.argmin(f))
        if f[next_marker] > f_limit(n, fit.dof, STOP_PROBABILITY):
            break
        used[next_marker] = True
    return used


def is_spread_out(problem: Problem, index: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(P,) whether a subset determines the transform: not on a line, for a 3-D affine not flat."""
    s = problem.s[index]
    centred = s - s.mean(axis=1, keepdims=True)
    squares = np.linalg.eigvalsh(np.swapaxes(centred, 1, 2) @ centred)[:, ::-1]
    rank = problem.model.dimension if problem.model.name == "affine" else 2
    return squares[:, rank - 1] > 1 / MAX_CONDITION**2


def _through(problem: Problem, index: NDArray[np.intp]) -> Array:
    """(P, 3, k+1) the transforms of subsets (P, m) of the markers, all weights equal."""
    s, y = problem.s[index], problem.y[index]
    return problem.model.solve(s, y, np.ones_like(y))


def _squares(problem: Problem, m: Array) -> Array:
    """(P, N) weighted squared residual of every marker under each M (P, 3, k+1)."""
    error = problem.y - problem.x @ np.swapaxes(m, -1, -2)
    return (problem.weights * error**2).sum(axis=-1)
