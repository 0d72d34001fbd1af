"""Correspondences -> transform, with its error wherever it is used."""

from __future__ import annotations

from vfplan.registration.checks import (
    describe_checks,
    error_findings,
    refuse_large_error,
    refuse_wrong_markers,
    registration_findings,
    side_finding,
)
from vfplan.registration.registration import (
    Registration,
    fit_registration,
    registration_report,
    target_error,
)
from vfplan.registration.touch import refine_by_touch

__all__ = [
    "Registration",
    "describe_checks",
    "error_findings",
    "fit_registration",
    "refine_by_touch",
    "refuse_large_error",
    "refuse_wrong_markers",
    "registration_findings",
    "registration_report",
    "side_finding",
    "target_error",
]
