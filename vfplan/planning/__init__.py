"""`plan` is `extract`, then `register`: from a planned slice and its markers to a fixture."""

from __future__ import annotations

from vfplan.lazy import on_demand
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

# Besides `__all__`: what tests, samples and pages use, without a promise (docs/api-policy.md).
__getattr__ = on_demand(
    __name__,
    {
        "carry": "check_arcs_error",
        "guidance": "add_guidance",
        "margin": "add_margin",
        "rendering": "ignored_axis render",
        "tolerance": "choose iterations largest_tolerance",
    },
)
