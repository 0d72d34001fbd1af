"""A runnable sample: a planned slice, its markers and a session that probes the fixture."""

from __future__ import annotations

from vfplan.lazy import on_demand

# What the command line, tests, samples and pages use, without a promise (docs/api-policy.md).
__getattr__ = on_demand(
    __name__,
    {
        "experiments": "planned_curve probing_hand square",
        "paper": "planned_mask",
    },
)
