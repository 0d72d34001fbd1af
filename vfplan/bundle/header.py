"""Object headers of an HDF5 file, read by ourselves: only the few messages a bundle needs.

libhdf5 was not made for hostile files: object headers whose checksums are right and whose content
is not can make it divide by zero. Here each message must be of a plain form and exactly as long as
it should be: compact links and attributes, dataspaces of up to three dimensions, plain numbers and
fixed-length strings, fletcher32. vfplan/hdf5/header.hpp does the same.

Structures and numbers: HDF5 File Format Specification 3.0, section IV.A.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from vfplan.bundle.table import document
from vfplan.bundle.window import Window, within
from vfplan.errors import CorruptError, UnsafeError

NOWHERE = 0xFFFF_FFFF_FFFF_FFFF
MOST_BLOCKS = 64  # continuation blocks of one object header
FIXED, FLOAT, STRING = 0, 1, 3  # datatype classes
FLETCHER32 = 3


@dataclass
class Header:
    """What one object header says."""

    path: str
    links: list[tuple[str, int]] = field(default_factory=list)
    attributes: list[bytes] = field(default_factory=list)
    shape: tuple[int, ...] | None = None
    size: int | None = None
    fill: int | None = None
    layout: Window | None = None
    filters: int = 0


def read_header(data: memoryview, address: int, path: str) -> Header:
    """The object header at an address, with all blocks it goes on in.

    Raises `UnsafeError` for what the format does not allow, `CorruptError` for what is malformed.
    """
    head = Window(within(data, address, min(32, max(len(data) - address, 0)), path), path)
    if bytes(head.take(4)) != b"OHDR" or head.number(1) != 2:
        raise CorruptError("has no object header of version 2", where=path)
    flags = head.number(1)
    if flags & ~0x33:
        raise CorruptError(f"object header flags {flags:#x}", where=path)
    head.take((16 if flags & 0x20 else 0) + (4 if flags & 0x10 else 0))
    size = head.number(1 << (flags & 3))
    found = Header(path)
    blocks = [within(data, address + head.at, size, path)]
    for count, block in enumerate(blocks):
        if count == MOST_BLOCKS:
            raise UnsafeError(f"more than {MOST_BLOCKS} header blocks", where=path)
        for start, length in _messages(Window(block, path), found):
            chunk = within(data, start, length, path)
            if length < 8 or bytes(chunk[:4]) != b"OCHK":
                raise CorruptError("a header block has no signature", where=path)
            blocks.append(chunk[4:-4])
    return found


def _messages(block: Window, found: Header) -> list[tuple[int, int]]:
    """Read one block's messages; returns where its header goes on."""
    more, nil = [], False
    while block.left >= 4:
        kind, size, flags = block.number(1), block.number(2), block.number(1)
        body = Window(block.take(size), block.where)
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


def _once(value: object, found: Header) -> None:
    if value is not None:
        raise CorruptError("has a header message twice", where=found.path)


def _nil(body: Window, found: Header) -> None:
    """Nothing."""


def _info(body: Window, found: Header) -> None:
    """Link info and attribute info: heap and index must not be there, nor creation order."""
    body.wanted(2, 0, "version and flags of link or attribute info")
    if (body.number(8), body.number(8)) != (NOWHERE, NOWHERE):
        raise UnsafeError("keeps links or attributes in a heap", where=found.path)


def _group_info(body: Window, found: Header) -> None:
    body.wanted(1, 0, "version of group info")
    flags = body.number(1)
    body.take((4 if flags & 1 else 0) + (4 if flags & 2 else 0))


def _dataspace(body: Window, found: Header) -> None:
    _once(found.shape, found)
    found.shape, _ = _shape(body)


def _shape(body: Window) -> tuple[tuple[int, ...], int]:
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


def _datatype(body: Window, found: Header) -> None:
    _once(found.size, found)
    found.size = _size(body)


def _size(body: Window) -> int:
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


def _fill(body: Window, found: Header) -> None:
    _once(found.fill, found)
    body.wanted(1, 3, "version of a fill value")
    flags = body.number(1)
    found.fill = body.number(4) if flags & 0x20 else 0
    body.take(found.fill)
    if flags & 0xC0 or flags & 0x30 == 0x30:
        raise CorruptError(f"fill value flags {flags:#x}", where=found.path)


def _link(body: Window, found: Header) -> None:
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


def _layout(body: Window, found: Header) -> None:
    _once(found.layout, found)
    found.layout = Window(body.take(body.left), found.path)


def _filters(body: Window, found: Header) -> None:
    if found.filters:
        raise CorruptError("has a header message twice", where=found.path)
    body.wanted(1, 2, "version of a filter pipeline")
    if body.number(1) != 1 or body.number(2) != FLETCHER32:
        raise UnsafeError("must have fletcher32 as its one filter", where=found.path)
    body.take(2)
    body.take(4 * body.number(2))
    found.filters = 1


def _attribute(body: Window, found: Header) -> None:
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
    kind = Window(body.take(datatype), found.path)
    size = _size(kind)
    kind.done()
    space = Window(body.take(dataspace), found.path)
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
