"""Read bundles of the versions 0.1, 1.0 and 1.1, for `vfplan migrate` alone.

Version 0.1 had no seal; 1.0 and 1.1 had it in front of the HDF5 file. Their datasets are stored in
chunks, which the reader of 2.0 does not know, so libhdf5 reads them. What somebody else wrote can
crash it: `old_content` therefore runs in a process apart (`vfplan.io.sandbox`). Whatever it lets
through is judged once more by the reader of 2.0, when the new bundle is written.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np

from vfplan.bundle.schema import FORMAT, OLDER, Content, Row, document, table
from vfplan.bundle.seal import HDF5_MAGIC, LENGTHS, MAGIC
from vfplan.errors import CorruptError, UnsafeError, VersionError
from vfplan.io.hdf5 import h5py


def old_content(stream: BinaryIO) -> Iterator[Any]:
    """Yield what an old bundle holds: first its head, then its tables of numbers one by one.

    The head is a dict: `version`; `sha256` of the file; `signed_by`, a key id or `None`; `values`,
    the attributes and texts by path; `tables`, the paths of the tables that follow, in order.

    Raises
    ------
    CorruptError
        It is no bundle, or not as it was written.
    UnsafeError
        It holds something that no bundle holds.
    VersionError
        It is of another version.
    """
    most = document(OLDER)["limits"]["payload_bytes"] + LENGTHS[-1]
    data = stream.read(most + 1)
    if len(data) > most:
        raise UnsafeError("is longer than a bundle may be.", code="unsafe.cap")
    payload, signed_by = _unsealed(data)
    with _opened(payload) as file:
        version = _version(file, is_sealed=len(payload) < len(data))
        rows = {row.path: row for row in table(OLDER) if _number(row.since) <= _number(version)}
        _require_known(file, rows)
        values: Content = {}
        tables = []
        for path, row in rows.items():
            if row.kind == "attribute":
                if row.parent in file and row.name in file[row.parent].attrs:
                    values[path] = _plain(file[row.parent].attrs[row.name], row)
            elif row.kind == "dataset" and path in file:
                if row.type == "text":
                    values[path] = [_text(item, row) for item in _numbers(file[path], row)]
                else:
                    tables.append(path)
        yield {
            "version": version,
            "sha256": hashlib.sha256(data).hexdigest(),
            "signed_by": signed_by,
            "values": values,
            "tables": tables,
        }
        for path in tables:
            yield (_numbers(file[path], rows[path]),)


def _unsealed(data: bytes) -> tuple[bytes, str | None]:
    """The HDF5 file of an old bundle, and the key id of who signed it.

    Of a seal in front the two digests are checked, as the readers of its time did. The signature
    itself is not: it does not count for the new bundle, whose bytes are others.
    """
    if not data.startswith(MAGIC):
        if data.startswith(HDF5_MAGIC):
            return data, None
        raise CorruptError("is no fixture bundle.", code="corrupt.seal")
    version, flags, length, payload_length = struct.unpack_from("<HHIQ", data.ljust(24, b"\0"), 8)
    if version != 1:
        raise VersionError(f"has seal version {version} in front; 1 is known.", code="version.seal")
    if length not in LENGTHS or len(data) != length + payload_length:
        raise CorruptError("was cut or grown: its seal says another length.", code="corrupt.seal")
    block, payload = data[:length], data[length:]
    if hashlib.sha256(block[:-32]).digest() != block[-32:]:
        raise CorruptError("the seal itself is damaged: its SHA-256 differs.", code="corrupt.seal")
    if hashlib.sha256(payload).digest() != block[24:56]:
        raise CorruptError("SHA-256 differs from the sealed one.", code="corrupt.seal")
    signed_by = block[56:72].hex() if flags & 1 else None
    return payload, signed_by


def _opened(payload: bytes) -> Any:
    import io

    try:
        return h5py.File(io.BytesIO(payload), "r")
    except (OSError, RuntimeError, ValueError) as error:
        raise CorruptError(f"cannot be read as HDF5: {error}.", code="corrupt.hdf5") from None


def _version(file: Any, *, is_sealed: bool) -> str:
    """The version, which fits to there being a seal or not.

    Nobody removes the seal of a later version to bring it in as an old one.
    """
    texts = {}
    for name in ("format", "version"):
        value = file.attrs.get(name)
        texts[name] = value.decode("ascii", "replace") if isinstance(value, bytes) else ""
    if texts["format"] != FORMAT:
        raise CorruptError("is no fixture bundle.", where="/@format", code="corrupt.format")
    version = texts["version"]
    known = ("1.0", "1.1") if is_sealed else ("0.1",)
    if version in known:
        return version
    if is_sealed:
        raise VersionError(
            f"version {version!r} under the seal of versions 1.0 and 1.1.",
            where="/@version",
            code="version.major",
        )
    raise CorruptError(
        f"its seal is missing, and version {version!r} has one: the file was cut, or opened for "
        "writing by another program. Migrate the file as it was first written.",
        where="/@version",
        code="corrupt.seal",
    )


def _number(version: str) -> tuple[int, ...]:
    return tuple(map(int, version.split(".")))


def _require_known(file: Any, rows: dict[str, Row]) -> None:
    """Refuse what the version's table does not name, and what leads out of the file."""
    groups = [path for path, row in rows.items() if row.kind == "group"]
    for group in groups:
        if group not in file:
            continue
        for name in file[group]:
            path = f"{group.rstrip('/')}/{name}"
            link = file[group].get(name, getlink=True)
            if not isinstance(link, h5py.HardLink):
                raise UnsafeError("is a link that is not hard.", where=path, code="unsafe.link")
            if path not in rows:
                raise UnsafeError(
                    f"holds {name!r}, which its version lacks.", where=group, code="unsafe.unknown"
                )
        for name in file[group].attrs:
            if f"{group}@{name}" not in rows:
                raise UnsafeError(
                    f"holds {name!r}, which its version lacks.", where=group, code="unsafe.unknown"
                )


def _numbers(dataset: Any, row: Row) -> np.ndarray:
    """A dataset's values, after its kind, type and size were compared with its row."""
    is_plain = isinstance(dataset, h5py.Dataset) and dataset.shape is not None
    if not is_plain or dataset.external or dataset.is_virtual:
        raise UnsafeError("is no plain dataset.", where=row.path, code="unsafe.layout")
    kind = dataset.dtype.kind if row.type == "text" else dataset.dtype.str.lstrip("<|")
    if kind != ("S" if row.type == "text" else row.type):
        raise CorruptError(f"has type {dataset.dtype}.", where=row.path, code="corrupt.type")
    sizes, limits = document(OLDER)["sizes"], document(OLDER)["limits"]
    if len(dataset.shape) != len(row.shape) or dataset.dtype.itemsize > limits["text_bytes"]:
        raise CorruptError(f"has shape {dataset.shape}.", where=row.path, code="corrupt.shape")
    for side, wanted in zip(dataset.shape, row.shape, strict=True):
        cap = sizes[wanted]["max"] if isinstance(wanted, str) else wanted
        if not 1 <= side <= cap:
            raise UnsafeError(f"has shape {dataset.shape}.", where=row.path, code="unsafe.cap")
    return np.asarray(dataset[...])


def _plain(value: Any, row: Row) -> Any:
    """An attribute as JSON holds it."""
    if row.type == "text" and isinstance(value, bytes):
        return _text(value, row)
    if row.type != "text" and isinstance(value, np.generic) and value.dtype.str[1:] == row.type:
        return value.item()
    raise CorruptError("has another type.", where=row.path, code="corrupt.type")


def _text(value: bytes, row: Row) -> str:
    try:
        return value.decode()
    except UnicodeDecodeError:
        raise CorruptError("is not UTF-8.", where=row.path, code="corrupt.text") from None
