"""An arm that renders a fixture before there is one: reach, torques, reflexes, in simulation.

A leaf room: no other package imports it. Its command is `vfplan rehearse`. It needs the extra
`[arm]` (MuJoCo), and no screen and no network.
"""

from __future__ import annotations

import importlib
from typing import Any

_DEFINED = {
    "ARMS": "model",
    "Arm": "model",
    "Rehearsal": "rehearsal",
    "rehearse": "rehearsal",
}
__all__ = ["ARMS", "Arm", "Rehearsal", "rehearse"]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: `vfplan rehearse --help` needs none of them."""
    if name not in _DEFINED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_DEFINED[name]}"), name)
