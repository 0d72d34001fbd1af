"""Correspondences -> transform, with its error wherever it is used."""

from __future__ import annotations

from vfplan.registration.register import describe, fit_registration
from vfplan.registration.result import Registration

__all__ = ["Registration", "describe", "fit_registration"]
