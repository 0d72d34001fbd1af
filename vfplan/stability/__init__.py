"""Does the loop stay stable when the wall is stiff, and does the engine stay passive?

>>> from vfplan import stability
>>> stability.gate(fixture, robot)                 # the verdict; raises CheckFailed

`vfplan.stability.study` runs all parts: closed loop, passivity, extreme cases.
docs/stability.md has the derivations, the tables and the pictures.
"""

from __future__ import annotations

from vfplan.stability.contacts import CaseResult
from vfplan.stability.loop import (
    LoopMotion,
    Plant,
    SimulatedHand,
    exact_bound,
    linear_bound,
    run_until_still,
    simulate,
    spectral_radius,
)
from vfplan.stability.study import gate, verdict_text, with_verdict

__all__ = [
    "CaseResult", "LoopMotion", "Plant", "SimulatedHand", "exact_bound", "gate", "linear_bound",
    "run_until_still", "simulate", "spectral_radius", "verdict_text", "with_verdict",
]  # fmt: skip
