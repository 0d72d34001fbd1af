"""The reasons to refuse a registration, and what a person should look at before it is used.

`refuse_wrong_markers` is the gate: labels that are mistaken, residuals that no marker has, a scale
that is another unit. `registration_findings` lists the rest. Nothing is repaired.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from vfplan.errors import CheckFailed
from vfplan.findings import Finding, doubt, note
from vfplan.markers.correspondences import MAX_RADIUS_M
from vfplan.registration.error import TargetError
from vfplan.registration.fit import GOOD_SET_PROBABILITY, fit_similarity
from vfplan.registration.mistaken_labels import SURE_PROBABILITY, label_mistakes
from vfplan.registration.models import Array, rms_length
from vfplan.registration.outliers import outlier_findings, single_outlier
from vfplan.registration.perspective import perspective_test
from vfplan.registration.registration import Registration, describe_side
from vfplan.registration.scale import (
    refuse_wrong_scale,
    scale_departures,
    scale_findings,
    stretch_findings,
)

# Length over width of a layout across which the error grows fast.
LONG_LAYOUT = 10.0

# A marker with so large a share in its own prediction can be wrong and leave hardly a residual.
UNCHECKED_LEVERAGE = 0.9

# With so large a share a marker's error of 20 mm leaves less than 1 mm among ten markers.
DECISIVE_LEVERAGE = 0.98

# RMS residual of a similarity [m] that markers touched with care do not exceed; as --max-residual.
UNSTRETCHED_RESIDUAL_M = 1e-3

# Share of the curve that may lie beyond the markers before a person has to look.
EXTRAPOLATED_SHARE = 0.05


def refuse_wrong_markers(
    registration: Registration, max_residual_m: float | None, *, markers_as_given: bool = False
) -> None:
    """Refuse a registration whose markers are surely wrong.

    Parameters
    ----------
    max_residual_m
        Largest RMS residual of the markers used [m]; `None`: any.
    markers_as_given
        Take the labels as they are, even where another order fits clearly better.

    Raises
    ------
    CheckFailed
        Mistaken labels, or larger residuals.
    MarkerError
        A scale that is more than twice the known one, or less than half of it.
    """
    labels = registration.labels
    as_given = _mm(registration.fre_rms_m)

    # Another order of the labels fits clearly better. A robust fit that has left the mistaken
    # markers out does not rest on them.
    mistakes = label_mistakes(registration)
    if mistakes and mistakes[0].p_value < SURE_PROBABILITY and not markers_as_given:
        mistake = mistakes[0]
        if registration.used[mistake.moved].any():
            advice = "Correct the labels"
            # As they are given, the markers would only be refused for their residuals.
            if max_residual_m is None or registration.fre_rms_m <= max_residual_m:
                advice += ", or give --markers-as-given"
            raise CheckFailed(
                f"{mistake.sentence(labels)} (as given: {as_given}). {advice}",
                code="labels-mistaken",
                numbers={
                    "fre_rms_m": registration.fre_rms_m,
                    "fre_rms_m_corrected": mistake.fre_rms_m,
                    "p_value": mistake.p_value,
                    "action": mistake.action,
                    "labels": [labels[j] for j in mistake.order],
                },
            )

    # Larger residuals than careful touching leaves. The likeliest cause says what to do.
    if max_residual_m is not None and not registration.fre_rms_m <= max_residual_m:
        perspective = perspective_test(registration)
        outlier = single_outlier(registration)
        if mistakes and mistakes[0].p_value < GOOD_SET_PROBABILITY:
            advice = f"{mistakes[0].sentence(labels)}. Correct the labels"
        elif perspective is not None and perspective.is_significant:
            advice = (
                "The slice seems to be photographed at an angle: a homography leaves "
                f"{_mm(perspective.fle_rms_m)} a marker. Rectify the picture"
            )
        elif outlier is not None:
            index, others_m = outlier
            advice = (
                f"Without {labels[index]} the others fit to {_mm(others_m)}: touch it again, or "
                "leave it out with --robust"
            )
        else:
            advice = (
                "Look for the file of another case, mistaken labels, a wrong unit or markers that "
                "moved"
            )
        raise CheckFailed(
            f"the markers miss their places by {as_given} rms, and --max-residual allows "
            f"{1e3 * max_residual_m:g} mm. {advice}",
            code="residual-large",
            numbers={"fre_rms_m": registration.fre_rms_m, "max_residual_m": max_residual_m},
        )
    refuse_wrong_scale(registration)


def refuse_large_error(
    error: TargetError,
    max_tre_m: float,
    registration: Registration,
    points: Array,
    *,
    taken_from: str = "",
) -> None:
    """Refuse a registration that may be further off along the curve than a person allows.

    error: along the source `points` (M, 2|3)
    taken_from: the other setting that gave `max_tre_m`, where nobody stated the limit itself
    Raises CheckFailed: the 95 % bound of the whole curve is above `max_tre_m`
    """
    value_m = float(error.curve95_m[error.worst])
    if value_m <= max_tre_m:
        return
    advice = "Add markers around the curve"
    if registration.model == "affine" and not stretch_findings(registration):
        fit = fit_similarity(registration.fit.problem, registration.used)
        similar = replace(registration, model="similarity", fit=fit)
        similar_m = float(similar.tre95_curve_m(points).max())
        if similar_m <= max_tre_m:
            advice = f"With --model similarity it is {_mm(similar_m)}"
    allowed = f"{1e3 * max_tre_m:g} mm"
    if taken_from:
        allowed += f" (the {taken_from})"
    raise CheckFailed(
        f"the registration error may reach {_mm(value_m)} (95 % bound over the curve), and "
        f"--max-tre allows {allowed}. {advice}, or give another --max-tre",
        where=f"curve point {error.worst}",
        code="tre-large",
        numbers={"curve95_max_m": value_m, "max_tre_m": max_tre_m, "point": error.worst},
    )


def registration_findings(registration: Registration) -> tuple[Finding, ...]:
    """What the markers say against themselves and is not refused."""
    findings = []

    # Another order of the labels fits better than chance explains, or about as well.
    mistakes = label_mistakes(registration)
    if mistakes and mistakes[0].p_value < GOOD_SET_PROBABILITY:
        sentence = mistakes[0].sentence(registration.labels)
        text = (
            f"{sentence[0].upper()}{sentence[1:]} (as given: {_mm(registration.fre_rms_m)}). "
            "Check the labels."
        )
        findings.append(doubt("labels-doubtful", "register", text))
    elif mistakes:
        text = (
            "The markers form a symmetric pattern: exchanged labels would go unnoticed. Add one "
            "off it."
        )
        findings.append(note("layout-symmetric", "register", text))

    # A slice that was photographed at an angle leaves residuals that no single marker explains.
    perspective = perspective_test(registration)
    if perspective is not None and perspective.is_significant:
        text = (
            "The slice seems to be photographed at an angle: a homography leaves "
            f"{_mm(perspective.fle_rms_m)} a marker, the {registration.model} model "
            f"{_mm(registration.fle_rms_m)}. Rectify the picture; the error bound does not count "
            "the angle."
        )
        findings.append(doubt("perspective", "register", text))
    else:
        findings += outlier_findings(registration)
        if perspective is not None and perspective.is_possible:
            text = (
                "A photograph's small angle may move the markers by "
                f"{_mm(perspective.departure_m)}, which the error bound does not count. Is "
                "the slice one?"
            )
            findings.append(note("perspective", "register", text))

    findings += layout_findings(registration)
    findings += unchecked_findings(registration)
    findings += scale_findings(registration)
    findings += stretch_findings(registration)
    findings += sigma_findings(registration)
    return tuple(findings)


def layout_findings(registration: Registration) -> list[Finding]:
    """A layout that is long, very large, or has two markers at one place."""
    findings = []
    labels = registration.labels
    if registration.condition > LONG_LAYOUT:
        text = (
            f"The markers' layout is {registration.condition:.0f} times as long as wide, and "
            "the error grows fast across it. Add a marker off the long axis."
        )
        findings.append(note("layout-long", "register", text))
    s = registration.fit.problem.s
    for i, j in combinations(range(len(s)), 2):
        if np.linalg.norm(s[i] - s[j]) < 1e-6:
            text = (
                f"Markers {labels[i]} and {labels[j]} stand at one place in the source. Correct "
                "the file."
            )
            place = registration.place_px(i)
            findings.append(doubt("markers-coincide", "register", text, place_px=place))
    radius_m = rms_length(registration.fit.problem.y)
    if radius_m > MAX_RADIUS_M:
        text = f"The markers lie {radius_m:.3g} m (rms) from their centre. Is the unit metres?"
        findings.append(doubt("layout-large", "register", text))
    return findings


def unchecked_findings(registration: Registration) -> list[Finding]:
    """Markers whose error would move the fixture and leave hardly a residual.

    Of three markers that is true whatever they measured, so it is a note. Of more it is a doubt
    where a marker alone decides its own place, for another marker near it would check it; and where
    an affine map's stretch explains what a marker may have caused.
    """
    fit = registration.fit
    # The share in the direction that is checked least.
    share = np.linalg.eigvals(fit.hat).real.max(axis=1)
    unchecked = np.flatnonzero(fit.used & (share > UNCHECKED_LEVERAGE))
    if not len(unchecked):
        return []
    if fit.used.sum() == 3:
        text = (
            "Three markers cannot check each other: an error across the slice moves the fixture "
            "and shows nowhere. A fourth marker would show it."
        )
        return [note("markers-unchecked", "register", text)]
    names = ", ".join(str(registration.labels[i]) for i in unchecked)
    text = f"No other marker checks {names}: an error there moves the fixture and shows nowhere."
    place = registration.place_px(int(unchecked[0]))
    if share[unchecked].max() > DECISIVE_LEVERAGE:
        text += " Add a marker near it."
        return [doubt("markers-unchecked", "register", text, place_px=place)]
    if registration.model == "affine" and fit.problem.model.dimension == 2:
        residual_m = rms_length(fit_similarity(fit.problem, fit.used).vectors[fit.used])
        if residual_m > UNSTRETCHED_RESIDUAL_M:
            text += (
                f" Without the stretch of the affine map the markers miss by {_mm(residual_m)} "
                "rms. Add a marker."
            )
            return [doubt("markers-unchecked", "register", text, place_px=place)]
    text += " Add a marker near it to be sure."
    return [note("markers-unchecked", "register", text, place_px=place)]


def sigma_findings(registration: Registration) -> list[Finding]:
    """Residuals that are larger than the stated sigmas allow, by a chi-square test."""
    unit_m = registration.fit.problem.sigma_unit_m
    if unit_m is None:
        return []
    from scipy.special import chdtrc

    ratio = registration.sigma_m / unit_m
    if chdtrc(registration.dof, registration.dof * ratio**2) >= GOOD_SET_PROBABILITY:
        return []
    text = (
        f"The residuals are {ratio:.1f} times what the stated sigmas allow. Touch the worst "
        "marker again, or state larger sigmas."
    )
    return [doubt("sigma-exceeded", "register", text)]


def error_findings(error: TargetError) -> tuple[Finding, ...]:
    """That part of the curve lies beyond the markers."""
    beyond = int(error.is_extrapolated.sum())
    if not beyond:
        return ()
    share = beyond / len(error.rms_m)
    text = f"{share:.0%} of the curve lies beyond the markers, where the error grows."
    text += " Add a marker there."
    if share < EXTRAPOLATED_SHARE:
        return (note("curve-extrapolated", "register", text),)
    return (doubt("curve-extrapolated", "register", text),)


def side_finding(registration: Registration) -> Finding | None:
    """That the slice is seen from below, where nobody said from which side it is looked at.

    A mirrored planar layout fits as well as the right one, turned over. So a robot file with x and
    y exchanged shows by the side alone.
    """
    faces = registration.image_faces
    if faces is None or faces[2] >= 0:
        return None
    text = (
        f"By the markers the slice is seen from {describe_side(faces)}. If you look at it from "
        "above, the robot's positions are mirrored, as with x and y exchanged. Say which with "
        "--seen-from above or below."
    )
    return doubt("faces-down", "register", text)


def describe_checks(registration: Registration) -> dict[str, Any]:
    """The scale against the known one, and the test for perspective, as `--json` reports them."""
    report: dict[str, Any] = {}
    departures = scale_departures(registration)
    if departures:
        report["spacing_departure"] = [departure for departure, _ in departures]
        report["spacing_departure_sigma"] = [sigma for _, sigma in departures]
    perspective = perspective_test(registration)
    if perspective is not None:
        report["perspective"] = {
            "p_value": perspective.p_value,
            "said": perspective.is_significant,
        }
    return report


def _mm(length_m: float) -> str:
    return f"{1e3 * length_m:.2f} mm"
