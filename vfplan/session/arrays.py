"""Sessions as `time` (T,) and `hip` (T, 3): in HDF5, and in NumPy's `.npz`."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import IO, Any, BinaryIO

import numpy as np

from vfplan.errors import InputError, SessionError
from vfplan.io.hdf5 import h5py
from vfplan.io.npy import npy_header
from vfplan.session.types import BLOCK, Array, Pair

_NAMES = ("time", "hip")


def _check_shapes(time: Any, hip: Any, where: str) -> int:
    """The length T; raises `SessionError` unless time is (T,) and hip (T, 3), both real numbers."""
    if len(time[0]) != 1 or tuple(hip[0]) != (*time[0], 3):
        raise SessionError(
            f"time has shape {tuple(time[0])} and hip {tuple(hip[0])}; (T,) and (T, 3) wanted",
            where=where,
        )
    for name, (_, dtype) in zip(_NAMES, (time, hip), strict=True):
        if dtype.kind not in "fiu":
            raise SessionError(f"{name} has type {dtype}; real numbers wanted", where=where)
    return int(time[0][0])


@contextmanager
def opened_hdf5(
    stream: BinaryIO, name: str, kind: type[InputError] = SessionError
) -> Iterator[h5py.File]:
    """The file; what libhdf5 says of a bad one is an error of the `kind` given."""
    try:
        with h5py.File(stream, "r") as file:
            yield file
    except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:
        raise kind(f"cannot be read as HDF5: {error}", where=name) from None


# What follows runs in a process apart (`vfplan.io.apart`): a file can be made for libhdf5 to crash
# on, or to unpack without end.


def hdf5_header(stream: BinaryIO, name: str) -> Iterator[list[Any]]:
    """The length T, and what the file states of itself.

    Yields T, and (what, value, where it stands): "units" or "frame" of the root or of `hip`, "time
        unit" of `time`. Attributes `unit` and `units` mean the same.
    Raises SessionError: not HDF5, a dataset missing, or wrong shapes or types
    """
    with opened_hdf5(stream, name) as file:
        pair = [plain_dataset(file, wanted, name) for wanted in _NAMES]
        length = _check_shapes(*((d.shape, d.dtype) for d in pair), where=name)
        stated = [
            *_stated(file, {"units": "units", "unit": "units", "frame": "frame"}),
            *_stated(pair[1], {"units": "units", "unit": "units", "frame": "frame"}),
            *_stated(pair[0], {"units": "time unit", "unit": "time unit"}),
        ]
    yield [length, stated]


def _stated(place: h5py.Group | h5py.Dataset, names: dict[str, str]) -> list[tuple[str, str, str]]:
    found = []
    for name, meaning in names.items():
        if name in place.attrs:
            value = place.attrs[name]
            # HDF5 holds text of fixed and of variable length; h5py gives bytes and str.
            text = value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
            found.append((meaning, text, f"attribute {name} of {place.name}"))
    return found


def plain_dataset(
    file: h5py.Group, name: str, where: str, names: Iterable[str] = _NAMES,
    kind: type[InputError] = SessionError,
) -> h5py.Dataset:  # fmt: skip
    """One of the datasets wanted, which the file itself holds; else an error of the `kind`."""
    wanted = f"{', '.join(names)} wanted"
    # A link to another file is never followed: a session is one file.
    if not isinstance(file.get(name, getlink=True), h5py.HardLink):
        held = ", ".join(sorted(file)) or "nothing"
        raise kind(f"has no dataset {name!r} (holds {held[:80]}); {wanted}", where=where)
    found = file[name]
    plain = isinstance(found, h5py.Dataset) and found.shape is not None
    if not plain or found.external or found.is_virtual:
        raise kind(f"{name!r} is not a plain dataset; {wanted}", where=where)
    return found


def read_hdf5(stream: BinaryIO, name: str, factor: float) -> Iterator[Pair]:
    """Yield (time [s], hip [m]) piece by piece."""
    with opened_hdf5(stream, name) as file:
        time, hip = (plain_dataset(file, wanted, name) for wanted in _NAMES)
        for start in range(0, len(time), BLOCK):
            part = slice(start, start + BLOCK)
            yield np.asarray(time[part], float), np.asarray(hip[part], float) * factor


def npz_header(stream: BinaryIO, name: str) -> Iterator[list[Any]]:
    """As `hdf5_header`; an archive states nothing of itself."""
    with _npz_members(stream, name) as members:
        yield [_check_shapes(*(member[1:] for member in members), where=name), []]


def read_npz(stream: BinaryIO, name: str, factor: float) -> Iterator[Pair]:
    """Yield (time [s], hip [m]) piece by piece, without ever holding the arrays whole."""
    with _npz_members(stream, name) as ((time, shape, time_type), (hip, _, hip_type)):
        for start in range(0, shape[0], BLOCK):
            rows = min(BLOCK, shape[0] - start)
            yield (
                _values(time, rows, time_type, name),
                _values(hip, rows * 3, hip_type, name).reshape(-1, 3) * factor,
            )


@contextmanager
def _npz_members(
    stream: BinaryIO, where: str
) -> Iterator[tuple[tuple[IO[bytes], tuple[int, ...], np.dtype], ...]]:
    try:
        with zipfile.ZipFile(stream) as archive:
            names = set(archive.namelist())
            for name in _NAMES:
                if f"{name}.npy" not in names:
                    held = ", ".join(sorted(n.removesuffix(".npy") for n in names)) or "nothing"
                    raise SessionError(
                        f"has no array {name!r} (holds {held[:80]}); time, hip wanted", where=where
                    )
            yield tuple(_member(archive.open(f"{name}.npy"), name, where) for name in _NAMES)
    except (SessionError, MemoryError, GeneratorExit):
        raise
    except Exception as error:  # zipfile lets through what its decompressors raise, NumPy tokenize
        raise SessionError(f"cannot be read as .npz: {error}", where=where) from None


def _member(
    stream: IO[bytes], name: str, where: str
) -> tuple[IO[bytes], tuple[int, ...], np.dtype]:
    try:
        shape, fortran, dtype = npy_header(stream)
    except ValueError as error:
        raise SessionError(f"cannot be read as .npz: {name}: {error}", where=where) from None
    if fortran and len(shape) > 1:
        raise SessionError(f"{name} is stored by columns; C order wanted", where=where)
    return stream, shape, dtype


def _values(stream: IO[bytes], count: int, dtype: np.dtype, where: str) -> Array:
    data = stream.read(count * dtype.itemsize)
    if len(data) != count * dtype.itemsize:
        raise SessionError("ends before its last sample", where=where)
    return np.frombuffer(data, dtype).astype(np.float64)
