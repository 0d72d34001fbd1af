"""Replay a session against a fixture: what the controller would have rendered, and how it went.

The engine is the controller's own core, stepped sample by sample, never by a clock: the same
session and fixture give the same bits on every run.
"""

from __future__ import annotations

from vfplan.replaying.core import Replay, replay, result_record
from vfplan.replaying.engines import ENGINES, RULES
from vfplan.replaying.faults import Link

__all__ = ["ENGINES", "RULES", "Link", "Replay", "replay", "result_record"]
