"""A look at a payload's bones before libhdf5 gets it: only the few structures a bundle needs.

libhdf5 was not made for hostile files: object headers whose checksums are right and whose content
is not can make it divide by zero. So the headers of every object that will be opened are walked
here first, and all but the plain forms that libver v110 writes are refused: compact links and
attributes, dataspaces of up to three dimensions, plain numbers and fixed-length strings, chunks
under a single-chunk or fixed-array index, fletcher32. vfplan/hdf5/skeleton.hpp does the same.

Structures and numbers: HDF5 File Format Specification 3.0, sections III.C, III.D, IV.A.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

from vfplan.bundle.table import Table, document
from vfplan.errors import CorruptError, UnsafeError

NOWHERE = 0xFFFF_FFFF_FFFF_FFFF
ROOT_ADDRESS = 36  # in the superblock
MOST_BLOCKS = 64  # continuation blocks of one object header
FIXED, FLOAT, STRING = 0, 1, 3  # datatype classes
SINGLE_CHUNK, FIXED_ARRAY = 1, 3
FLETCHER32, FLETCHER_BYTES = 3, 4


class _Bytes:
    """A window on the payload that is never left."""

    def __init__(self, data: memoryview, where: str) -> None:
        self.data, self.where, self.at = data, where, 0

    def take(self, count: int) -> memoryview:
        if count > len(self.data) - self.at:
            raise CorruptError("an object header is cut short", where=self.where)
        self.at += count
        return self.data[self.at - count : self.at]

    def number(self, width: int) -> int:
        return int.from_bytes(self.take(width), "little")

    def wanted(self, width: int, value: int, what: str) -> None:
        found = self.number(width)
        if found != value:
            raise CorruptError(f"{what} is {found}; {value} wanted", where=self.where)

    def done(self) -> None:
        if self.left:
            raise CorruptError("a header message is too long", where=self.where)

    @property
    def left(self) -> int:
        return len(self.data) - self.at


@dataclass
class _Object:
    """What one object header says."""

    path: str
    links: list[tuple[str, int]] = field(default_factory=list)
    attributes: list[bytes] = field(default_factory=list)
    shape: tuple[int, ...] | None = None
    size: int | None = None
    fill: int | None = None
    layout: _Bytes | None = None
    filters: int = 0


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
        found = _object(data, address, path)
        if found.layout is not None:
            _check_dataset(data, found, found.layout)
        prefix = "/" if path == "/" else path + "/"
        waiting += [(prefix + n, a) for n, a in found.links if prefix + n in known]


def _window(data: memoryview, address: int, size: int, where: str) -> memoryview:
    if address > len(data) or size > len(data) - address:
        raise CorruptError("an object header lies outside of the file", where=where)
    return data[address : address + size]


def _object(data: memoryview, address: int, path: str) -> _Object:
    head = _Bytes(_window(data, address, min(32, max(len(data) - address, 0)), path), path)
    if bytes(head.take(4)) != b"OHDR" or head.number(1) != 2:
        raise CorruptError("has no object header of version 2", where=path)
    flags = head.number(1)
    if flags & ~0x33:
        raise CorruptError(f"object header flags {flags:#x}", where=path)
    head.take((16 if flags & 0x20 else 0) + (4 if flags & 0x10 else 0))
    size = head.number(1 << (flags & 3))
    found = _Object(path)
    blocks = [_window(data, address + head.at, size, path)]
    for count, block in enumerate(blocks):
        if count == MOST_BLOCKS:
            raise UnsafeError(f"more than {MOST_BLOCKS} header blocks", where=path)
        for start, length in _messages(_Bytes(block, path), found):
            chunk = _window(data, start, length, path)
            if length < 8 or bytes(chunk[:4]) != b"OCHK":
                raise CorruptError("a header block has no signature", where=path)
            blocks.append(chunk[4:-4])
    return found


def _messages(block: _Bytes, found: _Object) -> list[tuple[int, int]]:
    """Read one block's messages; returns where its header goes on."""
    more, nil = [], False
    while block.left >= 4:
        kind, size, flags = block.number(1), block.number(2), block.number(1)
        body = _Bytes(block.take(size), block.where)
        if flags & ~MESSAGE_FLAGS or kind not in (*MESSAGES, CONTINUATION):
            raise UnsafeError(
                f"holds message {kind:#x}, flags {flags:#x}, which no bundle needs",
                where=block.where,
            )
        if kind == CONTINUATION:
            more.append((body.number(8), body.number(8)))
        elif kind != NIL:
            MESSAGES[kind](body, found)
        if kind == NIL:
            nil = True
        else:
            body.done()
    if (nil and block.left) or any(block.take(block.left)):
        raise CorruptError("has a gap in its object header", where=found.path)
    return more


def _once(value: object, found: _Object) -> None:
    if value is not None:
        raise CorruptError("has a header message twice", where=found.path)


def _nil(body: _Bytes, found: _Object) -> None:
    """Nothing."""


def _info(body: _Bytes, found: _Object) -> None:
    """Link info and attribute info: heap and index must not be there, nor creation order."""
    body.wanted(2, 0, "version and flags of link or attribute info")
    if (body.number(8), body.number(8)) != (NOWHERE, NOWHERE):
        raise UnsafeError("keeps links or attributes in a heap", where=found.path)


def _group_info(body: _Bytes, found: _Object) -> None:
    body.wanted(1, 0, "version of group info")
    flags = body.number(1)
    body.take((4 if flags & 1 else 0) + (4 if flags & 2 else 0))


def _dataspace(body: _Bytes, found: _Object) -> None:
    _once(found.shape, found)
    found.shape, _ = _shape(body)


def _shape(body: _Bytes) -> tuple[tuple[int, ...], int]:
    """(shape, number of elements, or more than any bundle has)."""
    body.wanted(1, 2, "version of a dataspace")
    rank, flags, kind = body.number(1), body.number(1), body.number(1)
    if rank > 3 or flags > 1 or kind > 2 or (kind != 1 and rank):
        raise CorruptError(
            f"dataspace of kind {kind}, rank {rank}, flags {flags}", where=body.where
        )
    shape = tuple(body.number(8) for _ in range(rank))
    if flags and tuple(body.number(8) for _ in range(rank)) != shape:
        raise UnsafeError("can grow; only arrays of fixed size are allowed", where=body.where)
    count = 0 if kind == 2 else 1
    for side in shape:
        count = min(count * side, NOWHERE)
    return shape, count


def _datatype(body: _Bytes, found: _Object) -> None:
    _once(found.size, found)
    found.size = _size(body)


def _size(body: _Bytes) -> int:
    """The size of a plain datatype in bytes."""
    head = body.number(1)
    kind, version = head & 15, head >> 4
    if kind not in (FIXED, FLOAT, STRING):
        raise UnsafeError(f"has a datatype of class {kind}; none is allowed", where=body.where)
    if not 1 <= version <= 3:
        raise CorruptError(f"datatype of version {version}", where=body.where)
    bits, size = body.number(3), body.number(4)
    if kind == STRING and (bits & 15 > 2 or bits >> 4 > 1):
        raise CorruptError(f"has text of padding and encoding {bits:#x}", where=body.where)
    if not size:
        raise CorruptError("has a datatype without size", where=body.where)
    if kind != STRING:
        if size > 16:
            raise CorruptError(f"has a number of {size} bytes", where=body.where)
        offset, precision = body.number(2), body.number(2)
        if not precision or offset + precision > 8 * size:
            raise CorruptError("has a number with bits outside of it", where=body.where)
    if kind == FLOAT:
        body.take(8)
    return size


def _fill(body: _Bytes, found: _Object) -> None:
    _once(found.fill, found)
    body.wanted(1, 3, "version of a fill value")
    flags = body.number(1)
    found.fill = body.number(4) if flags & 0x20 else 0
    body.take(found.fill)
    if flags & 0xC0 or flags & 0x30 == 0x30:
        raise CorruptError(f"fill value flags {flags:#x}", where=found.path)


def _link(body: _Bytes, found: _Object) -> None:
    body.wanted(1, 1, "version of a link")
    flags = body.number(1)
    if flags & 0x08 and body.number(1) != 0:
        raise UnsafeError("holds a link that is not hard; no other is allowed", where=found.path)
    if flags & ~0x1B:
        raise CorruptError(f"link flags {flags:#x}", where=found.path)
    body.take(1 if flags & 0x10 else 0)
    name = bytes(body.take(body.number(1 << (flags & 3))))
    text = name.decode("utf-8", "replace")
    if not name or b"\0" in name or b"/" in name or text in dict(found.links):
        raise CorruptError("has a link of no name, or two of the same", where=found.path)
    found.links.append((text, body.number(8)))
    if len(found.links) > document()["limits"]["links_per_group"]:
        raise UnsafeError("has too many links", where=found.path)


def _layout(body: _Bytes, found: _Object) -> None:
    _once(found.layout, found)
    found.layout = _Bytes(body.take(body.left), found.path)


def _filters(body: _Bytes, found: _Object) -> None:
    if found.filters:
        raise CorruptError("has a header message twice", where=found.path)
    body.wanted(1, 2, "version of a filter pipeline")
    if body.number(1) != 1 or body.number(2) != FLETCHER32:
        raise UnsafeError("must have fletcher32 as its one filter", where=found.path)
    body.take(2)
    body.take(4 * body.number(2))
    found.filters = 1


def _attribute(body: _Bytes, found: _Object) -> None:
    body.wanted(1, 3, "version of an attribute")
    body.wanted(1, 0, "flags of an attribute")
    name, datatype, dataspace = body.number(2), body.number(2), body.number(2)
    body.take(1)
    text = bytes(body.take(name))
    if len(text) < 2 or text.find(0) != len(text) - 1 or text in found.attributes:
        raise CorruptError("has an attribute of no name, or two of the same", where=found.path)
    found.attributes.append(text)
    if len(found.attributes) > document()["limits"]["attributes_per_object"]:
        raise UnsafeError("has too many attributes", where=found.path)
    kind = _Bytes(body.take(datatype), found.path)
    size = _size(kind)
    kind.done()
    space = _Bytes(body.take(dataspace), found.path)
    _, count = _shape(space)
    space.done()
    if count * size != body.left:
        raise CorruptError("has an attribute of another size", where=found.path)
    body.take(body.left)


NIL, CONTINUATION, MESSAGE_FLAGS = 0x00, 0x10, 0x05
MESSAGES = {
    NIL: _nil,
    0x01: _dataspace,
    0x02: _info,
    0x03: _datatype,
    0x05: _fill,
    0x06: _link,
    0x08: _layout,
    0x0A: _group_info,
    0x0B: _filters,
    0x0C: _attribute,
    0x15: _info,
}


def _check_dataset(data: memoryview, found: _Object, layout: _Bytes) -> None:
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


def _check_index(data: memoryview, layout: _Bytes, flags: int, chunks: int, stored: int) -> None:
    """The index of a dataset's chunks has their number, and lies within the file."""
    index = layout.number(1)
    if index == SINGLE_CHUNK:
        if flags != 2 or layout.number(8) != stored or layout.number(4) or chunks != 1:
            raise CorruptError("has a chunk of another size", where=layout.where)
        _window(data, layout.number(8), stored, layout.where)
    elif index == FIXED_ARRAY:
        page_bits, address = layout.number(1), layout.number(8)
        head = _Bytes(_window(data, address, 28, layout.where), layout.where)
        if flags or bytes(head.take(6)) != b"FAHD\0\1":
            raise CorruptError("has no index of filtered chunks", where=layout.where)
        width = head.number(1) - 12
        if not 1 <= width <= 8 or head.number(1) != page_bits or not 1 <= page_bits <= 20:
            raise CorruptError("has an index of another form", where=layout.where)
        if head.number(8) != chunks or chunks > document()["limits"]["chunks_per_dataset"]:
            raise UnsafeError(f"has an index of another length than {chunks}", where=layout.where)
        start = head.number(8)
        block = _window(data, start, 14 + chunks * (width + 12) + 4, layout.where)
        if bytes(block[:6]) != b"FADB\0\1" or int.from_bytes(block[6:14], "little") != address:
            raise CorruptError("has an index without its block", where=layout.where)
    else:
        raise UnsafeError(f"has a chunk index of kind {index}", where=layout.where)
    layout.done()
