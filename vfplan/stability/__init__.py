"""Does the loop stay stable when the wall is stiff, and the arithmetic right at every edge?

>>> from vfplan import stability
>>> found = stability.prepare(fixture, robot).run()  # closed loop, passivity, extreme cases
>>> found.verdict.stable, found.verdict.k_max_n_per_m
>>> stability.gate(fixture, robot)                 # the verdict alone; raises CheckFailed

docs/stability.md has the derivations, the tables and the pictures.
"""

from __future__ import annotations

from vfplan.stability.gate import approved, gate, refusal
from vfplan.stability.loop import Hand, Motion, settle, simulate
from vfplan.stability.rows import Row
from vfplan.stability.study import DEFAULT_ROBOT, PARTS, Prepared, Study, prepare
from vfplan.stability.theory import Plant, exact_bound, linear_bound, spectral_radius

__all__ = [
    "DEFAULT_ROBOT",
    "PARTS",
    "Hand",
    "Motion",
    "Plant",
    "Prepared",
    "Row",
    "Study",
    "approved",
    "exact_bound",
    "gate",
    "linear_bound",
    "prepare",
    "refusal",
    "settle",
    "simulate",
    "spectral_radius",
]
