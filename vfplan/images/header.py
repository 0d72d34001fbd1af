"""What an image file says of itself, read before any decoder may allocate for it.

Only four kinds of file are told apart, by their first bytes; a decoder for any other is never
asked. Sources: PNG (ISO/IEC 15948), JPEG (ITU-T T.81), TIFF 6.0 and BigTIFF, BMP.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from vfplan.errors import ImageError

PNG, JPEG, BMP = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"BM"
TIFF = {b"II*\0": "<", b"MM\0*": ">", b"II+\0": "<", b"MM\0+": ">"}
MOST_PIXELS = 1 << 28  # 16384 x 16384, of one page
MOST_PAGES = 4096
MOST_SCANS = 200  # of a progressive JPEG, each a pass over the whole image; encoders make ten
ORIENTATION = 0x0112
_WIDTH, _HEIGHT = 256, 257


@dataclass(frozen=True)
class Header:
    """What a file holds."""

    kind: str  # "PNG", "JPEG", "TIFF" or "BMP"
    pages: int = 1  # how many pictures
    orientation: int = 1  # EXIF's, 1 to 8, of a PNG; 1 for the others, which OpenCV turns itself


def read_header(data: bytes, where: str) -> Header:
    """The header of an image, whose sizes can be borne.

    Raises `ImageError` for any other kind of file, a damaged header, more than `MOST_PIXELS` in a
    page, `MOST_PAGES` or `MOST_SCANS`.
    """
    try:
        if data.startswith(PNG):
            return _png(data, where)
        if data.startswith(JPEG):
            return _jpeg(data, where)
        if data[:4] in TIFF:
            return _tiff(data, where)
        if data.startswith(BMP):
            return _bmp(data, where)
    except (struct.error, IndexError):
        raise ImageError("its header is damaged or cut short", where=where) from None
    raise ImageError("is not an image that can be read (PNG, JPEG, TIFF, BMP, DICOM)", where=where)


def is_dicom(data: bytes) -> bool:
    """Whether the bytes begin as a DICOM file does (PS3.10 §7.1)."""
    return data[128:132] == b"DICM"


def check_size(width: int, height: int, where: str) -> None:
    """Raise `ImageError` for a page without pixels, or of more than are read."""
    if not 0 < width * height <= MOST_PIXELS or width < 0:
        raise ImageError(
            f"{width} x {height} pixels; at least one and at most {MOST_PIXELS} are read",
            where=where,
        )


def _png(data: bytes, where: str) -> Header:
    check_size(*struct.unpack_from(">II", data, 16), where)
    orientation, frames = 1, 1
    for kind, chunk in _chunks(data):
        if kind == b"acTL":
            frames = struct.unpack_from(">I", chunk)[0]
        elif kind == b"eXIf" and chunk[:4] in TIFF:
            (entries, _), *_ = _directories(chunk)
            orientation = entries.get(ORIENTATION, 1)
    if frames > 1:
        raise ImageError(f"is animated, {frames} frames; one picture is wanted", where=where)
    return Header("PNG", orientation=orientation)


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = len(PNG)
    while at + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        yield kind, data[at + 8 : at + 8 + size] if kind in (b"acTL", b"eXIf") else b""
        at += 12 + size


def _jpeg(data: bytes, where: str) -> Header:
    at = 2
    while True:
        if data[at] != 0xFF:
            raise IndexError
        marker = data[at + 1]
        if marker == 0xFF:  # filling
            at += 1
        elif 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, at + 5)
            check_size(width, height, where)
            break
        else:
            at += 2 + struct.unpack_from(">H", data, at + 2)[0]
    if (scans := data.count(b"\xff\xda")) > MOST_SCANS:
        raise ImageError(f"has {scans} scans; at most {MOST_SCANS} are read", where=where)
    return Header("JPEG")


def _bmp(data: bytes, where: str) -> Header:
    old = struct.unpack_from("<I", data, 14)[0] == 12
    width, height = struct.unpack_from("<HH" if old else "<ii", data, 18)
    check_size(width, abs(height), where)  # below 0: from top to bottom
    return Header("BMP")


def _tiff(data: bytes, where: str) -> Header:
    pages = 0
    for entries, _ in _directories(data):
        pages += 1
        if pages > MOST_PAGES:
            raise ImageError(f"has more than {MOST_PAGES} pages", where=where)
        check_size(entries.get(_WIDTH, 0), entries.get(_HEIGHT, 0), where)
    return Header("TIFF", pages)


def _directories(data: bytes) -> Iterator[tuple[dict[int, int], int]]:
    """(whole numbers by their tag, offset) of each directory of a TIFF."""
    order, big = TIFF[data[:4]], data[2:4] in (b"+\0", b"\0+")
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
        yield found, at
        at = struct.unpack_from(order + word, data, first + size * entry)[0]
