"""Replay a session against a fixture: what the controller would have rendered, and how it went.

The engine is the controller's own core, stepped sample by sample, never by a clock: the same
session and fixture give the same bits on every run.

replay      the whole way: load, run, report
run         one engine's run over a session
link, governing, guiding, changing
            what stands between hand and engine, behind it, or in its place
quantities, metrics, episodes, clearance, timing
            what is measured
limits, findings
            what the numbers are held against, and what a person should look at
verdict     pass, fail, or not tested
compare     two runs of the same ticks
thinning    a bounded number of ticks for pictures
approach    sessions that go along a drawn curve
"""

from __future__ import annotations

from vfplan.replaying.guiding import ENGINES, RULES
from vfplan.replaying.link import Comparison, Link, LossyLink, approach_sessions
from vfplan.replaying.replay import Replay, replay, result_record

__all__ = [
    "ENGINES", "RULES", "Comparison", "Link", "LossyLink", "Replay", "approach_sessions", "replay",
    "result_record",
]  # fmt: skip
