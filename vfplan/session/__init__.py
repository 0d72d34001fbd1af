"""Recordings of HIP positions in, replay results out.

`read_session` gives a whole recording, `open_session` a stream of blocks that never holds more
than a few of them; `ResultWriter` writes a result as it comes.
"""

from __future__ import annotations

from vfplan.lazy import on_demand
from vfplan.session.events import Event, read_events, write_events
from vfplan.session.poses import Poses, read_poses
from vfplan.session.read import open_session, read_session
from vfplan.session.result import (
    RESULT_FORMAT,
    RESULT_VERSION,
    TickBlock,
    read_result,
    require_fixture,
)
from vfplan.session.resultwriter import CsvWriter, ResultWriter, write_result
from vfplan.session.ros import RosOptions
from vfplan.session.session import BLOCK, Session, SessionSource, SessionStream, resampled

__all__ = [
    "BLOCK", "RESULT_FORMAT", "RESULT_VERSION", "CsvWriter", "Event", "Poses", "ResultWriter",
    "RosOptions", "Session", "SessionSource", "SessionStream", "TickBlock", "open_session",
    "read_events", "read_poses", "read_result", "read_session", "require_fixture", "resampled",
    "write_events", "write_result",
]  # fmt: skip

# Besides `__all__`: what tests, samples and pages use, without a promise (docs/api-policy.md).
__getattr__ = on_demand(
    __name__,
    {
        "mcapfile": "TICK McapWriter read_ticks",
    },
)
