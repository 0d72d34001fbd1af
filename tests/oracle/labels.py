"""What the registration makes of good marker sets and of usual label mistakes, set by set."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from label_mistakes import MISTAKES, PX_M, curve_error, marker_set
from oracle.tables import table_rows, table_text

import vfplan
from vfplan.errors import CheckFailed, MarkerError

EVERY = range(600)
QUICK = range(0, 600, 13)  # every layout, number of markers and model

# Good sets of a larger localisation error may be refused by the gate on the residual,
GATED_FLE_MM = 0.5
# and of all good sets this share.
MAX_REFUSED = 0.01
# The same fit: relative tolerance of the good sets' residuals and of the curve's errors.
SAME_FIT = 1e-3


@dataclass
class Row:
    """One set: the outcome with the right labels and with each mistake, and the good set's errors.

    An outcome is "refused", "finding" (written with a finding that wants an answer), "note"
    (written with one that only informs) or "silent" (written without one). In 2dd7600 every
    finding was a warning, so there is no "note" in the table.
    """

    set: int
    layout: str
    markers: int
    model: str
    fle_mm: float
    good: str
    reversed: str
    shifted: str
    exchanged: str
    permuted: str
    fre_mm: float  # RMS residual of the markers with the right labels; NaN where refused
    curve_mm: float  # largest error of the curve that the right labels give; NaN where refused


def model_of(markers):
    """Three markers need the rigid model; of the others, three in five sets take the affine one."""
    if len(markers.source) == 3:
        return "rigid"
    return ("affine", "affine", "affine", "similarity", "rigid")[markers.number % 5]


def judged(source, target, model):
    """(outcome, registration) of markers whose pixel spacing is known.

    This is the one place of the oracle that knows how a registration is made and judged.
    """
    from vfplan.registration.checks import refuse_wrong_markers, registration_findings

    try:
        registration = vfplan.fit_registration(source, target, model=model, pixel_spacing=PX_M)
        refuse_wrong_markers(registration, max_residual_m=1e-3)
    except (CheckFailed, MarkerError):
        return "refused", None
    severities = {finding.severity for finding in registration_findings(registration)}
    if "doubt" in severities:
        return "finding", registration
    return ("note" if severities else "silent"), registration


def measured(number):
    """The row of one set."""
    markers = marker_set(number)
    model = model_of(markers)
    good, registration = judged(markers.source, markers.target, model)
    fre_mm = curve_mm = np.nan
    if registration is not None:
        fre_mm = 1e3 * registration.fre_rms_m
        matrix = np.asarray(registration.T_target_source)
        curve_mm = 1e3 * curve_error(matrix[:3][:, [0, 1, -1]], markers.truth)
    mistaken = [markers.target[markers.orders[mistake]] for mistake in MISTAKES]
    outcomes = [judged(markers.source, target, model)[0] for target in mistaken]
    n, fle_mm = len(markers.source), 1e3 * markers.fle_m
    return Row(number, markers.layout, n, model, fle_mm, good, *outcomes, fre_mm, curve_mm)


def text(_tree, name):
    """What tests/data/oracle/labels.csv holds."""
    comments = (
        "Outcomes of good marker sets and of label mistakes (tests/making/label_mistakes.py).",
        f"Renew: python tests/oracle/renew.py {name}",
    )
    return table_text(comments, map(measured, EVERY), Row, 5)


def parsed(text):
    """{number: Row}."""
    return {row.set: row for row in table_rows(text, Row)}


def worse(frozen, new):
    """What is worse than in 2dd7600, a line for each; `new` may be a part of the sets."""
    for number, row in new.items():
        before = frozen[number]
        for mistake in MISTAKES:
            was, now = getattr(before, mistake), getattr(row, mistake)
            if now == "silent" and was != "silent":
                yield f"{_named(row)}: {mistake} is silent, was {was}"
        if row.good == "refused" and row.fle_mm <= GATED_FLE_MM:
            yield f"{_named(row)}: the right labels are refused"
        for name in ("fre_mm", "curve_mm"):
            was, now = getattr(before, name), getattr(row, name)
            if row.good == "refused":  # and so without a fit; how many are refused counts above
                continue
            if abs(now - was) > SAME_FIT * was + 1e-4:
                yield f"{_named(row)}: {name} is {now:.4f}, was {was:.4f}"
    refused, findings = (
        sum(row.good == word for row in new.values()) for word in ("refused", "finding")
    )
    if refused > max(1, MAX_REFUSED * len(new)):
        yield f"{refused} of {len(new)} good sets refused"
    findings_before = sum(frozen[number].good == "finding" for number in new)
    if findings > findings_before:
        yield f"{findings} of {len(new)} good sets with a finding, {findings_before} before"


def _named(row):
    return f"set {row.set} ({row.markers} on a {row.layout}, {row.model}, FLE {row.fle_mm:.2f} mm)"
