"""Replay a session against a fixture: what the controller would have rendered, and how it went.

The engine is the controller's own core, stepped sample by sample, never by a clock: the same
session and fixture give the same bits on every run.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

from vfplan.replay.core import Replay, replay, result_record
from vfplan.replay.engines import ENGINES, RULES
from vfplan.replay.faults import Link

__all__ = ["ENGINES", "RULES", "Link", "Replay", "replay", "result_record"]


class _Replaying(ModuleType):
    """`vfplan.replay(...)` is the call, though `vfplan.replay` also names this package."""

    def __call__(self, *args: Any, **kwargs: Any) -> Replay:
        return replay(*args, **kwargs)


sys.modules[__name__].__class__ = _Replaying
