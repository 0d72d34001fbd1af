"""An arm that renders a fixture before there is one: reach, torques, reflexes, in simulation.

A leaf room: no other package imports it. Its command is `vfplan rehearse`. It needs the extra
`[arm]` (MuJoCo), and no screen and no network.
"""

from __future__ import annotations

from vfplan.lazy import on_demand

__all__ = ["ARMS", "Arm", "Rehearsal", "rehearse"]

# `__all__`, and what tests, samples and pages use without a promise (docs/api-policy.md).
__getattr__ = on_demand(
    __name__,
    {
        "model": "ARMS Arm",
        "rehearsal": "Rehearsal rehearse",
        "loop": "ArmHand run_loop",
        "stops": "safety_stops",
    },
)
