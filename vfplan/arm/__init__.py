"""An arm that renders a fixture before there is one: reach, torques, reflexes, in simulation.

Everything here needs the extra `[arm]` (MuJoCo); no screen and no network.
"""

from __future__ import annotations

from vfplan.arm.model import ARMS, Arm
from vfplan.arm.rehearsal import Rehearsal, rehearse
from vfplan.arm.visit import visit

__all__ = ["ARMS", "Arm", "Rehearsal", "rehearse", "visit"]
