"""Sessions as `time` (T,) and `hip` (T, 3): in HDF5, and in NumPy's `.npz`.

The generator functions run in the sandbox (`vfplan.io.sandbox`): a crafted file can crash libhdf5,
or unpack without end.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import IO, Any, BinaryIO

import numpy as np

from vfplan.errors import InputError, SessionError
from vfplan.io.hdf5 import h5py
from vfplan.io.npy import npy_header
from vfplan.session.session import BLOCK, Array, Samples

NAMES = ("time", "hip")
FIXTURE_FORMAT = "vfplan-fixture"
"""The attribute `format` of a fixture bundle."""


def hdf5_header(stream: BinaryIO, name: str) -> Iterator[list[Any]]:
    """The length T, and what the file's attributes state.

    Yields T, and a list of (what, value, place). "units" and "frame" are attributes of the root or
        of `hip`, "time unit" is one of `time`. Attributes `unit` and `units` mean the same.
    Raises SessionError: not HDF5, a dataset missing, or wrong shapes or types
    """
    with opened_hdf5(stream, name) as file:
        if "time" not in file and plain_attribute(file.attrs.get("format")) == FIXTURE_FORMAT:
            raise SessionError(
                "is a fixture, not a recording of positions. Give the fixture first, and the "
                "recording after it",
                where=name,
                code="fixture-as-session",
            )
        time = plain_dataset(file, "time", name)
        hip = plain_dataset(file, "hip", name)
        length = _check_shapes(time, hip, name)
        statements = []
        for place in (file, hip, time):
            for attribute in ("units", "unit", "frame"):
                if attribute not in place.attrs or (place is time and attribute == "frame"):
                    continue
                meaning = "units"
                if attribute == "frame":
                    meaning = "frame"
                elif place is time:
                    meaning = "time unit"
                text = plain_attribute(place.attrs[attribute])
                statements.append((meaning, str(text), f"attribute {attribute} of {place.name}"))
    yield [length, statements]


def read_hdf5(stream: BinaryIO, name: str, factor: float) -> Iterator[Samples]:
    """Yield (time [s], hip [m]) a block at a time."""
    with opened_hdf5(stream, name) as file:
        time = plain_dataset(file, "time", name)
        hip = plain_dataset(file, "hip", name)
        for start in range(0, len(time), BLOCK):
            rows = slice(start, start + BLOCK)
            yield np.asarray(time[rows], float), np.asarray(hip[rows], float) * factor


def npz_header(stream: BinaryIO, name: str) -> Iterator[list[Any]]:
    """As `hdf5_header`; an archive has no attributes."""
    with _npz_members(stream, name) as (time, hip):
        yield [_check_shapes(time, hip, name), []]


def read_npz(stream: BinaryIO, name: str, factor: float) -> Iterator[Samples]:
    """Yield (time [s], hip [m]) a block at a time, without ever holding the arrays whole."""
    with _npz_members(stream, name) as (time, hip):
        length = time.shape[0]
        for start in range(0, length, BLOCK):
            count = min(BLOCK, length - start)
            block_hip = hip.read_numbers(3 * count).reshape(-1, 3)
            yield time.read_numbers(count), block_hip * factor


@contextmanager
def opened_hdf5(
    stream: BinaryIO, name: str, kind: type[InputError] = SessionError
) -> Iterator[h5py.File]:
    """An open HDF5 file; errors of libhdf5 inside become errors of the `kind` given."""
    try:
        with h5py.File(stream, "r") as file:
            yield file
    except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:
        raise kind(
            f"cannot be read as HDF5: {error}. Write the file again", where=name, code="hdf5-broken"
        ) from None


def plain_dataset(
    file: h5py.Group,
    name: str,
    where: str,
    names: Iterable[str] = NAMES,
    kind: type[InputError] = SessionError,
) -> h5py.Dataset:
    """The dataset of that name; `names` are all that are wanted, for the message.

    Raises an error of the `kind` given: there is none, or its data are in another file
    """
    wanted = f"Give {', '.join(names)}"
    # A link to another file is never followed: a session is one file.
    if not isinstance(file.get(name, getlink=True), h5py.HardLink):
        present = ", ".join(sorted(file)) or "nothing"
        raise kind(
            f"has no dataset {name!r} (it holds {present[:80]}). {wanted}",
            where=where,
            code="dataset-missing",
        )
    dataset = file[name]
    is_plain = isinstance(dataset, h5py.Dataset) and dataset.shape is not None
    if not is_plain or dataset.external or dataset.is_virtual:
        raise kind(f"{name!r} is not a plain dataset. {wanted}", where=where, code="dataset-odd")
    return dataset


def plain_attribute(value: Any) -> Any:
    """An attribute's value in Python's types. h5py gives text of fixed length as bytes."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _check_shapes(time: Any, hip: Any, where: str) -> int:
    """The length T; raises `SessionError` unless time is (T,) and hip (T, 3), both real numbers."""
    if len(time.shape) != 1 or tuple(hip.shape) != (*time.shape, 3):
        raise SessionError(
            f"time has shape {tuple(time.shape)} and hip {tuple(hip.shape)}. Give (T,) and (T, 3)",
            where=where,
            code="shape-wrong",
        )
    for name, array in (("time", time), ("hip", hip)):
        if array.dtype.kind not in "fiu":
            raise SessionError(
                f"{name} has type {array.dtype}. Give real numbers",
                where=where,
                code="type-wrong",
            )
    return int(time.shape[0])


class _NpzMember:
    """One array of an archive, read from its beginning on."""

    def __init__(self, stream: IO[bytes], name: str, where: str) -> None:
        try:
            self.shape, by_columns, self.dtype = npy_header(stream)
        except ValueError as error:
            raise SessionError(
                f"cannot be read as .npz: {name}: {error}. Save the arrays again",
                where=where,
                code="npz-broken",
            ) from None
        if by_columns and len(self.shape) > 1:
            raise SessionError(
                f"{name} is stored by columns. Save it in C order", where=where, code="order-wrong"
            )
        self._stream = stream
        self._where = where

    def read_numbers(self, count: int) -> Array:
        """The next `count` numbers."""
        size = count * self.dtype.itemsize
        data = self._stream.read(size)
        if len(data) != size:
            raise SessionError(
                "ends before its last sample. Copy the file again",
                where=self._where,
                code="file-cut",
            )
        return np.frombuffer(data, self.dtype).astype(np.float64)


@contextmanager
def _npz_members(stream: BinaryIO, where: str) -> Iterator[tuple[_NpzMember, _NpzMember]]:
    try:
        with zipfile.ZipFile(stream) as archive:
            present = sorted(name.removesuffix(".npy") for name in archive.namelist())
            for name in NAMES:
                if name not in present:
                    raise SessionError(
                        f"has no array {name!r} (it holds "
                        f"{', '.join(present)[:80] or 'nothing'}). Save time and hip",
                        where=where,
                        code="dataset-missing",
                    )
            time = _NpzMember(archive.open("time.npy"), "time", where)
            yield time, _NpzMember(archive.open("hip.npy"), "hip", where)
    except (SessionError, MemoryError, GeneratorExit):
        raise
    except Exception as error:
        # The modules zipfile and numpy pass on what decompressors and the tokenizer raise.
        raise SessionError(
            f"cannot be read as .npz: {error}. Save the arrays again",
            where=where,
            code="npz-broken",
        ) from None
