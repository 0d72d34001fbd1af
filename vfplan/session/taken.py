"""When a controller's loop knew of each pose and event: its log's columns `poses` and `events`.

In real time they come from other threads; which tick knew of them is the loop's to say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SessionError
from vfplan.io.reading import OneFile
from vfplan.session.csvfile import csv_columns, read_csv
from vfplan.session.events import Event, read_events
from vfplan.session.poses import Poses, read_poses

COLUMNS = ("t", "poses", "events")


def as_taken(
    session: str | Path,
    poses: Poses | str | Path | None,
    events: Sequence[Event] | str | Path | None,
) -> tuple[Poses | None, list[Event] | None]:
    """Poses and events as the log says that the loop knew of them; else as they are.

    Raises `SessionError` for a log that knows of more than there are, or of fewer and fewer.
    """
    poses = read_poses(poses) if isinstance(poses, str | Path) else poses
    events = read_events(events) if isinstance(events, str | Path) else events
    happened = None if events is None else list(events)
    if Path(session).suffix.lower() != ".csv" or (poses is None and events is None):
        return poses, happened
    file, name = OneFile(Path(session), SessionError), str(session)
    with file.view() as stream:
        if not set(COLUMNS) <= set(csv_columns(stream, name)):
            return poses, happened
    pieces = list(read_csv(file, name, 1.0, COLUMNS))
    time, known = (np.concatenate(part) for part in zip(*pieces, strict=True))
    accepted = 0 if poses is None else _younger(poses.time)
    ends = np.max(accepted), 0 if happened is None else len(happened)
    for column, seen, most in zip(COLUMNS[1:], known.T, ends, strict=True):
        if (np.diff(seen, prepend=0) < 0).any() or seen[-1] > most:
            text = f"column {column!r} ends with {seen[-1]:g} and has to rise, to at most {most}"
            raise SessionError(text, where=name)
    if poses is not None:
        tick = np.searchsorted(known[:, 0], accepted)  # the first that knew of as many
        kept = tick < len(time)
        arrived = np.maximum.accumulate(time[tick[kept]])
        poses = Poses(poses.time[kept], poses.pose[kept], arrived)
    if happened is not None:
        ticks = np.searchsorted(known[:, 1], np.arange(len(happened)), side="right").tolist()
        pairs = zip(happened, ticks, strict=True)
        happened = [replace(event, tick=k) for event, k in pairs if k < len(time)]
    return poses, happened


def _younger(time: NDArray[np.float64]) -> NDArray[np.intp]:
    """How many of the poses so far were younger than all before: the others are refused."""
    youngest = np.maximum.accumulate(time)
    return np.cumsum(np.diff(youngest, prepend=-np.inf) > 0)
