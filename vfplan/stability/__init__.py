"""Does the loop stay stable when the wall is stiff, and the arithmetic right at every edge?

>>> from vfplan import stability
>>> stability.gate(fixture, robot)                 # the verdict; raises CheckFailed

`vfplan.stability.study` runs all of it: closed loop, passivity, extreme cases.
docs/stability.md has the derivations, the tables and the pictures.
"""

from __future__ import annotations

from vfplan.stability.gate import approved, gate, refusal
from vfplan.stability.loop import Hand, Motion, settle, simulate
from vfplan.stability.rows import Row
from vfplan.stability.theory import Plant, exact_bound, linear_bound, spectral_radius

__all__ = [
    "Hand", "Motion", "Plant", "Row", "approved", "exact_bound", "gate", "linear_bound", "refusal",
    "settle", "simulate", "spectral_radius",
]  # fmt: skip
