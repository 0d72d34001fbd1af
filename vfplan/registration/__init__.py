"""Correspondences -> transform, with its error wherever it is used."""

from __future__ import annotations

from vfplan.registration.registration import Registration, describe, fit_registration

__all__ = ["Registration", "describe", "fit_registration"]
