"""Replay results, a row a tick: written as they come, as HDF5 and CSV, and read back."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError, SessionError, VersionError
from vfplan.io.files import FilePath, OpenedFile, naming_place
from vfplan.io.hdf5 import h5py
from vfplan.io.sandbox import run_in_sandbox
from vfplan.io.writing import whole_file
from vfplan.session.read import check_arrays, opened_hdf5, plain_attribute, plain_datasets
from vfplan.session.session import BLOCK, MAX_TIME_S, Array

# A dataclass of arrays, a row a tick.
Ticks = TypeVar("Ticks")

# Attributes of a file of results: the name of each and its value.
Attributes = dict[str, Any]

RESULT_FORMAT = "vfplan-result"
RESULT_VERSION = "1.0"
ADVICE = "Give a result of vfplan replay"

# Dataset -> (shape of a row, type, unit)
TABLE = {
    "time": ((), "<f8", "s"),
    "hip": ((3,), "<f8", "m"),
    "proxy": ((3,), "<f8", "m"),
    "normal": ((3,), "<f8", "1"),
    "force": ((3,), "<f8", "N"),
    "state": ((), "|i1", "1"),
    "penetration": ((), "<f8", "m"),
    "overlap": ((), "<f8", "m"),
}
# -1 no neighbour, 0 free motion, 1 in contact, 2 entrenched (the paper's Algorithm 1)
STATES = range(-1, 3)


@dataclass(frozen=True, eq=False)
class TickBlock:
    """A run of consecutive ticks of a replay, one row each."""

    # (n,) [s] and (n, 3) [m], as the controller had them
    time: Array
    hip: Array
    # (n, 3) at the end of each tick [m], [1], [N]
    proxy: Array
    normal: Array
    force: Array
    # (n,) int8, one of STATES
    state: NDArray[np.int8]
    # (n,) |proxy - hip| [m]
    penetration: Array
    # (n,) how far the HIP is beyond the cloud's own surface [m], never below 0
    overlap: Array

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: slice | NDArray[np.intp]) -> TickBlock:
        """These ticks alone."""
        return select_ticks(self, rows)


def concatenate_ticks(blocks: Sequence[Ticks]) -> Ticks:
    """Blocks, or traces of an engine, one after the other, as one."""
    rows = [[getattr(block, field.name) for field in fields(block)] for block in blocks]
    return type(blocks[0])(
        *(concatenate_ticks(parts) if is_dataclass(parts[0]) else np.concatenate(parts)
          for parts in zip(*rows, strict=True))
    )  # fmt: skip


def select_ticks(block: Ticks, rows: slice | NDArray[np.intp]) -> Ticks:
    """These ticks of a block, or of an engine's trace."""
    values = (getattr(block, field.name) for field in fields(block))
    return type(block)(
        *(select_ticks(value, rows) if is_dataclass(value) else value[rows] for value in values)
    )


def read_result(path: FilePath, fixture_sha256: str | None = None) -> tuple[TickBlock, Attributes]:
    """Read a result file whole.

    Parameters
    ----------
    fixture_sha256
        The digest of the bundle that it has to be made with, hexadecimal. A result that names no
        bundle was replayed from arrays, and passes.

    Returns
    -------
    The ticks, and the root attributes.

    Raises
    ------
    InputError
        Not a result file, or one of another bundle; a dataset is missing or has the wrong shape or
        type, or a value is one that no replay gives.
    VersionError
        A major version that this program does not read.
    """
    where = Path(path).name
    file = OpenedFile(Path(path))
    answers = run_in_sandbox("vfplan.session.result:stored_ticks", file=file, where=where)
    attrs = next(answers)
    with naming_place(where):
        if fixture_sha256 is not None:
            require_fixture(attrs, fixture_sha256)
        blocks = [TickBlock(*arrays) for arrays in answers]
        file.require_unchanged()
        if not blocks:
            message = "the result holds no ticks. Replay a session that has some"
            raise InputError(message, code="result-empty")
        ticks = concatenate_ticks(blocks)
        check_values(ticks)
    return ticks, attrs


def stored_ticks(stream: BinaryIO) -> Iterator[Any]:
    """A result's root attributes, then blocks of its datasets, in the order of `TickBlock`.

    Runs in the sandbox (`vfplan.io.sandbox`): a crafted file can crash libhdf5.
    """
    try:
        with opened_hdf5(stream) as file:
            attrs = {name: plain_attribute(value) for name, value in file.attrs.items()}
            found = attrs.get("format")
            if found != RESULT_FORMAT:
                message = f"format is {found!r}, not {RESULT_FORMAT!r}. {ADVICE}"
                raise InputError(message, code="not-a-result")
            version = str(attrs.get("version"))
            if version.partition(".")[0] != RESULT_VERSION.partition(".")[0]:
                message = f"is of version {version}, not {RESULT_VERSION}. Replay the session again"
                raise VersionError(message)
            yield attrs

            datasets = plain_datasets(file, TABLE)
            rows = {name: columns for name, (columns, _, _) in TABLE.items()}
            for start in range(0, check_arrays(datasets, rows), BLOCK):
                yield tuple(dataset[start : start + BLOCK] for dataset in datasets.values())
    except SessionError as error:
        # What also reads sessions raises it.
        message = error.message.replace("Write the file again", ADVICE)
        raise InputError(message, code=error.code) from None


def check_values(ticks: TickBlock) -> None:
    """Refuse values that no replay gives, because a picture of them would show something else."""
    for name in TABLE:
        rows = getattr(ticks, name).reshape(len(ticks), -1)
        # NaN is not <= anything, so it is not good either. Squares of the limit are finite.
        good = np.isin(rows, STATES) if name == "state" else np.abs(rows) <= MAX_TIME_S
        if not good.all():
            tick = int(np.argmin(good.all(axis=1)))
            message = f"{name} of tick {tick} is no value of a replay. Replay the session again"
            raise InputError(message, code="value-invalid", numbers={"tick": tick})
    increases = np.diff(ticks.time) > 0
    if not increases.all():
        tick = 1 + int(np.argmin(increases))
        message = f"time does not increase at tick {tick}. Replay the session again"
        raise InputError(message, code="time-not-increasing", numbers={"tick": tick})


def require_fixture(attrs: Attributes, sha256: str) -> None:
    """Refuse a result, of these root attributes, of a bundle with another digest."""
    try:
        made_with = str(json.loads(attrs.get("fixture", "{}")).get("sha256", sha256))
    except (ValueError, TypeError, AttributeError):
        message = "attribute fixture is no record of a fixture. Replay the session again"
        raise InputError(message, code="record-broken") from None
    if made_with != sha256:
        found = f"SHA-256 {made_with[:12]}..., not {sha256[:12]}..."
        message = f"was replayed against the fixture with {found}. Give the same fixture"
        raise InputError(message, code="fixture-differs")


class ResultWriter(ExitStack):
    """Write a result file block by block; use as a context manager.

    The file appears under its name when the `with` statement ends well. Otherwise there is none.

    Parameters
    ----------
    path
        A file that does not exist yet.
    attrs
        Root attributes beyond `format` and `version`; a dict or list is kept as JSON text.

    Raises
    ------
    OutputError
        The file exists, or cannot be made or written.
    """

    def __init__(self, path: FilePath, attrs: Attributes) -> None:
        super().__init__()
        with ExitStack() as stack:
            file = stack.enter_context(whole_file(Path(path), overwrite=False))
            self._bytes = FailureTolerantFile(file)
            self._file = h5py.File(self._bytes, "w", libver=("v110", "v110"))
            stack.push(self._finish)
            self.set({"format": RESULT_FORMAT, "version": RESULT_VERSION, **attrs})
            for name, (columns, dtype, unit) in TABLE.items():
                dataset = self._file.create_dataset(
                    name, (0, *columns), dtype, maxshape=(None, *columns),
                    chunks=(BLOCK, *columns), fletcher32=True,
                )  # fmt: skip
                dataset.attrs["unit"] = unit
            self.push(stack.pop_all())

    def set(self, attrs: Attributes) -> None:
        """Set root attributes; those that are `None` are omitted."""
        for name, value in attrs.items():
            if isinstance(value, (dict, list, tuple)):
                self._file.attrs[name] = json.dumps(value)
            elif value is not None:
                self._file.attrs[name] = value

    def append(self, block: TickBlock) -> None:
        """Add a block of ticks."""
        for name in TABLE:
            dataset = self._file[name]
            size = len(dataset)
            dataset.resize(size + len(block), axis=0)
            dataset[size:] = getattr(block, name)
        self._bytes.check()

    def _finish(self, *failure: object) -> None:
        """Let libhdf5 write what it still holds."""
        self._file.close()
        if failure[0] is None:
            self._bytes.check()


def write_result(replayed: Any, path: FilePath) -> None:
    """Write the ticks of a `Replay` at once, with its record as attributes."""
    with ResultWriter(path, replayed.record) as writer:
        writer.append(replayed.ticks)


class CsvWriter(ExitStack):
    """Write ticks as CSV, one line a tick; numbers read back to the same bits.

    The file appears, whole, when the `with` statement ends well; raises `OutputError` when there
    is one already, or it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._file = self.enter_context(whole_file(path, overwrite=False))
        names = ["t", "x", "y", "z"]
        for name, (columns, _, _) in list(TABLE.items())[2:]:
            names += [f"{name}_{axis}" for axis in "xyz"] if columns else [name]
        self._file.write(",".join(names).encode() + b"\n")

    def append(self, block: TickBlock) -> None:
        """Add a block of ticks."""
        columns = [one for name in TABLE for one in np.atleast_2d(getattr(block, name).T).tolist()]
        lines = [",".join(map(repr, row)) + "\n" for row in zip(*columns, strict=True)]
        self._file.write("".join(lines).encode("ascii"))


class FailureTolerantFile(io.FileIO):
    """A file for libhdf5, which crashes when a write fails while it closes a file.

    From the first failed write on, what is written is lost and what was lost reads as zeros, so
    that libhdf5 can come to its end. `check` raises the failure afterwards.
    """

    def __init__(self, file: BinaryIO) -> None:
        super().__init__(file.fileno(), "r+", closefd=False)
        self._failure: OSError | None = None

    def check(self) -> None:
        """Raise the `OSError` of the first write that failed."""
        if self._failure is not None:
            raise self._failure

    def write(self, data: memoryview) -> int:
        """Write at the position, as for any file."""
        remaining = memoryview(data).cast("B")
        end = self.tell() + len(remaining)
        try:
            while len(remaining) and self._failure is None:
                remaining = remaining[super().write(remaining) :]
        except OSError as error:
            self._failure = error
        self.seek(end)
        return len(data)

    def readinto(self, buffer: memoryview) -> int:
        """Read at the position, as for any file; zeros behind its end."""
        view = memoryview(buffer).cast("B")
        count = super().readinto(view)
        view[count:] = bytes(len(view) - count)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Cut the file, or make it longer."""
        try:
            return super().truncate(size)
        except OSError as error:
            self._failure = self._failure or error
            return size or 0
