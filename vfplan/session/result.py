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
from vfplan.io.files import OpenedFile
from vfplan.io.hdf5 import h5py
from vfplan.io.sandbox import run_in_sandbox
from vfplan.session.arrays import opened_hdf5, plain_attribute, plain_dataset
from vfplan.session.session import BLOCK, MAX_TIME_S, Array

# A dataclass of arrays, a row a tick.
Ticks = TypeVar("Ticks")

RESULT_FORMAT = "vfplan-result"
RESULT_VERSION = "1.0"

# Dataset -> (shape of a row, type, unit)
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


class Result(Protocol):
    """What `write_result` writes; a `Replay` is one."""

    @property
    def ticks(self) -> TickBlock:
        """One row a tick."""

    @property
    def record(self) -> dict[str, Any]:
        """The root attributes."""


def concatenate_ticks(blocks: Sequence[Ticks]) -> Ticks:
    """Blocks, or traces of an engine, one after the other, as one."""
    columns = []
    for field in fields(blocks[0]):  # type: ignore[arg-type]
        columns.append(np.concatenate([getattr(block, field.name) for block in blocks]))
    return type(blocks[0])(*columns)


def select_ticks(block: Ticks, rows: slice | NDArray[np.intp]) -> Ticks:
    """These ticks of a block, or of an engine's trace."""
    columns = []
    for field in fields(block):  # type: ignore[arg-type]
        columns.append(getattr(block, field.name)[rows])
    return type(block)(*columns)


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
    where = Path(path).name
    try:
        file = OpenedFile(Path(path))
    except InputError as error:
        error.message += ", or give a result of `vfplan replay -o`"
        error.where = where
        raise
    answers = run_in_sandbox(
        "vfplan.session.result:stored_ticks", where, group, file=file, where=where
    )
    attrs = next(answers)
    blocks: list[TickBlock] = []
    count = 0
    last_time = -np.inf
    for arrays in answers:
        block = TickBlock(*arrays)
        check_values(block, count, last_time, where)
        blocks.append(block)
        count += len(block)
        last_time = block.time[-1]
    file.require_unchanged()
    if not blocks:
        raise InputError(
            "the result holds no ticks. Replay a session that has some",
            where=where,
            code="result-empty",
        )
    return concatenate_ticks(blocks), attrs


def stored_ticks(stream: BinaryIO, where: str, group: str) -> Iterator[Any]:
    """A result's root attributes, then blocks of its datasets, in the order of `TickBlock`.

    Runs in the sandbox (`vfplan.io.sandbox`): a crafted file can crash libhdf5.
    """
    with opened_hdf5(stream, where, InputError) as file:
        attrs = {name: plain_attribute(value) for name, value in file.attrs.items()}
        if attrs.get("format") != RESULT_FORMAT:
            raise InputError(
                f"format is {attrs.get('format')!r}, not {RESULT_FORMAT!r}. Give a result of "
                "vfplan replay",
                where=where,
                code="not-a-result",
            )
        version = str(attrs.get("version"))
        if version.partition(".")[0] != RESULT_VERSION.partition(".")[0]:
            raise VersionError(
                f"the result is of version {version}, and this program reads "
                f"{RESULT_VERSION}. Replay the session again",
                where=where,
            )
        yield attrs

        place: h5py.Group = file
        if group:
            if not isinstance(file.get(group, getlink=True), h5py.HardLink):
                raise InputError(
                    f"has no group {group!r}. Replay the session again",
                    where=where,
                    code="group-missing",
                )
            place = file[group]
        datasets = []
        for name, (columns, _, _) in TABLE.items():
            dataset = plain_dataset(place, name, where, TABLE, InputError)
            datasets.append(dataset)
            if dataset.shape != (*datasets[0].shape[:1], *columns):
                wanted = ", ".join(map(str, ("T", *columns)))
                raise InputError(
                    f"{name} has shape {dataset.shape}, not ({wanted}). Replay the session again",
                    where=where,
                    code="shape-wrong",
                )
            if dataset.dtype.kind not in "fiu":
                raise InputError(
                    f"{name} has type {dataset.dtype}, and no real numbers. Replay the "
                    "session again",
                    where=where,
                    code="type-wrong",
                )
        for start in range(0, len(datasets[0]), BLOCK):
            yield tuple(dataset[start : start + BLOCK] for dataset in datasets)


def check_values(block: TickBlock, first: int, last_time: float, where: str) -> None:
    """Refuse values that no replay gives, because a picture of them would show something else.

    first: number of the block's first tick
    last_time: time of the tick before it [s]
    """
    for name in TABLE:
        rows = getattr(block, name).reshape(len(block), -1)
        if name == "state":
            good = np.isin(rows, STATES)
            allowed = "-1, 0, 1 or 2"
        else:
            # NaN is not <= anything, so it is not good either. Squares of the limit are finite.
            good = np.abs(rows) <= MAX_TIME_S
            allowed = f"finite numbers up to {MAX_TIME_S:g}"
        good = good.all(axis=1)
        if not good.all():
            bad = int(np.argmin(good))
            raise InputError(
                f"{name} of tick {first + bad} is {rows[bad].tolist()}, and only {allowed} "
                "can be. Replay the session again",
                where=where,
                code="value-invalid",
                numbers={"tick": first + bad},
            )
    increases = np.diff(block.time, prepend=last_time) > 0
    if not increases.all():
        tick = first + int(np.argmin(increases))
        raise InputError(
            f"time does not increase at tick {tick}. Replay the session again",
            where=where,
            code="time-not-increasing",
            numbers={"tick": tick},
        )


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
        raise InputError(
            "attribute fixture is no record of a fixture. Replay the session again",
            where=where,
            code="record-broken",
        ) from None
    if made_with != sha256:
        raise InputError(
            f"was replayed against the fixture with SHA-256 {made_with[:12]}..., and this "
            f"one has {sha256[:12]}.... Give the same fixture",
            where=where,
            code="fixture-differs",
        )
