"""Single fields of an HDF5 file: attributes, datatypes, storage and ranges, each compared with its
row of the format's table before a value is read. vfplan/hdf5/fields.hpp does the same.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from vfplan.bundle.content import Content
from vfplan.bundle.store import NUMBERS, unit_of
from vfplan.bundle.table import Row
from vfplan.bundle.table import table as current
from vfplan.io.hdf5 import h5py

h5a, h5d, h5s, h5t, h5z = (getattr(h5py, n) for n in ("h5a", "h5d", "h5s", "h5t", "h5z"))
CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")
FLETCHER_BYTES = 4


class Wrong(Exception):  # noqa: N818 - carries a finding to the loop over rows, never leaves here
    """A finding about one row."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code, self.message = code, message


def scalar_attribute(where: Any, row: Row) -> Any:
    """The value of a scalar attribute: text, `int` or `float`."""
    attribute = h5a.open(where, row.name.encode())
    if attribute.get_space().get_simple_extent_type() != h5s.SCALAR:
        raise Wrong("corrupt.shape", "is not a scalar")
    datatype = checked_type(attribute.get_type(), row)
    value = np.empty((), dtype=datatype.dtype)
    attribute.read(value, mtype=datatype)
    if row.type == "text":
        return decoded(value.tobytes())
    return value.item()


def checked_type(datatype: Any, row: Row) -> Any:
    """The datatype to read a row with, after the file's own was compared with the row's."""
    if datatype.committed():
        raise Wrong("unsafe.type", "has a named datatype; none is allowed")
    if row.type != "text":
        if not datatype.equal(NUMBERS[row.type]):
            raise Wrong("corrupt.type", f"has another type than {row.type}")
        return NUMBERS[row.type]
    if not isinstance(datatype, h5t.TypeStringID) or datatype.is_variable_str():
        raise Wrong("unsafe.type", "is not a fixed-length string")
    cap = current().limits["text_bytes"]
    if datatype.get_size() > cap:
        raise Wrong("unsafe.cap", f"is text of {datatype.get_size()} bytes; at most {cap} allowed")
    if datatype.get_strpad() == h5t.STR_SPACEPAD:
        raise Wrong("corrupt.type", "is text padded with blanks; NUL is wanted")
    return datatype


def decoded(coded: bytes) -> str:
    """Text as it is stored, without its padding."""
    try:
        text = coded.rstrip(b"\0").decode("utf-8")
    except UnicodeDecodeError:
        raise Wrong("corrupt.text", "is not UTF-8") from None
    if CONTROL.search(text):
        raise Wrong("corrupt.text", "holds control characters")
    return text


def checked_storage(
    dataset: Any, shape: tuple[int, ...], itemsize: int, budget: int, limits: dict[str, int]
) -> int:
    """How many of the `budget` bytes that the file has left a dataset fills, all chunks there."""
    dcpl = dataset.get_create_plist()
    if dcpl.get_layout() != h5d.CHUNKED:
        raise Wrong("unsafe.layout", "is not stored in chunks; no other layout is allowed")
    if dcpl.get_external_count():
        raise Wrong("unsafe.external", "is stored in another file")
    if dcpl.get_nfilters() != 1 or dcpl.get_filter(0)[0] != h5z.FILTER_FLETCHER32:
        raise Wrong("unsafe.filter", "must have fletcher32 as its one filter")
    chunk = dcpl.get_chunk()
    chunk_bytes = itemsize * int(np.prod(chunk, dtype=object))
    cap = limits["chunk_bytes"]
    if chunk_bytes > cap:
        raise Wrong("unsafe.cap", f"has chunks of {chunk_bytes} bytes; at most {cap} allowed")
    counts = [-(-size // step) for size, step in zip(shape, chunk, strict=True)]
    wanted = int(np.prod(counts, dtype=object)) * (chunk_bytes + FLETCHER_BYTES)
    if wanted > budget:
        raise Wrong("unsafe.cap", f"claims {wanted} bytes; the file has {budget} left")
    _check_chunks(dataset, chunk_bytes + FLETCHER_BYTES, wanted, limits["chunks_per_dataset"])
    return wanted


def _check_chunks(dataset: Any, chunk_bytes: int, wanted: int, cap: int) -> None:
    """All chunks are there, whole, and passed through the filter: none is made up of fill."""
    if dataset.get_storage_size() != wanted:
        found = dataset.get_storage_size()
        raise Wrong("corrupt.storage", f"{found} bytes are stored; {wanted} wanted")
    count = wanted // chunk_bytes
    if count > cap:
        raise Wrong("unsafe.cap", f"has {count} chunks; at most {cap} allowed")
    for index in range(count):
        chunk = dataset.get_chunk_info(index)
        if (chunk.filter_mask, chunk.size) != (0, chunk_bytes):
            raise Wrong("unsafe.filter", f"chunk {index} did not pass fletcher32")


def check_range(value: Any, row: Row, content: Content) -> None:
    """Refuse a value outside of its row's range; `content` says the frames."""
    if row.type == "text":
        if row.allowed and value not in row.allowed:
            raise Wrong("corrupt.value", f"is {value!r}; {' or '.join(row.allowed)} allowed")
        return
    low, high = np.min(value), np.max(value)  # NaN if there is one
    if not (np.isfinite(low) and np.isfinite(high)):
        raise Wrong("corrupt.value", "holds a number that is not finite")
    unit = unit_of(row, content)
    cap = (row.max_abs or {}).get(unit, np.inf)
    least, most = max(-cap, -np.inf if row.min is None else row.min), cap
    most = min(most, np.inf if row.max is None else row.max)
    if low < least or high > most:
        raise Wrong("corrupt.range", f"runs from {low} to {high}; {least} to {most} allowed")
    if row.above is not None and low <= row.above:
        raise Wrong("corrupt.range", f"is {low}; more than {row.above} wanted")
