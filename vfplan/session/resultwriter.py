"""Replay results written as they come, a row a tick: HDF5, and CSV for spreadsheets."""

from __future__ import annotations

import itertools
import json
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from vfplan.io.hdf5 import h5py
from vfplan.session.closing import Steady, Whole, require_same
from vfplan.session.result import RESULT_FORMAT, RESULT_VERSION, TABLE, Result, TickBlock
from vfplan.session.types import BLOCK

HEADER = (
    "t,x,y,z,proxy_x,proxy_y,proxy_z,normal_x,normal_y,normal_z,force_x,force_y,force_z,"
    "state,penetration,overlap"
)


class ResultWriter(Whole):
    """Write a result file block by block; use as a context manager.

    The file appears under its name when the `with` statement ends well: on the disk, and read back
    to what was written. Else there is none.

    Parameters
    ----------
    path
        A file that does not exist yet.
    attrs
        Root attributes beyond `format` and `version`; a dict or list is kept as JSON text.
    groups
        Where results go: "" for the root, or names of groups (a second rule, for instance).

    Raises
    ------
    OutputError
        The file exists, or cannot be made or written.
    """

    def __init__(
        self, path: str | Path, attrs: dict[str, Any], *, groups: tuple[str, ...] = ("",)
    ) -> None:
        self._groups = groups
        super().__init__(path)
        self.set(attrs)

    def _begin(self, file: BinaryIO) -> None:
        self._bytes = Steady(file)
        self._sums = {(group, name): 0 for group in self._groups for name in TABLE}
        self._file = h5py.File(self._bytes, "w", libver=("v110", "v110"))
        self.set({"format": RESULT_FORMAT, "version": RESULT_VERSION})
        for name in self._groups:
            _create(self._file.require_group(name) if name else self._file)

    def set(self, attrs: dict[str, Any]) -> None:
        """Set root attributes; `None` is left out."""
        for name, value in attrs.items():
            if value is not None:
                kept = json.dumps(value) if isinstance(value, (dict, list, tuple)) else value
                self._file.attrs[name] = kept

    def append(self, block: TickBlock, group: str = "") -> None:
        """Add a block of ticks."""
        place = self._file[group] if group else self._file
        for name in TABLE:
            dataset, rows = place[name], getattr(block, name)
            size = len(dataset)
            dataset.resize(size + len(block), axis=0)
            dataset[size:] = rows
            self._sums[group, name] = _summed(rows, name, self._sums[group, name])
        self._bytes.check()

    def _close(self) -> None:
        self._file.close()

    def _verify(self) -> None:
        self._bytes.check()
        self._bytes.seek(0)
        with h5py.File(self._bytes, "r") as file:
            for (group, name), written in self._sums.items():
                dataset, found = file[f"/{group}/{name}"], 0
                for start in range(0, len(dataset), BLOCK):
                    found = _summed(dataset[start : start + BLOCK], name, found)
                require_same(found, written)


def _summed(rows: NDArray, name: str, before: int) -> int:
    return zlib.crc32(np.ascontiguousarray(rows, TABLE[name][1]), before)


def _create(place: h5py.Group) -> None:
    for name, (columns, dtype, unit) in TABLE.items():
        dataset = place.create_dataset(
            name,
            (0, *columns),
            dtype,
            maxshape=(None, *columns),
            chunks=(BLOCK, *columns),
            fletcher32=True,
        )
        dataset.attrs["unit"] = unit


def write_result(replayed: Result, path: str | Path) -> None:
    """Write a whole result at once: its ticks, and what `ResultWriter` takes as attributes."""
    with ResultWriter(path, replayed.record) as writer:
        writer.append(replayed.ticks)


class CsvWriter(Whole):
    """Write ticks as CSV, one line a tick; numbers read back to the same bits.

    The file appears, whole, when the `with` statement ends well; raises `OutputError` when there
    is one already, or it cannot be written.
    """

    def _begin(self, file: BinaryIO) -> None:
        self._file = file
        self._sum = 0
        self._write(HEADER + "\n")

    def _write(self, text: str) -> None:
        data = text.encode("ascii")
        self._sum = zlib.crc32(data, self._sum)
        self._file.write(data)

    def append(self, block: TickBlock) -> None:
        """Add a block of ticks."""
        columns = (np.atleast_2d(getattr(block, name).T).tolist() for name in TABLE)
        rows = zip(*itertools.chain(*columns), strict=True)
        self._write("".join(f"{','.join(map(repr, row))}\n" for row in rows))

    def _verify(self) -> None:
        self._file.seek(0)
        found = 0
        while piece := self._file.read(1 << 20):
            found = zlib.crc32(piece, found)
        require_same(found, self._sum)
