"""Recordings of HIP positions in, replay results out.

`read_session` gives a whole recording, `open_session` a stream of blocks that never holds more
than a few of them; `ResultWriter` writes a result as it comes.
"""

from __future__ import annotations

from vfplan.session.bags import RosOptions
from vfplan.session.events import Event, Poses, read_events, read_poses, write_events
from vfplan.session.read import open_session, read_session
from vfplan.session.result import (
    RESULT_FORMAT,
    RESULT_VERSION,
    CsvWriter,
    ResultWriter,
    TickBlock,
    read_result,
    require_fixture,
    write_result,
)
from vfplan.session.session import BLOCK, Session, SessionSource, SessionStream, resampled

__all__ = [
    "BLOCK", "RESULT_FORMAT", "RESULT_VERSION", "CsvWriter", "Event", "Poses", "ResultWriter",
    "RosOptions", "Session", "SessionSource", "SessionStream", "TickBlock", "open_session",
    "read_events", "read_poses", "read_result", "read_session", "require_fixture", "resampled",
    "write_events", "write_result",
]  # fmt: skip
