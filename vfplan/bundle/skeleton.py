"""A look at a payload's bones before libhdf5 gets it: only the few structures a bundle needs.

The headers of every object that will be opened are walked here first (`header`), and the index of
its chunks is looked at: a single chunk or a fixed array, as libver v110 writes them.
vfplan/hdf5/skeleton.hpp does the same.

Structures and numbers: HDF5 File Format Specification 3.0, sections III.C and III.D.
"""

from __future__ import annotations

import struct

from vfplan.bundle.header import NOWHERE, Header, read_header
from vfplan.bundle.table import Table, document
from vfplan.bundle.window import Window, within
from vfplan.errors import CorruptError, UnsafeError

ROOT_ADDRESS = 36  # in the superblock
SINGLE_CHUNK, FIXED_ARRAY = 1, 3
FLETCHER_BYTES = 4


def check_skeleton(payload: bytes, table: Table) -> None:
    """Refuse a payload whose object headers are not plain ones.

    Raises
    ------
    UnsafeError
        Something that the format does not allow.
    CorruptError
        Something that is not well formed.
    """
    data = memoryview(payload)
    known = {row.path for row in table.rows if row.kind != "attribute"}
    waiting, seen = [("/", struct.unpack_from("<Q", data, ROOT_ADDRESS)[0])], set()
    while waiting:
        path, address = waiting.pop(0)
        if address in seen:
            continue  # a second link to it, which the reader will refuse
        seen.add(address)
        found = read_header(data, address, path)
        if found.layout is not None:
            _check_dataset(data, found, found.layout)
        prefix = "/" if path == "/" else path + "/"
        waiting += [(prefix + n, a) for n, a in found.links if prefix + n in known]


def _check_dataset(data: memoryview, found: Header, layout: Window) -> None:
    if layout.number(1) != 4 or layout.number(1) != 2:
        raise UnsafeError(
            "is not stored in chunks as libver v110 does; no other layout is allowed",
            where=found.path,
        )
    if found.shape is None or found.size is None or found.fill not in (None, 0, found.size):
        raise CorruptError("has no plain dataspace, datatype and fill value", where=found.path)
    if not found.filters:
        raise UnsafeError("must have fletcher32 as its one filter", where=found.path)
    flags, dimensions, width = layout.number(1), layout.number(1), layout.number(1)
    if flags & ~2 or dimensions != len(found.shape) + 1 or not 1 <= width <= 8:
        raise CorruptError("has a chunk of another form than its dataspace", where=found.path)
    sides = [layout.number(width) for _ in range(dimensions)]
    if 0 in sides or sides[-1] != found.size:
        raise CorruptError(f"has chunks of {sides}", where=found.path)
    chunk_bytes, chunks = 1, 1
    for side in sides:
        chunk_bytes = min(chunk_bytes * side, NOWHERE)
    if chunk_bytes > document()["limits"]["chunk_bytes"]:
        raise UnsafeError(f"has chunks of {chunk_bytes} bytes", where=found.path)
    for size, side in zip(found.shape, sides, strict=False):
        chunks = min(chunks * -(-size // side), NOWHERE)
    _check_index(data, layout, flags, chunks, chunk_bytes + FLETCHER_BYTES)


def _check_index(data: memoryview, layout: Window, flags: int, chunks: int, stored: int) -> None:
    """The index of a dataset's chunks has their number, and lies within the file."""
    index = layout.number(1)
    if index == SINGLE_CHUNK:
        if flags != 2 or layout.number(8) != stored or layout.number(4) or chunks != 1:
            raise CorruptError("has a chunk of another size", where=layout.where)
        within(data, layout.number(8), stored, layout.where)
    elif index == FIXED_ARRAY:
        page_bits, address = layout.number(1), layout.number(8)
        head = Window(within(data, address, 28, layout.where), layout.where)
        if flags or bytes(head.take(6)) != b"FAHD\0\1":
            raise CorruptError("has no index of filtered chunks", where=layout.where)
        width = head.number(1) - 12
        if not 1 <= width <= 8 or head.number(1) != page_bits or not 1 <= page_bits <= 20:
            raise CorruptError("has an index of another form", where=layout.where)
        if head.number(8) != chunks or chunks > document()["limits"]["chunks_per_dataset"]:
            raise UnsafeError(f"has an index of another length than {chunks}", where=layout.where)
        start = head.number(8)
        block = within(data, start, 14 + chunks * (width + 12) + 4, layout.where)
        if bytes(block[:6]) != b"FADB\0\1" or int.from_bytes(block[6:14], "little") != address:
            raise CorruptError("has an index without its block", where=layout.where)
    else:
        raise UnsafeError(f"has a chunk index of kind {index}", where=layout.where)
    layout.done()
