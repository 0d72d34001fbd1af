"""What happened to a fixture while it was rendered: exchanges and edits, each with its tick.

A CSV, one thing a line:

    tick,what,x,y,z
    900,edit
    900,remove,3
    900,add,0.01,0.0,0.0001
    1100,exchange,other.h5
    1101,remake

The lines `remove` (the number of a point) and `add` (its place [m]) belong to the `edit` above
them. A bundle's path is taken from the folder of the events.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.errors import SessionError
from vfplan.io.files import read_whole, real, write_whole
from vfplan.io.reading import MOST_TEXT, OneFile
from vfplan.session.csvfile import csv_columns, read_csv
from vfplan.session.poses import Poses, read_poses

HEADER = "tick,what,x,y,z"
MOST_WHOLE = {"tick": 2**53, "number": 2**32}


@dataclass(frozen=True, eq=False)
class Event:
    """What the loop takes up at the beginning of a tick.

    tick: counted from the session's first
    fixture: for an exchange: a bundle's path, or a `Fixture`
    remove, add: for an edit: numbers (n,) and points (m, 3) [m], as for `ProxyEngine.edit`
    remake: the engine was made anew of the points that are left, as a controller does now and then
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


def write_events(path: str | Path, events: Sequence[Event], *, overwrite: bool = False) -> None:
    """Write events as CSV; an exchange's fixture by its bundle's path from the file's folder.

    Raises `OutputError` when the file exists or cannot be written, and `SessionError` for a path
    that a line cannot hold.
    """
    folder = Path(path).resolve().parent
    lines = [HEADER, *(line for event in events for line in _lines(event, folder)), ""]
    write_whole(Path(path), ["\n".join(lines).encode()], overwrite=overwrite)


def _lines(event: Event, folder: Path) -> Iterator[str]:
    head = f"{event.tick},{event.kind}"
    yield head if event.fixture is None else f"{head},{_from(folder, event.fixture)}"
    yield from (f"{event.tick},remove,{i}" for i in np.asarray(event.remove, np.uint32).tolist())
    for point in np.asarray(event.add, np.float64).reshape(-1, 3).tolist():
        yield f"{event.tick},add,{','.join(map(repr, point))}"


def _from(folder: Path, bundle: Any) -> str:
    if not isinstance(bundle, str | Path):
        raise SessionError("an exchange's fixture is written by its bundle's path; got a Fixture")
    found = os.path.relpath(Path(bundle).resolve(), folder)
    if any(c in found for c in ",\r\n") or found != found.strip():
        raise SessionError(f"{found!r}: a path with commas, line breaks or blanks at its ends")
    return found


def read_events(path: str | Path) -> list[Event]:
    """Read what `write_events` wrote; raises `SessionError` for a file that is none."""
    events: list[Event] = []
    data = read_whole(Path(path), MOST_TEXT, SessionError)
    for number, line in enumerate(data.split(b"\n"), start=1):
        where = f"{path}, line {number}"
        try:
            _take(line.decode("utf-8").strip(), number, events, Path(path).parent, where)
        except ValueError as error:  # of text that is not UTF-8 too
            raise SessionError(f"{line[:60]!r}: {error}", where=where) from None
    return events


def _take(line: str, number: int, events: list[Event], folder: Path, where: str) -> None:
    """Add a line's event, or what it adds to the one before."""
    if number == 1 or not line:
        if number == 1 and line != HEADER:
            raise ValueError(f"a first line {HEADER} wanted")
        return
    tick, what, *values = line.split(",") if "," in line else (line, "")
    at = _whole(tick, "tick")
    if events and at < events[-1].tick:
        raise ValueError(f"tick {at} after tick {events[-1].tick}; in order wanted")
    if what in ("remove", "add"):
        if not events or events[-1].kind != "edit" or events[-1].tick != at:
            raise ValueError(f"{what} without an edit of its tick above it")
        if what == "remove" and len(values) == 1 and not len(events[-1].add):
            events[-1].remove.append(_whole(values[0], "number"))
        elif what == "add" and len(values) == 3:
            events[-1].add.append([real(value) for value in values])
        else:
            raise ValueError("remove,NUMBER, and after all of these add,X,Y,Z wanted")
    elif what == "exchange" and len(values) == 1 and values[0]:
        events.append(Event(at, fixture=folder / values[0], where=where))
    elif what in ("edit", "remake") and not values:
        events.append(Event(at, remove=[], add=[], remake=what == "remake", where=where))
    else:
        raise ValueError("exchange,BUNDLE.h5, edit, remake, remove,NUMBER or add,X,Y,Z wanted")


def _whole(text: str, what: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) < MOST_WHOLE[what]):
        raise ValueError(f"{what} {text!r}; a whole number below {MOST_WHOLE[what]} wanted")
    return int(text)


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
