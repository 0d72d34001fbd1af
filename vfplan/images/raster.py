"""The pixels of a PNG, JPEG, TIFF or BMP, decoded by OpenCV."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import ImageError
from vfplan.images.headers import Header, chosen_index

ROWS_AT_ONCE = 8
"""Rows of a page that are laid over black together. So few stay in the processor's cache, which
takes a quarter of the time of 256 rows."""
LIBJPEG_DAMAGE = ("Corrupt JPEG data", "Premature end of JPEG", "Invalid SOS", "Inconsistent prog")
"""How the lines begin by which libjpeg says that it made up a part of the picture."""


def decode_raster(
    data: bytes, header: Header, where: str, page: int | None
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The (H, W, 3) pixels of a file, red first, the right way up, transparent ones over black.

    page: which page of a TIFF, from 1; needed when there are several
    Raises `ImageError` if the file cannot be decoded.
    """
    import cv2

    index = chosen_index("page", page, header.pages, where)
    buffer = np.frombuffer(data, np.uint8)
    pixels = None
    with native_stderr() as log:
        try:
            if header.is_opaque:
                # OpenCV applies EXIF's orientation here.
                pixels = cv2.imdecode(buffer, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_ANYDEPTH)
            elif header.kind != "TIFF":
                pixels = cv2.imdecode(buffer, cv2.IMREAD_UNCHANGED)
            else:
                _, pages = cv2.imdecodemulti(buffer, cv2.IMREAD_UNCHANGED, range=(index, index + 1))
                if len(pages) > 0:
                    pixels = pages[0]
        except cv2.error as error:
            reason = " ".join(error.err.split())
            raise ImageError(
                f"cannot be decoded: {reason}. Export the slice again.", where=where
            ) from None
        log.seek(0)
        messages = log.read().decode(errors="replace").splitlines()
    if header.kind == "JPEG":
        # libjpeg makes up what it cannot decode, says so, and reports a success.
        for message in messages:
            if message.startswith(LIBJPEG_DAMAGE):
                raise ImageError(
                    f"the JPEG is damaged: {message}. Copy the file again.", where=where
                )
    if pixels is None:
        raise ImageError(
            f"the {header.kind} cannot be decoded. Export the slice again.", where=where
        )
    if pixels.dtype not in (np.uint8, np.uint16):
        raise ImageError(
            f"has {pixels.dtype} samples. Export the slice with 8 or 16 bits.", where=where
        )
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
