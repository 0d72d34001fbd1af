"""`plan` is `extract`, then `register`: from a planned slice and its markers to a fixture."""

from __future__ import annotations

from vfplan.planning.extraction import ExtractResult, describe_extraction, extract, planned_curve
from vfplan.planning.plan import PlanResult, RegisterResult, plan, register
from vfplan.planning.settings import ExtractSettings, FixtureSettings

__all__ = [
    "ExtractResult",
    "ExtractSettings",
    "FixtureSettings",
    "PlanResult",
    "RegisterResult",
    "describe_extraction",
    "extract",
    "plan",
    "planned_curve",
    "register",
]
