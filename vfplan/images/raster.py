"""The pixels of a PNG, JPEG, TIFF or BMP, decoded by OpenCV, and what its header says.

A header is read before any decoder may allocate memory for the picture, and no decoder is asked for
another kind of file: PNG (ISO/IEC 15948), JPEG (ITU-T T.81), TIFF 6.0 and BigTIFF, BMP.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import IntEnum
from typing import BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import ImageError

PNG_START = b"\x89PNG\r\n\x1a\n"
JPEG_START = b"\xff\xd8\xff"
BMP_START = b"BM"
# The first four bytes of a TIFF, with the order of bytes that they stand for.
TIFF_BYTE_ORDERS = {b"II*\0": "<", b"MM\0*": ">", b"II+\0": "<", b"MM\0+": ">"}
# The third and fourth byte of a BigTIFF, whose offsets have 64 bits.
BIG_TIFF = (b"+\0", b"\0+")

# Colour types of a PNG without alpha: grey, colour, palette.
OPAQUE_PNG_TYPES = {0, 2, 3}
# Pages of a TIFF, and tags of one page. Stacks of slices and the standards have some hundreds.
MAX_TIFF_PARTS = 4096
# Scans of a JPEG. Each is a pass over the whole picture, and encoders write about ten.
MAX_JPEG_SCANS = 200

# TIFF's types of whole numbers, of 16 and of 32 bits, as `struct` names them.
WHOLE_NUMBERS = {3: "H", 4: "I"}

DAMAGED_HEADER = "its header is damaged or cut short. Export the slice again."


class Tag(IntEnum):
    """The tags of TIFF 6.0 and EXIF that are read: size, and how the picture is turned, 1 to 8."""

    WIDTH = 0x0100
    HEIGHT = 0x0101
    ORIENTATION = 0x0112


@dataclass(frozen=True)
class Header:
    """What a file says of itself.

    kind: the kind of file
    pages: how many pictures it holds
    is_opaque: whether it is known to have one page and no alpha
    orientation: EXIF's, 1 to 8, of a PNG; 1 for other kinds, which OpenCV turns itself
    """

    kind: Literal["PNG", "JPEG", "TIFF", "BMP"]
    pages: int = 1
    is_opaque: bool = False
    orientation: int = 1


def is_picture(data: bytes) -> bool:
    """Whether the bytes begin as a file does whose header can be read here."""
    return data.startswith((PNG_START, JPEG_START, BMP_START, *TIFF_BYTE_ORDERS))


def read_header(data: bytes, max_pixels: int) -> Header:
    """The header of an image of at most `max_pixels`.

    Raises `ImageError` for another kind of file, a damaged one, or a larger one.
    """
    try:
        if data.startswith(PNG_START):
            return png_header(data, max_pixels)
        if data.startswith(JPEG_START):
            return jpeg_header(data, max_pixels)
        if data.startswith(BMP_START):
            return bmp_header(data, max_pixels)
        if data[:4] in TIFF_BYTE_ORDERS:
            return tiff_header(data, max_pixels)
    except (struct.error, IndexError):
        raise ImageError(DAMAGED_HEADER) from None
    raise ImageError("is no PNG, JPEG, TIFF, BMP or DICOM. Export the slice as one of these.")


def png_header(data: bytes, max_pixels: int) -> Header:
    """The header of a PNG."""
    # Decoders fill what is missing with grey and do not tell.
    if b"IEND" not in data[-64:]:
        raise ImageError("the PNG is cut short: it has no IEND chunk. Copy the file again.")
    width, height = struct.unpack_from(">II", data, 16)
    check_size(width, height, max_pixels)
    is_opaque = data[25] in OPAQUE_PNG_TYPES
    frames = orientation = 1
    position = len(PNG_START)
    while position + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, position)
        content = position + 8
        if kind == b"acTL":
            frames = struct.unpack_from(">I", data, content)[0]
        elif kind == b"tRNS":
            is_opaque = False
        elif kind == b"eXIf":
            exif = data[content : content + size]
            if exif[:4] in TIFF_BYTE_ORDERS:
                tags = next(tiff_directories(exif), {})
                orientation = tags.get(Tag.ORIENTATION, 1)
        # A checksum of four bytes follows the content.
        position = content + size + 4
    if frames > 1:
        raise ImageError(f"is an animation of {frames} frames. Export one picture.")
    return Header("PNG", is_opaque=is_opaque, orientation=orientation)


def jpeg_header(data: bytes, max_pixels: int) -> Header:
    """The header of a JPEG."""
    if b"\xff\xd9" not in data[-4096:]:
        raise ImageError("the JPEG is cut short: it has no end marker. Copy the file again.")
    position = 2
    while True:
        if data[position] != 0xFF:
            raise ImageError(DAMAGED_HEADER)
        marker = data[position + 1]
        if marker == 0xFF:
            # A marker may be preceded by any number of bytes 0xFF.
            position += 1
        elif 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            # The start of a frame, which holds the picture's size.
            height, width = struct.unpack_from(">HH", data, position + 5)
            check_size(width, height, max_pixels)
            break
        else:
            position += 2 + struct.unpack_from(">H", data, position + 2)[0]
    scans = data.count(b"\xff\xda")
    if scans > MAX_JPEG_SCANS:
        raise ImageError(
            f"has {scans} scans, and at most {MAX_JPEG_SCANS} are read. Export the slice again."
        )
    return Header("JPEG", is_opaque=True)


def bmp_header(data: bytes, max_pixels: int) -> Header:
    """The header of a BMP."""
    # The header of OS/2 1.x, of 12 bytes, has numbers of 16 bits.
    numbers = "<ii"
    if struct.unpack_from("<I", data, 14)[0] == 12:
        numbers = "<HH"
    width, height = struct.unpack_from(numbers, data, 18)
    # A height below 0 says that the rows run from top to bottom.
    check_size(width, abs(height), max_pixels)
    return Header("BMP")


def tiff_header(data: bytes, max_pixels: int) -> Header:
    """The header of a TIFF."""
    pages = 0
    for tags in tiff_directories(data):
        pages += 1
        if pages > MAX_TIFF_PARTS:
            raise ImageError(
                f"has more than {MAX_TIFF_PARTS} pages. Export the page that is meant."
            )
        check_size(tags.get(Tag.WIDTH, 0), tags.get(Tag.HEIGHT, 0), max_pixels)
    return Header("TIFF", pages)


def tiff_directories(data: bytes) -> Iterator[dict[int, int]]:
    """The whole numbers of each directory of a TIFF, by their tag. EXIF is written so too.

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
        tags = {}
        for _ in range(count):
            tag, value_type = struct.unpack_from(order + "HH", data, entry)
            if value_type in WHOLE_NUMBERS:
                number_format = order + WHOLE_NUMBERS[value_type]
                tags[tag] = struct.unpack_from(number_format, data, entry + value_offset)[0]
            entry += entry_bytes
        yield tags
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
            code="no-frames",
            numbers={"count": count},
        )
    if number is None and count > 1:
        raise ImageError(f"has {count} {what}s. Choose one, 1 to {count}, with --frame.")
    if number is not None and not 1 <= number <= count:
        raise ImageError(f"has no {what} {number}. Choose one, 1 to {count}, with --frame.")
    if number is None:
        return 0
    return number - 1


# Rows of a page that are laid over black together. So few stay in the processor's cache, which
# takes a quarter of the time of 256 rows.
ROWS_AT_ONCE = 8
# How the lines begin by which libjpeg says that it made up a part of the picture.
LIBJPEG_DAMAGE = ("Corrupt JPEG data", "Premature end of JPEG", "Invalid SOS", "Inconsistent prog")


def decode_raster(
    data: bytes, header: Header, page: int | None
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The (H, W, 3) pixels of a file, red first, the right way up, transparent ones over black.

    page: which page of a TIFF, from 1; needed when there are several
    Raises `ImageError` if the file cannot be decoded.
    """
    import cv2

    index = chosen_index("page", page, header.pages)
    buffer = np.frombuffer(data, np.uint8)
    with native_stderr() as log:
        try:
            if header.is_opaque:
                # OpenCV applies EXIF's orientation here.
                pixels = cv2.imdecode(buffer, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_ANYDEPTH)
            elif header.kind != "TIFF":
                pixels = cv2.imdecode(buffer, cv2.IMREAD_UNCHANGED)
            else:
                _, pages = cv2.imdecodemulti(buffer, cv2.IMREAD_UNCHANGED, range=(index, index + 1))
                pixels = None
                if len(pages):
                    pixels = pages[0]
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
        rgb = cv2.cvtColor(pixels, cv2.COLOR_GRAY2RGB)
    elif pixels.shape[2] == 3:
        rgb = cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB)
    else:
        rgb = over_black(pixels)
    return upright(rgb, header.orientation)


def over_black(
    bgra: NDArray[np.uint8] | NDArray[np.uint16],
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """A page in colour, red first, its transparent pixels laid over black."""
    full = np.iinfo(bgra.dtype).max
    rgb = np.empty((*bgra.shape[:2], 3), bgra.dtype)
    for first in range(0, len(bgra), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        alpha = bgra[rows, :, 3].astype(np.uint32)
        for channel in range(3):
            # Half of `full` is added, so that the division rounds to the nearest number.
            values = bgra[rows, :, 2 - channel] * alpha
            values += full // 2
            values //= full
            rgb[rows, :, channel] = values
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
    with os.fdopen(os.memfd_create("native stderr"), "w+b") as log:
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
