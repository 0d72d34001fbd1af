"""Sessions as `time` (T,) and `hip` (T, 3): in HDF5, and in NumPy's `.npz`."""

from __future__ import annotations

import io
import lzma
import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any, BinaryIO

import numpy as np

from vfplan.errors import SessionError
from vfplan.io.hdf5 import h5py
from vfplan.io.reading import OneFile
from vfplan.session.types import BLOCK, Array, Pair

_NAMES = ("time", "hip")
MOST_MEMBERS, MOST_TAIL = 1000, 1 << 17  # of an archive; bytes at its end that list them
MOST_HEADER = 10_000  # bytes of an array's header, as NumPy has it
# What zipfile, its decompressors and NumPy's header reader raise on damaged archives.
_DAMAGED = (
    OSError,
    EOFError,
    ValueError,
    SyntaxError,
    RuntimeError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    tokenize.TokenError,
)


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
def opened_hdf5(stream: BinaryIO, name: str) -> Iterator[h5py.File]:
    """The file; what libhdf5 says of a bad one is a `SessionError`."""
    try:
        with h5py.File(stream, "r") as file:
            yield file
    except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:
        raise SessionError(f"cannot be read as HDF5: {error}", where=name) from None


# Both run in a process apart (`vfplan.io.apart`): a file can be made for libhdf5 to crash on.


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
    file: h5py.File, name: str, where: str, wanted: str = "time, hip"
) -> h5py.Dataset:
    """A dataset that the file itself holds; else `SessionError`."""
    # A link to another file is never followed: a session is one file.
    if not isinstance(file.get(name, getlink=True), h5py.HardLink):
        held = ", ".join(sorted(file)) or "nothing"
        raise SessionError(
            f"has no dataset {name!r} (holds {held[:80]}); {wanted} wanted", where=where
        )
    found = file[name]
    plain = isinstance(found, h5py.Dataset) and found.shape is not None
    if not plain or found.external or found.is_virtual:
        raise SessionError(f"{name!r} is not a plain dataset; {wanted} wanted", where=where)
    return found


def read_hdf5(stream: BinaryIO, name: str, factor: float) -> Iterator[Pair]:
    """Yield (time [s], hip [m]) piece by piece."""
    with opened_hdf5(stream, name) as file:
        time, hip = (plain_dataset(file, wanted, name) for wanted in _NAMES)
        for start in range(0, len(time), BLOCK):
            part = slice(start, start + BLOCK)
            yield np.asarray(time[part], float), np.asarray(hip[part], float) * factor


def npz_header(file: OneFile, name: str) -> int:
    """The length T; raises `SessionError` as `hdf5_header` does."""
    with _npz_members(file, name) as members:
        heads = [(shape, dtype) for _, shape, dtype in members]
        return _check_shapes(*heads, where=name)


def read_npz(file: OneFile, name: str, factor: float) -> Iterator[Pair]:
    """Yield (time [s], hip [m]) piece by piece, without ever holding the arrays whole."""
    with _npz_members(file, name) as ((time, shape, time_type), (hip, _, hip_type)):
        for start in range(0, shape[0], BLOCK):
            rows = min(BLOCK, shape[0] - start)
            yield (
                _values(time, rows, time_type, name),
                _values(hip, rows * 3, hip_type, name).reshape(-1, 3) * factor,
            )


@contextmanager
def _npz_members(
    file: OneFile, where: str
) -> Iterator[tuple[tuple[IO[bytes], tuple[int, ...], np.dtype], ...]]:
    try:
        with file.view() as stream:
            _refuse_many(stream, where)
            with zipfile.ZipFile(stream) as archive:
                names = set(archive.namelist())
                for name in _NAMES:
                    if f"{name}.npy" not in names:
                        held = ", ".join(sorted(n.removesuffix(".npy") for n in names)) or "nothing"
                        raise SessionError(
                            f"has no array {name!r} (holds {held[:80]}); time, hip wanted",
                            where=where,
                        )
                yield tuple(_member(archive.open(f"{name}.npy"), name, where) for name in _NAMES)
    except _DAMAGED as error:
        raise SessionError(f"cannot be read as .npz: {error}", where=where) from None


def _refuse_many(stream: BinaryIO, where: str) -> None:
    """Refuse an archive whose list of members is long: zipfile reads all of it into memory."""
    stream.seek(max(0, stream.seek(0, os.SEEK_END) - MOST_TAIL))
    tail = stream.read(MOST_TAIL)
    end = tail.rfind(b"PK\x05\x06")
    count, size = (
        struct.unpack_from("<HI", tail, end + 10) if 0 <= end <= len(tail) - 22 else (0, 0)
    )
    if count > MOST_MEMBERS or size > MOST_TAIL:
        raise SessionError(f"more than {MOST_MEMBERS} members; time, hip wanted", where=where)


def _member(
    stream: IO[bytes], name: str, where: str
) -> tuple[IO[bytes], tuple[int, ...], np.dtype]:
    version = np.lib.format.read_magic(stream)
    form = {(1, 0): "<H", (2, 0): "<I"}.get(version)
    if form is None:
        raise SessionError(f"{name} is in .npy version {version}; 1.0 or 2.0 wanted", where=where)
    # The length is checked here: NumPy would first read as much as it says.
    size = stream.read(struct.calcsize(form))
    if struct.unpack(form, size)[0] > MOST_HEADER:
        raise SessionError(f"the header of {name} is longer than {MOST_HEADER} bytes", where=where)
    head = io.BytesIO(size + stream.read(struct.unpack(form, size)[0]))
    reads = (np.lib.format.read_array_header_1_0, np.lib.format.read_array_header_2_0)
    shape, fortran, dtype = reads[version[0] - 1](head)
    if fortran and len(shape) > 1:
        raise SessionError(f"{name} is stored by columns; C order wanted", where=where)
    return stream, shape, dtype


def _values(stream: IO[bytes], count: int, dtype: np.dtype, where: str) -> Array:
    data = stream.read(count * dtype.itemsize)
    if len(data) != count * dtype.itemsize:
        raise SessionError("ends before its last sample", where=where)
    return np.frombuffer(data, dtype).astype(np.float64)
