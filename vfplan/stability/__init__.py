"""Does the loop stay stable when the wall is stiff, and does the engine stay passive?

>>> from vfplan import stability
>>> stability.gate(fixture, robot)                 # the verdict; raises CheckFailed

`vfplan.stability.study` runs all parts: closed loop, passivity, extreme cases.
docs/stability.md has the derivations, the tables and the pictures.
"""

from __future__ import annotations

from vfplan.lazy import on_demand
from vfplan.stability.case_result import CaseResult
from vfplan.stability.gate import gate, verdict_text, with_verdict
from vfplan.stability.loop import LoopMotion, SimulatedHand, run_until_still, simulate
from vfplan.stability.theory import Plant, exact_bound, linear_bound, spectral_radius

__all__ = [
    "CaseResult", "LoopMotion", "Plant", "SimulatedHand", "exact_bound", "gate", "linear_bound",
    "run_until_still", "simulate", "spectral_radius", "verdict_text", "with_verdict",
]  # fmt: skip

# Besides `__all__`: what tests, samples and pages use, without a promise (docs/api-policy.md).
__getattr__ = on_demand(
    __name__,
    {
        "contacts": "Contact contacts_along first_touch patch point spread_rows",
        "extremes": "CASES ExtremeCase breach breach_by_jump engine_at_start figure_of_long_walk "
        "random_path run_extreme_cases",
        "largest": "engine_for largest_stiffness pressing_hand",
        "passivity": "energy_balance passivity_cases random_cycle",
        "study": "ALL_RULES skipped_extremes",
        "theory": "MAX_DECAY MIN_DECAY loop_matrix",
        "closed_loop": "press",
    },
)
