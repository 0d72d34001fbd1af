"""What happened to a fixture while it was rendered: exchanges and edits, each with its tick."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfplan.errors import SessionError
from vfplan.io.apart import apart
from vfplan.io.disk import whole_file
from vfplan.io.hdf5 import h5py
from vfplan.io.reading import OneFile
from vfplan.session.arrays import opened_hdf5, plain_dataset

KINDS = ("exchange", "edit", "remake")
_TABLES = ("tick", "kind", "removed", "added", "remove", "add")


@dataclass(frozen=True, eq=False)
class Event:
    """What the loop takes up at the beginning of a tick.

    Parameters
    ----------
    tick
        Counted from the session's first.
    fixture
        For an exchange: a bundle's bytes, or a `Fixture`.
    remove, add
        For an edit: numbers (n,) and points (m, 3) [m], as for `ProxyEngine.edit`.
    remake
        The engine was made anew of the points that are left, as a controller does now and then.
    """

    tick: int
    fixture: Any = None
    remove: ArrayLike = ()
    add: ArrayLike = ()
    remake: bool = False

    @property
    def kind(self) -> str:
        """One of `KINDS`."""
        if self.remake:
            return "remake"
        return "edit" if self.fixture is None else "exchange"


def write_events(path: str | Path, events: Sequence[Event], *, overwrite: bool = False) -> None:
    """Write events as HDF5; an exchange's fixture as its bundle's bytes.

    Raises `OutputError` when the file exists or cannot be written.
    """
    gone = [np.asarray(event.remove, np.uint32).reshape(-1) for event in events]
    come = [np.asarray(event.add, np.float64).reshape(-1, 3) for event in events]
    tables = {
        "tick": np.array([event.tick for event in events], np.int64),
        "kind": np.array([KINDS.index(event.kind) for event in events], np.uint8),
        "removed": np.array([len(rows) for rows in gone], np.int64),
        "added": np.array([len(rows) for rows in come], np.int64),
        "remove": np.concatenate([np.empty(0, np.uint32), *gone]),
        "add": np.concatenate([np.empty((0, 3)), *come]),
    }
    with whole_file(Path(path), overwrite=overwrite) as stream, h5py.File(stream, "w") as file:
        file.attrs["format"] = "vfplan-events"
        for name, table in tables.items():
            file[name] = table
        for i, event in enumerate(events):
            if event.fixture is not None:
                file[f"fixture/{i}"] = np.frombuffer(event.fixture, np.uint8)


def read_events(path: str | Path) -> list[Event]:
    """Read what `write_events` wrote; raises `SessionError` for a file that is none."""
    name = str(path)
    file = OneFile(Path(path), SessionError)
    job = "vfplan.session.events:stored_events"
    tables, *fixtures = list(apart(job, name, file=file, where=name, kind=SessionError))
    tick, kind, removed, added, remove, add = tables
    bundles = {int(number[0]): data.tobytes() for number, data in fixtures}
    ends = np.concatenate(([0], np.cumsum(removed))), np.concatenate(([0], np.cumsum(added)))
    events = []
    for i in range(len(tick)):
        parts = [slice(int(end[i]), int(end[i + 1])) for end in ends]
        gone, come = remove[parts[0]].astype(np.uint32), add[parts[1]]
        events.append(Event(int(tick[i]), bundles.get(i), gone, come, kind[i] == 2))
        if events[-1].kind != KINDS[int(kind[i])]:
            raise SessionError(f"event {i + 1} is an exchange without a fixture", where=name)
    return events


def stored_events(stream: BinaryIO, name: str) -> Iterator[Any]:
    """The tables, then each fixture with its event's number; read in a process apart."""
    with opened_hdf5(stream, name) as file:
        wanted = ", ".join(_TABLES)
        tables = [np.asarray(plain_dataset(file, t, name, wanted), float) for t in _TABLES]
        tick, kind, removed, added, remove, add = tables
        count = tick.shape if tick.ndim == 1 else None
        counts = np.concatenate((removed.ravel(), added.ravel()))
        sound = (
            kind.shape == removed.shape == added.shape == count
            and np.isin(kind, range(len(KINDS))).all()
            and (counts >= 0).all()
            and remove.shape == (removed.sum(),)
            and add.shape == (added.sum(), 3)
            and (np.diff(tick, prepend=0.0) >= 0).all()
            and ((remove >= 0) & (remove < 2**32)).all()
            and all(_whole(table) for table in (tick, removed, added, remove))
            and (counts.reshape(2, -1)[:, kind != 1] == 0).all()
            and np.isfinite(add).all()
        )
        if not sound:
            raise SessionError("its tables of events do not fit together", where=name)
        yield tuple(tables)
        for i in np.flatnonzero(kind == 0).tolist():
            yield (
                np.array([float(i)]),
                np.asarray(plain_dataset(file, f"fixture/{i}", name), np.uint8).view(np.int8),
            )


def _whole(numbers: NDArray[np.float64]) -> bool:
    return bool((numbers < 2**53).all() and (numbers == np.floor(numbers)).all())
