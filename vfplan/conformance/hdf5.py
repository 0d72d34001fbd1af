"""A small writer of HDF5 files that can also write what a bundle must not hold.

It writes what docs/format.md allows, byte by byte and without libhdf5, so that the kit's files
depend on no library's version. A vector changes the `Item`s before they are laid out.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from vfplan._core import lookup3
from vfplan.bundle.schema import Content, table
from vfplan.bundle.write import as_stored, unit_and_frame

UNDEFINED = int(np.iinfo(np.uint64).max)
"""HDF5's address of nothing: all 64 bits are set."""
DATATYPES = {
    "f8": bytes.fromhex("11203f00080000000000400034 0b0034ff030000".replace(" ", "")),
    "i4": bytes.fromhex("100800000400000000002000"),
    "u1": bytes.fromhex("100000000100000000000800"),
}


class MessageType(IntEnum):
    """The types of an object header's messages that a bundle holds."""

    DATASPACE = 0x01
    LINK_INFO = 0x02
    DATATYPE = 0x03
    FILL = 0x05
    LINK = 0x06
    LAYOUT = 0x08
    GROUP_INFO = 0x0A
    ATTRIBUTE = 0x0C


@dataclass
class Item:
    """A group, or a dataset (`data` is not `None`), before it has a place in the file."""

    attributes: dict[bytes, tuple[bytes, bytes, bytes]] = field(default_factory=dict)
    """Name -> (datatype, dataspace, value)."""
    links: dict[bytes, str | bytes] = field(default_factory=dict)
    """Name -> path of an item, or the body of a link message as it is."""
    datatype: bytes = b""
    dataspace: bytes = b""
    data: bytes | None = None
    data_at: int | str | None = None
    """Address to write in place of the true one, or the path of the item whose data to name."""
    layout: bytes = b"\x03\x01"
    fill: bytes = b"\x03\x06"
    more: list[tuple[int, bytes]] = field(default_factory=list)
    """Further messages: (kind, body)."""
    flags: int = 0
    """Flags of the datatype's message; 2 says that it is shared."""


def text_type(size: int, padding: int = 1) -> bytes:
    """The datatype of a text of `size` bytes in UTF-8; padding 1: NUL, 2: blanks."""
    return struct.pack("<BBBBI", 0x13, padding | 0x10, 0, 0, size)


def space_of(shape: tuple[int, ...]) -> bytes:
    """The dataspace of an array; () is a scalar."""
    is_simple = len(shape) > 0
    return struct.pack(f"<BBBB{len(shape)}Q", 2, len(shape), 0, is_simple, *shape)


def stored(value: object, kind: str) -> tuple[bytes, bytes, bytes]:
    """(datatype, dataspace, bytes) of a value of the table's type `kind`."""
    data = as_stored(value, kind)
    datatype = text_type(data.itemsize) if kind == "text" else DATATYPES[kind]
    return datatype, space_of(data.shape), data.tobytes()


def items_of(content: Content) -> dict[str, Item]:
    """The groups and datasets of a content by their paths, the root first."""
    items = {"/": Item()}
    used = {row.parent for row in table() if row.path in content}
    for row in table():
        if row.kind == "group" and row.path != "/" and row.path in used:
            add(items, row.path, Item())
        elif row.path in content and row.kind == "attribute":
            items[row.parent].attributes[row.name.encode()] = stored(content[row.path], row.type)
        elif row.path in content:
            datatype, dataspace, data = stored(content[row.path], row.type)
            item = Item(datatype=datatype, dataspace=dataspace, data=data)
            for name, text in unit_and_frame(row, content).items():
                item.attributes[name.encode()] = stored(text, "text")
            add(items, row.path, item)
    return items


def add(items: dict[str, Item], path: str, item: Item) -> None:
    """Put an item under its path, and a link to it into its group."""
    parent, _, name = path.rpartition("/")
    items[path] = item
    items[parent or "/"].links[name.encode()] = path


def remove(items: dict[str, Item], path: str) -> None:
    """Take an item out, and the link to it."""
    parent, _, name = path.rpartition("/")
    del items[path], items[parent or "/"].links[name.encode()]


def to_payload(items: dict[str, Item]) -> bytes:
    """The HDF5 file of these items, up to a multiple of 8 bytes; its end of file is to be set."""
    nowhere = dict.fromkeys(items, 0)
    at = 48
    headers, data = {}, {}
    for path, item in items.items():
        headers[path] = at
        at += len(header_of(item, nowhere, 0))
        at += -at % 8
    for path, item in items.items():
        data[path] = UNDEFINED
        if item.data:
            data[path] = at
            at += len(item.data)
            at += -at % 8
    payload = bytearray(at)
    payload[:48] = superblock(headers["/"], at)
    for path, item in items.items():
        address = data[path]
        if isinstance(item.data_at, str):
            address = data[item.data_at]
        elif item.data_at is not None:
            address = item.data_at
        header = header_of(item, headers, address)
        payload[headers[path] : headers[path] + len(header)] = header
        if item.data:
            payload[data[path] : data[path] + len(item.data)] = item.data
    return bytes(payload)


def superblock(root: int, end: int) -> bytes:
    """The 48 bytes of a superblock of version 2."""
    head = struct.pack("<8sBBBBQQQQ", b"\x89HDF\r\n\x1a\n", 2, 8, 8, 0, 0, UNDEFINED, end, root)
    return head + struct.pack("<I", lookup3(head))


def checked(payload: bytes) -> bytes:
    """The payload with its superblock's checksum made anew."""
    return payload[:44] + struct.pack("<I", lookup3(payload[:44])) + payload[48:]


def link(name: bytes, address: int) -> bytes:
    """The body of a hard link's message."""
    return struct.pack("<BBBB", 1, 0x10, 1, len(name)) + name + struct.pack("<Q", address)


def soft_link(name: bytes, target: bytes) -> bytes:
    """The body of a soft link's message, which no bundle holds."""
    head = struct.pack("<BBBBB", 1, 0x18, 1, 1, len(name))
    return head + name + struct.pack("<H", len(target)) + target


def attribute(name: bytes, datatype: bytes, dataspace: bytes, value: bytes) -> bytes:
    """The body of an attribute's message."""
    sizes = struct.pack("<BBHHHB", 3, 0, len(name) + 1, len(datatype), len(dataspace), 1)
    return sizes + name + b"\0" + datatype + dataspace + value


def header_of(item: Item, addresses: dict[str, int], data_at: int) -> bytes:
    """The object header of an item whose data lie at `data_at`."""
    messages: list[tuple[int, int, bytes]] = []
    if item.data is None:
        messages.append(
            (MessageType.LINK_INFO, 0, struct.pack("<BBQQ", 0, 0, UNDEFINED, UNDEFINED))
        )
        messages.append((MessageType.GROUP_INFO, 0, b"\0\0"))
    else:
        layout = item.layout + struct.pack("<QQ", data_at, len(item.data))
        messages.append((MessageType.DATASPACE, 0, item.dataspace))
        messages.append((MessageType.DATATYPE, 1 | item.flags, item.datatype))
        messages.append((MessageType.FILL, 1, item.fill))
        messages.append((MessageType.LAYOUT, 0, layout))
    for name, (datatype, dataspace, value) in item.attributes.items():
        messages.append((MessageType.ATTRIBUTE, 0, attribute(name, datatype, dataspace, value)))
    for name, target in item.links.items():
        body = target if isinstance(target, bytes) else link(name, addresses[target])
        messages.append((MessageType.LINK, 0, body))
    messages += [(kind, 0, body) for kind, body in item.more]
    body = b"".join(struct.pack("<BHB", k, len(b), f) + b for k, f, b in messages)
    header = b"OHDR\x02\x02" + struct.pack("<I", len(body)) + body
    return header + struct.pack("<I", lookup3(header))


def set_attribute(item: Item, name: str, value: object, kind: str = "text") -> None:
    """Give an item an attribute, in place of one of this name."""
    item.attributes[name.encode()] = stored(value, kind)


def floats(values: object) -> bytes:
    """Numbers as the bytes of `f8`."""
    return np.asarray(values, "<f8").tobytes()
