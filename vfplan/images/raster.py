"""The pixels of a PNG, JPEG, TIFF or BMP, decoded by OpenCV, and what its header says.

A header is read before any decoder may allocate memory for the picture, and no decoder is asked for
another kind of file: PNG (ISO/IEC 15948), JPEG (ITU-T T.81), TIFF 6.0 and BigTIFF, BMP.
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import IntEnum
from typing import BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import ImageError
from vfplan.io.files import nameless_file

PNG_START = b"\x89PNG\r\n\x1a\n"
# Where a PNG's header chunk ends.
PNG_HEADER_END = 33

# How the text of a picture that was made flat begins.
MADE_FLAT = b"vfplan-made-flat\0"
# The first four bytes of a TIFF, with the order of bytes that they stand for.
TIFF_BYTE_ORDERS = {b"II*\0": "<", b"MM\0*": ">", b"II+\0": "<", b"MM\0+": ">"}
# The third and fourth byte of a BigTIFF, whose offsets have 64 bits.
BIG_TIFF = (b"+\0", b"\0+")

# Pages of a TIFF, and tags of one page. Stacks of slices and the standards have some hundreds.
MAX_TIFF_PARTS = 4096
# Scans of a JPEG. Each is a pass over the whole picture, and encoders write about ten.
MAX_JPEG_SCANS = 200

# TIFF's types of whole numbers, of 16 and of 32 bits, as `struct` names them.
WHOLE_NUMBERS = {3: "H", 4: "I"}

DAMAGED_HEADER = "its header is damaged or cut short. Export the slice again."


class Tag(IntEnum):
    """The tags of TIFF 6.0 and EXIF that are read.

    PHOTOMETRIC: what the samples of a pixel are; ORIENTATION: how the picture is turned, 1 to 8;
    SAMPLES: how many a pixel has; PLANES: 2 where each has a plane of its own; EXTRA: what the
    first sample beyond the colours is
    """

    WIDTH = 0x0100
    HEIGHT = 0x0101
    PHOTOMETRIC = 0x0106
    ORIENTATION = 0x0112
    SAMPLES = 0x0115
    PLANES = 0x011C
    EXTRA = 0x0152


# A directory's whole numbers by their tag.
Tags = dict[int, int]

# What EXTRA says of a sample: that the colours are multiplied by it, or are to be.
PREMULTIPLIED, ALPHA = 1, 2
# Photometric interpretation of four inks.
SEPARATED = 5
# Samples that make a colour, by the photometric interpretation; one of all others.
COLOURS = {2: 3, SEPARATED: 4, 6: 3}
# TIFF's name of a whole number of 16 bits.
SHORT = 3
# The end of what a scan of a JPEG holds: a marker that neither stands for a byte 0xFF nor restarts
# the decoder.
END_OF_SCAN = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")


@dataclass(frozen=True)
class Header:
    """What a file says of itself.

    kind: the kind of file
    end: the number of bytes that belong to it
    is_opaque: whether it is known to have one page and no alpha
    tags: EXIF's whole numbers, or those of each page of a TIFF
    orientations: where a TIFF says how its pages are turned: the offsets of these entries
    made_flat: what `vfplan rectify` says in a PNG of how it was made
    """

    kind: Literal["PNG", "JPEG", "TIFF", "BMP"]
    end: int
    is_opaque: bool = False
    tags: tuple[Tags, ...] = ({},)
    orientations: tuple[int, ...] = ()
    made_flat: bytes = b""

    def orientation(self, index: int) -> int:
        """How a page is turned, 1 to 8; what is no such number says nothing."""
        value = self.tags[index].get(Tag.ORIENTATION, 1)
        return value if 1 <= value <= 8 else 1


def png_header(data: bytes, max_pixels: int) -> Header:
    """The header of a PNG."""
    width, height = struct.unpack_from(">II", data, 16)
    check_size(width, height, max_pixels)
    # The colour types without alpha: grey, colour, palette.
    is_opaque = data[25] in (0, 2, 3)
    frames = 1
    tags: Tags = {}
    position = len(PNG_START)
    kind, made_flat = b"", b""
    while kind != b"IEND":
        # Decoders fill what is missing with grey and do not tell.
        if position + 12 > len(data):
            raise ImageError("the PNG is cut short: it has no IEND chunk. Copy the file again.")
        size, kind = struct.unpack_from(">I4s", data, position)
        content = position + 8
        if kind == b"acTL":
            frames = struct.unpack_from(">I", data, content)[0]
        elif kind == b"tRNS":
            is_opaque = False
        elif kind == b"eXIf":
            tags = exif_tags(data[content : content + size])
        elif kind == b"tEXt" and data.startswith(MADE_FLAT, content):
            made_flat = data[content + len(MADE_FLAT) : content + size]
        # A checksum of four bytes follows the content.
        position = content + size + 4
    if frames > 1:
        raise ImageError(f"is an animation of {frames} frames. Export one picture.")
    return Header("PNG", position, is_opaque, (tags,), made_flat=made_flat)


def with_made_flat(png: bytes, text: str) -> bytes:
    """A PNG that says how it was made flat, in a tEXt chunk behind its header."""
    chunk = b"tEXt" + MADE_FLAT + text.encode()
    chunk = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return png[:PNG_HEADER_END] + chunk + png[PNG_HEADER_END:]


def exif_tags(exif: bytes) -> Tags:
    """The whole numbers of the first directory of EXIF."""
    if exif[:4] not in TIFF_BYTE_ORDERS:
        return {}
    tags, _ = next(tiff_directories(exif), ({}, 0))
    return tags


def jpeg_header(data: bytes, max_pixels: int) -> Header:
    """The header of a JPEG."""
    is_sized, scans = False, 0
    tags: Tags = {}
    position = 2
    # Up to the marker of the picture's end.
    while (marker := data[position + 1]) != 0xD9:
        if data[position] != 0xFF:
            raise ImageError(DAMAGED_HEADER)
        content = position + 4
        if marker == 0xFF:
            # A marker may be preceded by any number of bytes 0xFF.
            position += 1
            continue
        position += 2 + struct.unpack_from(">H", data, position + 2)[0]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            # The start of a frame, which holds the picture's size.
            if is_sized:
                raise ImageError("the JPEG is damaged: it begins twice. Copy the file again.")
            height, width = struct.unpack_from(">HH", data, content + 1)
            check_size(width, height, max_pixels)
            is_sized = True
        elif marker == 0xE1 and data[content : content + 6] == b"Exif\0\0" and not tags:
            tags = exif_tags(data[content + 6 : position])
        elif marker == 0xDA:
            scans += 1
            if scans > MAX_JPEG_SCANS:
                raise ImageError(f"has more than {MAX_JPEG_SCANS} scans. Export the slice again.")
            end = END_OF_SCAN.search(data, position)
            if end is None:
                raise ImageError("the JPEG is cut short: it has no end marker. Copy it again.")
            position = end.start()
    return Header("JPEG", position + 2, is_opaque=True, tags=(tags,))


def bmp_header(data: bytes, max_pixels: int) -> Header:
    """The header of a BMP."""
    # The header of OS/2 1.x, of 12 bytes, has numbers of 16 bits.
    numbers = "<HH" if struct.unpack_from("<I", data, 14)[0] == 12 else "<ii"
    width, height = struct.unpack_from(numbers, data, 18)
    # A height below 0 says that the rows run from top to bottom.
    check_size(width, abs(height), max_pixels)
    # Only a header of 56 bytes or more, with masks, can say that there is transparency.
    has_masks = struct.unpack_from("<I", data, 14)[0] >= 56 and data[30] in (3, 6)
    return Header("BMP", len(data), is_opaque=not (has_masks and any(data[66:70])))


def tiff_header(data: bytes, max_pixels: int) -> Header:
    """The header of a TIFF."""
    pages, orientations = [], []
    for tags, orientation in tiff_directories(data):
        pages.append({tag: tags[tag] for tag in Tag if tag in tags})
        orientations += [orientation] if orientation else []
        if len(pages) > MAX_TIFF_PARTS:
            raise ImageError(
                f"has more than {MAX_TIFF_PARTS} pages. Export the page that is meant."
            )
        check_size(tags.get(Tag.WIDTH, 0), tags.get(Tag.HEIGHT, 0), max_pixels)
    return Header("TIFF", len(data), False, tuple(pages), tuple(orientations))


READERS = {
    PNG_START: png_header,
    b"\xff\xd8\xff": jpeg_header,
    b"BM": bmp_header,
    **dict.fromkeys(TIFF_BYTE_ORDERS, tiff_header),
}


def read_header(data: bytes, max_pixels: int) -> Header:
    """The header of an image of at most `max_pixels`.

    Raises `ImageError` for another kind of file, a damaged one, or a larger one.
    """
    for start, reader in READERS.items():
        if data.startswith(start):
            try:
                return reader(data, max_pixels)
            except (struct.error, IndexError):
                raise ImageError(DAMAGED_HEADER) from None
    raise ImageError("is no PNG, JPEG, TIFF, BMP or DICOM. Export the slice as one of these.")


def unturned(data: bytes, orientations: tuple[int, ...]) -> bytes:
    """A TIFF whose pages say that they are not turned, so that no decoder turns them.

    OpenCV would mirror inside each tile.
    """
    changed = bytearray(data)
    number, order = ("Q" if data[2:4] in BIG_TIFF else "I"), TIFF_BYTE_ORDERS[data[:4]]
    for entry in orientations:
        struct.pack_into(f"{order}HH{number}H", changed, entry, Tag.ORIENTATION, SHORT, 1, 1)
    return bytes(changed)


def tiff_directories(data: bytes) -> Iterator[tuple[Tags, int]]:
    """The whole numbers of each directory of a TIFF, by their tag, and where its orientation is.

    EXIF is written so too. A directory without an orientation has it at 0.

    Raises `struct.error` or `IndexError` where the data are damaged or cut short.
    """
    order = TIFF_BYTE_ORDERS[data[:4]]
    offset, count_type, first_offset, entry_bytes, value_offset = (
        ("Q", "Q", 8, 20, 12) if data[2:4] in BIG_TIFF else ("I", "H", 4, 12, 8)
    )
    offset_format, count_format = order + offset, order + count_type
    position = struct.unpack_from(offset_format, data, first_offset)[0]
    while position:
        count = struct.unpack_from(count_format, data, position)[0]
        if count > MAX_TIFF_PARTS:
            raise IndexError(f"{count} tags")
        entry = position + struct.calcsize(count_format)
        tags, orientation = {}, 0
        for _ in range(count):
            tag, value_type = struct.unpack_from(order + "HH", data, entry)
            if value_type in WHOLE_NUMBERS:
                number_format = order + WHOLE_NUMBERS[value_type]
                tags[tag] = struct.unpack_from(number_format, data, entry + value_offset)[0]
            if tag == Tag.ORIENTATION:
                orientation = entry
            entry += entry_bytes
        yield tags, orientation
        position = struct.unpack_from(offset_format, data, entry)[0]


def check_size(width: int, height: int, max_pixels: int) -> None:
    """Raise `ImageError` for a page without pixels, or of more than are read."""
    if width <= 0 or height <= 0:
        raise ImageError(
            f"has {width} x {height} pixels. Export the slice again.", code="image-empty"
        )
    if width * height > max_pixels:
        raise ImageError(
            f"has {width} x {height} pixels, which are more than the {max_pixels:,} that are read. "
            "Crop the slice, or raise --max-megapixels.",
            code="image-too-large",
            numbers={"width_px": width, "height_px": height, "max_pixels": max_pixels},
        )


def chosen_index(what: str, number: int | None, count: int) -> int:
    """The index, from 0, of the page or frame that was chosen by its number, from 1.

    Raises `ImageError` if there is none, or several of which none was chosen.
    """
    if count < 1:
        raise ImageError(
            f"says that it has {count} {what}s. Export the slice again.",
            code="no-frames", numbers={"count": count},
        )  # fmt: skip
    if number is None and count > 1:
        raise ImageError(f"has {count} {what}s. Choose one, 1 to {count}, with --frame.")
    if number is not None and not 1 <= number <= count:
        raise ImageError(f"has no {what} {number}. Choose one, 1 to {count}, with --frame.")
    return (number or 1) - 1


# (H, W, 3 or 4) pixels of a page in colour.
ColourPixels = NDArray[np.uint8] | NDArray[np.uint16]

# Rows of a page that are laid over black together. So few stay in the processor's cache, which
# takes a quarter of the time of 256 rows.
ROWS_AT_ONCE = 8
# How the lines begin by which libjpeg says that it made up a part of the picture.
LIBJPEG_DAMAGE = ("Corrupt JPEG data", "Premature end of JPEG", "Invalid SOS", "Inconsistent prog")


def decode_raster(data: bytes, header: Header, index: int) -> ColourPixels:
    """The (H, W, 3) pixels of a file as they are stored, red first, transparent ones over black.

    index: which page of a TIFF, from 0
    Raises `ImageError` if the file cannot be decoded.
    """
    import cv2

    if header.orientations:
        data = unturned(data, header.orientations)
    buffer = np.frombuffer(data, np.uint8, header.end)
    opaque = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    with native_stderr() as log:
        try:
            if header.is_opaque:
                pixels = cv2.imdecode(buffer, opaque)
            elif header.kind != "TIFF":
                pixels = cv2.imdecode(buffer, cv2.IMREAD_UNCHANGED)
            else:
                _, pages = cv2.imdecodemulti(buffer, cv2.IMREAD_UNCHANGED, range=(index, index + 1))
                pixels = pages[0] if len(pages) else None
        except cv2.error as error:
            reason = " ".join(error.err.split())
            raise ImageError(f"cannot be decoded: {reason}. Export the slice again.") from None
        log.seek(0)
        messages = log.read().decode(errors="replace").splitlines()
    # libjpeg makes up what it cannot decode, says so, and reports a success.
    damage = [message for message in messages if message.startswith(LIBJPEG_DAMAGE)]
    if header.kind == "JPEG" and damage:
        raise ImageError(f"the JPEG is damaged: {damage[0]}. Copy the file again.")
    if pixels is None:
        raise ImageError(f"the {header.kind} cannot be decoded. Export the slice again.")
    if pixels.dtype not in (np.uint8, np.uint16):
        raise ImageError(f"has {pixels.dtype} samples. Export the slice with 8 or 16 bits.")
    if header.is_opaque:
        return pixels
    if pixels.ndim == 2:
        return cv2.cvtColor(pixels, cv2.COLOR_GRAY2RGB)
    tags = header.tags[index]
    is_deep = pixels.dtype == np.uint16
    # OpenCV takes both for pixels of three colours in a row.
    if is_deep and (tags.get(Tag.PLANES) == 2 or tags.get(Tag.PHOTOMETRIC) == SEPARATED):
        raise ImageError(
            "holds inks, or planes of colours, of 16 bits. Export the slice as RGB in one plane."
        )
    if pixels.shape[2] == 3:
        return cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB)
    # Of 8 bits libtiff multiplies the colours itself.
    is_alpha = is_deep and tags.get(Tag.EXTRA) == ALPHA
    if header.kind == "BMP":
        is_alpha = bool(pixels[..., 3].any())
    if is_alpha or header.kind == "PNG":
        return over_black(pixels)
    return np.ascontiguousarray(pixels[..., 2::-1])


def over_black(bgra: ColourPixels) -> ColourPixels:
    """A page in colour, red first, its transparent pixels laid over black."""
    full = np.iinfo(bgra.dtype).max
    rgb = np.empty((*bgra.shape[:2], 3), bgra.dtype)
    for first in range(0, len(bgra), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        alpha = bgra[rows, :, 3:].astype(np.uint32)
        # Half of `full` is added, so that the division rounds to the nearest number.
        rgb[rows] = (bgra[rows, :, 2::-1] * alpha + full // 2) // full
    return rgb


def upright(rgb: NDArray, orientation: int) -> NDArray:
    """A picture turned as EXIF says."""
    if orientation in (5, 6, 7, 8):
        rgb = rgb.transpose(1, 0, 2)
    if orientation in (2, 3, 6, 7):
        rgb = rgb[:, ::-1]
    if orientation in (3, 4, 7, 8):
        rgb = rgb[::-1]
    return np.ascontiguousarray(rgb)


@contextmanager
def native_stderr() -> Iterator[BinaryIO]:
    """Keep what libpng, libjpeg and others print off stderr; yields a file that holds it."""
    saved = None
    # A program may have closed its stderr. The file then has the descriptor 2 itself.
    with nameless_file() as log:
        with suppress(OSError):
            saved = os.dup(2)
        try:
            os.dup2(log.fileno(), 2)
            yield log
        finally:
            if saved is None:
                os.close(2)
            else:
                os.dup2(saved, 2)
                os.close(saved)
