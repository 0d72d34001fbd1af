"""Replay results: a row a tick, read back from a file, and whether one belongs to a bundle."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, BinaryIO, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError, VersionError
from vfplan.io.apart import apart
from vfplan.io.hdf5 import h5py
from vfplan.io.reading import OneFile
from vfplan.session.arrays import opened_hdf5, plain_dataset
from vfplan.session.types import BLOCK, LATEST_S, Array

Rows = TypeVar("Rows")  # a dataclass of arrays, a row a tick
RESULT_FORMAT = "vfplan-result"
RESULT_VERSION = "1.0"

# name -> (columns, type, unit)
TABLE: dict[str, tuple[tuple[int, ...], str, str]] = {
    "time": ((), "<f8", "s"),
    "hip": ((3,), "<f8", "m"),
    "proxy": ((3,), "<f8", "m"),
    "normal": ((3,), "<f8", "1"),
    "force": ((3,), "<f8", "N"),
    "state": ((), "|i1", "1"),
    "penetration": ((), "<f8", "m"),
    "overlap": ((), "<f8", "m"),
}


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
    state: NDArray[np.int8]  # (n,) int8, -1, 0, 1 or 2
    penetration: Array  # (n,) |proxy - hip| [m]
    overlap: Array  # (n,) how far the HIP is beyond the cloud's own surface [m], never below 0

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: slice | NDArray[np.intp]) -> TickBlock:
        """These ticks alone."""
        return picked(self, rows)


class Result(Protocol):
    """What `write_result` writes; a `Replay` is one."""

    @property
    def ticks(self) -> TickBlock:
        """One row a tick."""

    @property
    def record(self) -> dict[str, Any]:
        """The root attributes."""


def joined(blocks: Sequence[Rows]) -> Rows:
    """Blocks, or traces, one after the other, as one."""
    return type(blocks[0])(*map(np.concatenate, zip(*map(_columns, blocks), strict=True)))


def picked(block: Rows, rows: slice | NDArray[np.intp]) -> Rows:
    """These ticks of a block, or of a trace."""
    return type(block)(*(column[rows] for column in _columns(block)))


def _columns(block: Any) -> list[Array]:
    return [getattr(block, field.name) for field in fields(block)]


STATES = (-1, 0, 1, 2)
LARGEST = LATEST_S  # of any number in a result, so that no square of it overflows


def read_result(path: str | Path, *, group: str = "") -> tuple[TickBlock, dict[str, Any]]:
    """Read a result file whole.

    Returns
    -------
    The ticks, and the root attributes.

    Raises
    ------
    InputError
        Not a result file, a dataset is missing or has the wrong shape or type, or a value is one
        that no replay gives.
    VersionError
        A major version that this program does not read.
    """
    file, where = _found(path), Path(path).name
    read = apart("vfplan.session.result:stored", where, group, file=file, where=where)
    attrs, blocks, start, last = next(read), [], 0, -np.inf
    for arrays in read:
        blocks.append(block := TickBlock(*arrays))
        _check_values(block, start, last, where)
        start, last = start + len(block), block.time[-1]
    file.require_unchanged()
    if not blocks:
        raise InputError("a result without ticks", where=where)
    return joined(blocks), attrs


def _found(path: str | Path) -> OneFile:
    try:
        return OneFile(Path(path))
    except InputError as error:
        message = f"{error.message}; a result of `vfplan replay -o` wanted"
        raise InputError(message, where=Path(path).name) from None


def stored(stream: BinaryIO, where: str, group: str) -> Iterator[Any]:
    """A result's root attributes, then blocks of its datasets, in the order of `TickBlock`.

    In a process apart (`vfplan.io.apart`): a file can be made for libhdf5 to crash on.
    """
    with opened_hdf5(stream, where, InputError) as file:
        attrs = {name: _plain(value) for name, value in file.attrs.items()}
        _check_head(attrs, where)
        yield attrs
        if group and not isinstance(file.get(group, getlink=True), h5py.HardLink):
            raise InputError(f"has no group {group!r}", where=where)
        place = file[group] if group else file
        datasets = _checked(place, where)
        for start in range(0, len(datasets[0]), BLOCK):
            yield tuple(dataset[start : start + BLOCK] for dataset in datasets)


def _check_values(block: TickBlock, start: int, last: float, where: str) -> None:
    """Refuse values that no replay gives: drawn, they would be a picture of something else."""
    for name in TABLE:
        rows = getattr(block, name).reshape(len(block), -1)
        good = np.isin(rows, STATES) if name == "state" else np.abs(rows) <= LARGEST
        bad = np.flatnonzero(~good.all(axis=1))  # NaN fails too
        if len(bad):
            found = rows[bad[0]].tolist()
            allowed = "-1, 0, 1 or 2" if name == "state" else f"finite numbers up to {LARGEST:g}"
            raise InputError(
                f"{name} of tick {start + bad[0]} is {found}; {allowed} wanted", where=where
            )
    stuck = np.flatnonzero(~(np.diff(block.time, prepend=last) > 0))
    if len(stuck):
        raise InputError(f"time does not increase at tick {start + stuck[0]}", where=where)


def require_fixture(attrs: dict[str, Any], sha256: str, where: str) -> None:
    """Check that a result was made with a bundle.

    Parameters
    ----------
    attrs
        The result's root attributes. One that names no bundle was replayed from arrays: it passes.
    sha256
        The bundle's digest, hexadecimal.
    where
        The result's name.

    Raises
    ------
    InputError
        Another digest.
    """
    try:
        made_with = str(json.loads(attrs.get("fixture", "{}")).get("sha256", sha256))
    except (ValueError, TypeError, AttributeError):
        raise InputError("attribute fixture is no record of a fixture", where=where) from None
    if made_with != sha256:
        raise InputError(
            f"was replayed against the fixture with SHA-256 {made_with[:12]}..., this one has "
            f"{sha256[:12]}...; the same fixture wanted",
            where=where,
        )


def _plain(value: Any) -> Any:
    value = value.tolist() if hasattr(value, "tolist") else value
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _check_head(attrs: dict[str, Any], where: str) -> None:
    found, version = attrs.get("format"), str(attrs.get("version"))
    if found != RESULT_FORMAT:
        raise InputError(f"format is {found!r}; {RESULT_FORMAT!r} wanted", where=where)
    if version.partition(".")[0] != RESULT_VERSION.partition(".")[0]:
        raise VersionError(
            f"result version {version}; this program reads {RESULT_VERSION}", where=where
        )


def _checked(place: h5py.Group, where: str) -> list[h5py.Dataset]:
    """The datasets of `TABLE`, in its order."""
    datasets = [plain_dataset(place, name, where, TABLE, InputError) for name in TABLE]
    for dataset, (name, (columns, _, _)) in zip(datasets, TABLE.items(), strict=True):
        if dataset.shape != (*datasets[0].shape[:1], *columns):
            wanted = ", ".join(map(str, ("T", *columns)))
            raise InputError(f"{name} has shape {dataset.shape}; ({wanted}) wanted", where=where)
        if dataset.dtype.kind not in "fiu":
            raise InputError(f"{name} has type {dataset.dtype}; real numbers wanted", where=where)
    return datasets
