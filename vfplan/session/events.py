"""Changes of a fixture while it was rendered: exchanges and edits, each with its tick.

A CSV, one change or one point a line:

    tick,what,x,y,z
    900,edit
    900,remove,3
    900,add,0.01,0.0,0.0001
    1100,exchange,other.h5
    1101,remake

The lines `remove` (the number of a point) and `add` (its place [m]) belong to the `edit` above
them. A bundle's path is relative to the folder of the events.

A tracker's poses as CSV: t,x,y,z,qw,qx,qy,qz, and `arrived` where they came later.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vfplan.engine.moving import MovingFrame
from vfplan.engine.parameters import MAX_COORDINATE
from vfplan.errors import SessionError
from vfplan.geometry import TURN_ROUNDED, UNIT_ROUNDED
from vfplan.geometry.lines import Flags
from vfplan.io.files import (
    MAX_TEXT_BYTES,
    FilePath,
    OpenedFile,
    named_columns,
    open_number_table,
    parse_decimal,
    read_text,
    split_rows,
)
from vfplan.io.writing import write_whole
from vfplan.session.session import Array, unit_factor

TURN_COLUMNS = ("qw", "qx", "qy", "qz")
POSE_COLUMNS = ("t", "x", "y", "z", *TURN_COLUMNS)


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of a fixture's frame in the session's frame."""

    # (n,) when the tracker looked [s], on the session's clock
    time: Array
    # (n, 7) place [m] and unit quaternion w x y z
    pose: Array
    # (n,) when the control loop had it [s], never decreasing
    arrived: Array
    # Number of those whose quaternion was rounded, and was taken at length 1
    rounded: int = 0


def read_poses(path: FilePath, units: str = "m") -> Poses:
    """Read a CSV of poses, whose places are in `units`.

    Raises SessionError: the file is no such table, or a pose in it is not one
    """
    file = OpenedFile(Path(path), SessionError)
    table = open_number_table(file.view, str(path), SessionError, ("t", *TURN_COLUMNS))
    columns = ("t", *named_columns(table, units), *TURN_COLUMNS)
    if "arrived" in table.columns:
        columns += ("arrived",)
    blocks = list(table.blocks(columns))
    if not blocks:
        raise SessionError("holds no pose. Give at least one", where=str(path), code="poses-empty")
    rows = np.concatenate(blocks)
    time = rows[:, 0].copy()
    pose = rows[:, 1:8] * [*[unit_factor(units)] * 3, 1, 1, 1, 1]
    arrived = rows[:, 8].copy() if "arrived" in table.columns else time

    length = np.linalg.norm(pose[:, 3:], axis=1)
    good = np.isfinite(rows).all(axis=1)
    good &= np.abs(length - 1) < TURN_ROUNDED
    good &= np.abs(pose[:, :3]).max(axis=1) <= MAX_COORDINATE
    good[1:] &= np.diff(arrived) >= 0
    if not good.all():
        i = int(np.argmin(good))
        message = (
            f"row {i + 1} holds no pose: {pose[i].tolist()} at {time[i]} s, arrived at "
            f"{arrived[i]} s. Give a place within 1e6 m, a quaternion of length 1, and a time of "
            "arrival after that of the pose before it"
        )
        raise SessionError(message, where=str(path), code="pose-invalid", numbers={"pose": i + 1})
    rounded = np.abs(length - 1) >= UNIT_ROUNDED
    pose[rounded, 3:] /= length[rounded, None]
    return Poses(time, pose, arrived, np.count_nonzero(rounded))


HEADER = ["tick", "what", "x", "y", "z"]

# Ticks are counted exactly up to here, also by programs that have float64 alone.
MAX_TICK = 2**sys.float_info.mant_dig

# Number of points that 32 bits can tell apart, as the engine does.
MAX_POINT_NUMBER = np.iinfo(np.uint32).max + 1

# Columns in which a controller logs how many poses and events it had, if its fixture changes.
CHANGE_COLUMNS = ("poses", "events")

# Columns of a session's CSV that say what the control loop knew at each tick: how many poses it had
# taken so far, and how many events.
LOOP_COLUMNS = ("t", *CHANGE_COLUMNS)


@dataclass(frozen=True, eq=False)
class Event:
    """A change that the loop makes at the beginning of a tick.

    tick: counted from the session's first
    fixture: for an exchange: a bundle's path, or a `Fixture`
    remove, add: for an edit: numbers (n,) and points (m, 3) [m], as for `ProxyEngine.edit`
    remake: the engine was made anew of the points that remain, as a controller does now and then
    where: the place in a file that it was read from
    """

    tick: int
    fixture: Any = None
    remove: ArrayLike = ()
    add: ArrayLike = ()
    remake: bool = False
    where: str | None = None

    @property
    def kind(self) -> str:
        """ "exchange", "edit" or "remake"."""
        if self.remake:
            return "remake"
        return "edit" if self.fixture is None else "exchange"


def write_events(path: FilePath, events: Sequence[Event]) -> None:
    """Write events as CSV, an exchange's fixture by its bundle's path.

    Raises OutputError: the file exists, or cannot be written
    """
    lines = [",".join(HEADER)]
    for event in events:
        line = f"{event.tick},{event.kind}"
        if event.fixture is not None:
            line += f",{os.path.relpath(event.fixture, Path(path).parent)}"
        lines.append(line)
        numbers = np.asarray(event.remove, np.uint32).tolist()
        lines += [f"{event.tick},remove,{number}" for number in numbers]
        points = np.asarray(event.add, np.float64).reshape(-1, 3).tolist()
        lines += [f"{event.tick},add,{x!r},{y!r},{z!r}" for x, y, z in points]
    write_whole(Path(path), ["\n".join([*lines, ""]).encode()], overwrite=False)


def read_events(path: FilePath) -> list[Event]:
    """Read what `write_events` wrote.

    Raises SessionError: the file is none of events, or its ticks are not in order
    """
    text, _ = read_text(path, MAX_TEXT_BYTES, SessionError)
    rows = split_rows(text, str(path), SessionError)
    if not rows or rows[0][1] != HEADER:
        message = f"the first line does not name the columns. Begin with {','.join(HEADER)}"
        raise SessionError(message, where=f"{path}, line 1", code="no-events")
    events = []
    for line, row in rows[1:]:
        cells = [cell.strip() for cell in row]
        while len(cells) > 2 and not cells[-1]:  # Spreadsheets fill short rows with empty cells.
            cells.pop()
        where = f"{path}, line {line}"
        try:
            add_row(cells, events, Path(path).parent, where)
        except ValueError as error:
            message = f"row {','.join(row)[:60]!r} cannot be used: {error}"
            raise SessionError(message, where=where, code="event-invalid") from None
    return events


def add_row(cells: list[str], events: list[Event], folder: Path, where: str) -> None:
    """Add a row's event, or what the row adds to the edit above it."""
    tick_text, what, *values = cells if len(cells) > 1 else (*cells, "")
    tick = _whole_number(tick_text, "tick", MAX_TICK)
    if events and tick < events[-1].tick:
        raise ValueError(f"tick {tick} comes after tick {events[-1].tick}. Put the rows in order")
    edit = None
    if events and events[-1].kind == "edit" and events[-1].tick == tick:
        edit = events[-1]
    if what == "exchange" and len(values) == 1:
        events.append(Event(tick, fixture=folder / values[0], where=where))
    elif what in ("edit", "remake") and not values:
        events.append(Event(tick, remove=[], add=[], remake=what == "remake", where=where))
    elif what == "remove" and len(values) == 1 and edit is not None and not edit.add:
        edit.remove.append(_whole_number(values[0], "number", MAX_POINT_NUMBER))
    elif what == "add" and len(values) == 3 and edit is not None:
        edit.add.append([parse_decimal(value) for value in values])
    else:
        raise ValueError(
            "it fits nowhere. Write exchange,BUNDLE.h5, edit or remake, and below an edit of its "
            "tick remove,NUMBER and then add,X,Y,Z"
        )


def _whole_number(text: str, what: str, limit: int) -> int:
    if not (text.isascii() and text.isdigit() and int(text) < limit):
        raise ValueError(f"{what} is {text!r}. Write a whole number below {limit}")
    return int(text)


def as_the_loop_saw(
    session: Any, poses: Poses | FilePath | None, events: Sequence[Event] | FilePath | None
) -> tuple[Poses | None, list[Event] | None]:
    """Poses and events with the times at which a controller's log says that the loop had them.

    Files are read. A session without the columns `poses` and `events` leaves both as they are.

    Raises SessionError: the log counts more of them than there are, or its counts fall
    """
    if isinstance(poses, FilePath):
        poses = read_poses(poses)
    if events is not None:
        events = read_events(events) if isinstance(events, FilePath) else list(events)
    is_table = isinstance(session, FilePath) and Path(session).suffix.lower() == ".csv"
    if not is_table or (poses is None and events is None):
        return poses, events
    file = OpenedFile(Path(session), SessionError)
    table = open_number_table(file.view, str(session), SessionError)
    if not set(LOOP_COLUMNS) <= set(table.columns):
        return poses, events
    rows = np.concatenate([np.empty((0, 3)), *table.blocks(LOOP_COLUMNS)])
    time, pose_count, event_count = rows.T

    accepted = np.zeros(1) if poses is None else np.cumsum(accepted_poses(poses))
    _check_counts("poses", pose_count, int(accepted.max()), str(session))
    _check_counts("events", event_count, len(events or ()), str(session))

    if poses is not None:
        # A pose arrived at the first tick whose count includes it.
        tick = np.searchsorted(pose_count, accepted)
        in_session = tick < len(time)
        arrived = np.maximum.accumulate(time[tick[in_session]])
        kept = {"time": poses.time[in_session], "pose": poses.pose[in_session]}
        poses = replace(poses, **kept, arrived=arrived)
    if events is not None:
        ticks = np.searchsorted(event_count, np.arange(len(events)), side="right").tolist()
        pairs = zip(events, ticks, strict=True)
        events = [replace(event, tick=tick) for event, tick in pairs if tick < len(time)]
    return poses, events


def accepted_poses(poses: Poses) -> Flags:
    """(n,) whether a loop that always has room for a pose takes it, or refuses it."""
    frame = MovingFrame()
    numbers = range(len(poses.time))
    return np.array([give_pose(frame, poses, i, sys.float_info.max) for i in numbers])


def give_pose(frame: MovingFrame, poses: Poses, i: int, time: float) -> bool:
    """Hand pose `i` to a frame, which takes it up at `time` [s]; False if it refuses it."""
    position, quaternion = np.split(poses.pose[i], [3])
    accepted = frame.native.pose(poses.time[i], position.copy(), quaternion.copy())
    frame.native.at(time)
    return accepted


def _check_counts(column: str, counts: Array, largest: int, where: str) -> None:
    rises = (np.diff(counts, prepend=0) >= 0).all()
    if not rises or (len(counts) and counts[-1] > largest):
        found = f"column {column!r} ends with {counts[-1]:g}"
        message = f"{found} and has to rise, to at most {largest}. Write it again"
        raise SessionError(message, where=where, code="loop-counts-invalid")
