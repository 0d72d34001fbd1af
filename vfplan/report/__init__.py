"""One self-contained HTML page about a replay: no network, no other file needed."""

from __future__ import annotations

from vfplan.lazy import on_demand
from vfplan.report.page import write_report

__all__ = ["write_report"]

# Besides `__all__`: what tests, samples and pages use, without a promise (docs/api-policy.md).
__getattr__ = on_demand(
    __name__,
    {
        "scrubber": "envelope scrubber_data",
        "tables": "unit_of",
    },
)
