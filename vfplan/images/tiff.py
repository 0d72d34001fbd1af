"""The directories of a TIFF (6.0 and BigTIFF), in which EXIF is written too."""

from __future__ import annotations

import struct
from collections.abc import Iterator

ORDER = {b"II*\0": "<", b"MM\0*": ">", b"II+\0": "<", b"MM\0+": ">"}  # of bytes, by the first four
WIDTH = 0x0100
"""Tag of the number of columns."""
HEIGHT = 0x0101
"""Tag of the number of rows."""
ORIENTATION = 0x0112
"""Tag of EXIF's orientation, 1 to 8."""


def directories(data: bytes) -> Iterator[dict[int, int]]:
    """The whole numbers of each directory, by their tag.

    Raises `struct.error` or `IndexError` where the data are damaged or cut short.
    """
    order, big = ORDER[data[:4]], data[2:4] in (b"+\0", b"\0+")
    word, count, entry = ("Q", "Q", 20) if big else ("I", "H", 12)
    at = struct.unpack_from(order + word, data, 8 if big else 4)[0]
    while at:
        size = struct.unpack_from(order + count, data, at)[0]
        first = at + struct.calcsize(count)
        if size > 4096:
            raise IndexError
        found = {}
        for k in range(size):
            place = first + k * entry
            tag, kind = struct.unpack_from(order + "HH", data, place)
            if kind in (3, 4):
                form = order + {3: "H", 4: "I"}[kind]
                found[tag] = struct.unpack_from(form, data, place + (12 if big else 8))[0]
        yield found
        at = struct.unpack_from(order + word, data, first + size * entry)[0]
