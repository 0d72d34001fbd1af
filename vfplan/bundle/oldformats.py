"""Read bundles of the versions 0.1, 1.0 and 1.1, for `vfplan migrate` alone.

Version 0.1 had no seal; 1.0 and 1.1 had it in front of the HDF5 file. Their datasets are stored in
chunks, which the reader of 2.0 does not know, so libhdf5 reads them. What somebody else wrote can
crash it: `old_content` therefore runs in a process apart (`vfplan.io.sandbox`). Whatever it lets
through is judged once more by the reader of 2.0, when the new bundle is written.
"""

from __future__ import annotations

import hashlib
import io
import struct
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np

from vfplan.bundle.content import FORMAT, OLDER, Content, Row, document, table
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
    max_bytes = document(OLDER)["limits"]["payload_bytes"] + LENGTHS[-1]
    data = stream.read(max_bytes + 1)
    if len(data) > max_bytes:
        raise UnsafeError(
            "is longer than a bundle may be. Migrate the original file.", code="unsafe.cap"
        )
    payload, signed_by = unsealed_payload(data)
    try:
        file = h5py.File(io.BytesIO(payload), "r")
    except (OSError, RuntimeError, ValueError) as error:
        raise CorruptError(
            f"cannot be read as HDF5: {error}. Migrate the original file.", code="corrupt.hdf5"
        ) from None
    with file:
        version = version_of(file, is_sealed=len(payload) < len(data))
        rows = {}
        for row in table(OLDER):
            if version_number(row.since) <= version_number(version):
                rows[row.path] = row
        check_names(file, rows)
        values: Content = {}
        tables = []
        for path, row in rows.items():
            if row.kind == "attribute":
                if row.parent in file and row.name in file[row.parent].attrs:
                    values[path] = attribute_value(file[row.parent].attrs[row.name], row)
            elif row.kind == "dataset" and path in file:
                if row.type == "text":
                    values[path] = [decoded(text, row) for text in dataset_values(file[path], row)]
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
            yield (dataset_values(file[path], rows[path]),)


def unsealed_payload(data: bytes) -> tuple[bytes, str | None]:
    """The HDF5 file of an old bundle, and the key id of who signed it.

    Of a seal in front the two digests are checked, as the readers of its time did. The signature
    itself is not: it does not count for the new bundle, whose bytes are others.
    """
    if data.startswith(HDF5_MAGIC):
        return data, None
    if not data.startswith(MAGIC):
        raise CorruptError("is no fixture bundle. Give one.", code="corrupt.seal")
    version, flags, length, payload_length = struct.unpack_from("<HHIQ", data.ljust(24, b"\0"), 8)
    if version != 1:
        raise VersionError(
            f"has seal version {version} in front, and 1 is known. Install the vfplan that wrote "
            "it, and read the file with that.",
            code="version.seal",
        )
    if length not in LENGTHS or len(data) != length + payload_length:
        raise CorruptError(
            "was cut or grown: its seal says another length. Migrate the original file.",
            code="corrupt.seal",
        )
    block = data[:length]
    payload = data[length:]
    if hashlib.sha256(block[:-32]).digest() != block[-32:]:
        raise CorruptError(
            "The seal itself is damaged: its SHA-256 differs. Migrate the original file.",
            code="corrupt.seal",
        )
    if hashlib.sha256(payload).digest() != block[24:56]:
        raise CorruptError(
            "Its SHA-256 differs from the sealed one. Migrate the original file.",
            code="corrupt.seal",
        )
    if flags & 1:
        return payload, block[56:72].hex()
    return payload, None


def version_of(file: Any, *, is_sealed: bool) -> str:
    """The version, which fits to there being a seal or not.

    Nobody removes the seal of a later version to bring it in as an old one.
    """
    if attribute_text(file, "format") != FORMAT:
        raise CorruptError(
            "is no fixture bundle. Give one.", where="/@format", code="corrupt.format"
        )
    version = attribute_text(file, "version")
    if is_sealed and version not in ("1.0", "1.1"):
        raise VersionError(
            f"It has version {version!r} under the seal of versions 1.0 and 1.1. Migrate the "
            "original file.",
            where="/@version",
            code="version.major",
        )
    if not is_sealed and version != "0.1":
        raise CorruptError(
            f"its seal is missing, and version {version!r} has one: the file was cut, or opened "
            "for writing by another program. Migrate the file as it was first written.",
            where="/@version",
            code="corrupt.seal",
        )
    return version


def attribute_text(file: Any, name: str) -> str:
    """A text attribute of the root; "" where there is none."""
    value = file.attrs.get(name)
    return value.decode("ascii", "replace") if isinstance(value, bytes) else ""


def version_number(version: str) -> tuple[int, ...]:
    """Version "1.0" as (1, 0), to be compared."""
    return tuple(map(int, version.split(".")))


def check_names(file: Any, rows: dict[str, Row]) -> None:
    """Refuse what the version's table does not name, and what leads out of the file."""
    for group, row in rows.items():
        if row.kind != "group" or group not in file:
            continue
        for name in file[group]:
            path = f"{group.rstrip('/')}/{name}"
            link = file[group].get(name, getlink=True)
            if not isinstance(link, h5py.HardLink):
                raise UnsafeError(
                    "is a link that is not hard. Migrate the original file.",
                    where=path,
                    code="unsafe.link",
                )
            check_name(path in rows, name, group)
        for name in file[group].attrs:
            check_name(f"{group}@{name}" in rows, name, group)


def check_name(is_known: bool, name: str, group: str) -> None:
    """Refuse a name that the version's table does not have."""
    if not is_known:
        raise UnsafeError(
            f"holds {name!r}, which its version lacks. Migrate the original file.",
            where=group,
            code="unsafe.unknown",
        )


def dataset_values(dataset: Any, row: Row) -> np.ndarray:
    """A dataset's values, after its kind, type and size were compared with its row."""
    is_dataset = isinstance(dataset, h5py.Dataset) and dataset.shape is not None
    if not is_dataset or dataset.external or dataset.is_virtual:
        raise UnsafeError(
            "is no plain dataset. Migrate the original file.", where=row.path, code="unsafe.layout"
        )
    if row.type == "text":
        has_type = dataset.dtype.kind == "S"
    else:
        has_type = dataset.dtype.str.lstrip("<|") == row.type
    if not has_type:
        raise CorruptError(
            f"has type {dataset.dtype}. Migrate the original file.",
            where=row.path,
            code="corrupt.type",
        )
    sizes = document(OLDER)["sizes"]
    max_text_bytes = document(OLDER)["limits"]["text_bytes"]
    if len(dataset.shape) != len(row.shape) or dataset.dtype.itemsize > max_text_bytes:
        raise CorruptError(
            f"has shape {dataset.shape}. Migrate the original file.",
            where=row.path,
            code="corrupt.shape",
        )
    for side, wanted in zip(dataset.shape, row.shape, strict=True):
        max_side = sizes[wanted]["max"] if isinstance(wanted, str) else wanted
        if not 1 <= side <= max_side:
            raise UnsafeError(
                f"has shape {dataset.shape}. Migrate the original file.",
                where=row.path,
                code="unsafe.cap",
            )
    return np.asarray(dataset[...])


def attribute_value(value: Any, row: Row) -> Any:
    """An attribute as JSON holds it."""
    if row.type == "text" and isinstance(value, bytes):
        return decoded(value, row)
    if row.type != "text" and isinstance(value, np.generic) and value.dtype.str[1:] == row.type:
        return value.item()
    raise CorruptError(
        "has another type. Migrate the original file.", where=row.path, code="corrupt.type"
    )


def decoded(value: bytes, row: Row) -> str:
    """A text of the file."""
    try:
        return value.decode()
    except UnicodeDecodeError:
        raise CorruptError(
            "is not UTF-8. Migrate the original file.", where=row.path, code="corrupt.text"
        ) from None
