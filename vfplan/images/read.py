"""Read a planned slice: PNG, JPEG, TIFF, BMP or DICOM -> PlannedImage.

Pixels: u to the right, v down, and the *centre* of the top-left pixel is (0, 0).

What a file says of itself is read before any decoder may allocate for it, and no decoder is asked
for any other kind: PNG (ISO/IEC 15948), JPEG (ITU-T T.81), TIFF 6.0 and BigTIFF, BMP.
"""

from __future__ import annotations

import hashlib
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import ImageError, SettingError
from vfplan.images.tiff import HEIGHT, ORDER, ORIENTATION, WIDTH, directories
from vfplan.io.files import read_whole

PNG, JPEG, BMP = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"BM"
MOST_BYTES = 2**31 - 1  # more the decoders do not take
MAX_MEGAPIXELS = 64.0
"""Pixels that are read unless the caller says otherwise, in millions: 8000 x 8000, sixteen times a
large CT slice. A file of a megabyte can decode to gigabytes; a slice that is planned on does not.
"""
LARGEST_MEGAPIXELS = 268.5
"""The most that a caller may allow, in millions: 16384 x 16384 of one page."""
ROWS_AT_ONCE = 256
"""Rows of a page with alpha that are laid over black together; it bounds the memory in between."""
MOST_PAGES = 4096
MOST_SCANS = 200  # of a progressive JPEG, each a pass over the whole image; encoders make ten
LIBJPEG_DAMAGE = ("Corrupt JPEG data", "Premature end of JPEG", "Invalid SOS", "Inconsistent prog")


@dataclass(frozen=True, eq=False)
class PlannedImage:
    """A slice with a surgeon's drawing on it.

    Parameters
    ----------
    rgb
        (H, W, 3) uint8 or uint16, red first.
    pixel_spacing_mm
        (along u, between columns; along v, between rows) [mm/px]; `None` when nobody knows.
    sha256
        Of the file's bytes, lower-case hex; of the pixels for an array that came from no file.
    T_patient_image
        (4, 3) mapping [u v 1] to the patient's LPS frame [m]; DICOM only, `None` when unknown.
    instance
        DICOM's SOP instance UID; empty for other files.
    """

    rgb: NDArray[np.uint8] | NDArray[np.uint16]
    pixel_spacing_mm: tuple[float, float] | None = None
    sha256: str = ""
    T_patient_image: NDArray[np.float64] | None = None
    instance: str = ""

    @property
    def width_px(self) -> int:
        """Columns."""
        return self.rgb.shape[1]

    @property
    def height_px(self) -> int:
        """Rows."""
        return self.rgb.shape[0]


def as_image(image: PlannedImage | NDArray | str | Path) -> PlannedImage:
    """The image itself, an (H, W, 3) array of uint8 or uint16 wrapped as one, or a file, read.

    Raises `ImageError` for any other shape or type, and as `read_image` does.
    """
    if isinstance(image, PlannedImage):
        return image
    if isinstance(image, (str, Path)):
        return read_image(image)
    rgb = np.asarray(image)
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype not in (np.uint8, np.uint16) or not rgb.size:
        raise ImageError(
            "an image array is (H, W, 3) of uint8 or uint16, red first. "
            f"Got {rgb.shape} of {rgb.dtype}."
        )
    return PlannedImage(rgb, None, hashlib.sha256(np.ascontiguousarray(rgb)).hexdigest())


def read_image(
    path: str | Path,
    *,
    frame: int | None = None,
    pixel_spacing_mm: tuple[float, float] | None = None,
    imager_spacing: bool = False,
    max_megapixels: float = MAX_MEGAPIXELS,
) -> PlannedImage:
    """Read a planned slice.

    Parameters
    ----------
    path
        A PNG (8 or 16 bit, palette, alpha), JPEG, TIFF or BMP file, or DICOM with the `dicom`
        extra. EXIF orientation is applied; transparent pixels are laid over black.
    frame
        Which frame of a multi-frame DICOM or page of a TIFF, from 1; needed when there are several.
    pixel_spacing_mm
        (along u, along v) [mm/px], when the caller knows; it wins over the file's own.
    imager_spacing
        Accept DICOM's ImagerPixelSpacing, which is measured at the detector, not in the patient.
    max_megapixels
        A larger picture is refused before it is decoded, in millions of pixels.

    Raises
    ------
    ImageError
        The file is missing, not an image, damaged, or of a kind that is not supported.
    MissingExtra
        A DICOM file, and pydicom is not installed.
    """
    where = str(path)
    max_pixels = _max_pixels(max_megapixels)
    data = read_whole(Path(path), MOST_BYTES, ImageError)
    if not data:
        raise ImageError("is empty. Give an image.", where=where)
    sha256 = hashlib.sha256(data).hexdigest()
    if is_dicom(data):
        from vfplan.images.dicom import read_dicom

        rgb, spacing, place, own = read_dicom(data, where, frame, imager_spacing, max_pixels)
        return PlannedImage(rgb, pixel_spacing_mm or spacing, sha256, place, own)
    header = read_header(data, where, max_pixels)
    return PlannedImage(_decode(data, header, where, frame), pixel_spacing_mm, sha256)


def is_dicom(data: bytes) -> bool:
    """Whether the bytes begin as a DICOM file does (PS3.10 §7.1)."""
    return data[128:132] == b"DICM"


@dataclass(frozen=True)
class Header:
    """What an image file says of itself."""

    kind: str  # "PNG", "JPEG", "TIFF" or "BMP"
    pages: int = 1  # how many pictures
    opaque: bool = False  # known to have neither alpha nor pages
    orientation: int = 1  # EXIF's, 1 to 8, of a PNG; 1 for the others, which OpenCV turns itself


def read_header(data: bytes, where: str, max_pixels: int = int(1e6 * MAX_MEGAPIXELS)) -> Header:
    """The header of an image of at most `max_pixels`.

    Raises `ImageError` for another kind of file, one that is damaged, or a larger one.
    """
    kinds = {PNG: _png, JPEG: _jpeg, BMP: _bmp} | dict.fromkeys(ORDER, _tiff)
    for start, read in kinds.items():
        if data.startswith(start):
            try:
                return read(data, where, max_pixels)
            except (struct.error, IndexError):
                raise ImageError(
                    "its header is damaged or cut short. Export the slice again.", where=where
                ) from None
    raise ImageError(
        "is no PNG, JPEG, TIFF, BMP or DICOM. Export the slice as one of these.", where=where
    )


def _max_pixels(megapixels: float) -> int:
    if not 0 < megapixels <= LARGEST_MEGAPIXELS:
        raise SettingError(
            f"{megapixels:g} megapixels. Give more than 0 and at most {LARGEST_MEGAPIXELS:g}.",
            code="out-of-range",
            numbers={"max_megapixels": megapixels},
        )
    return int(1e6 * megapixels)


def check_size(width: int, height: int, where: str, max_pixels: int) -> None:
    """Raise `ImageError` for a page without pixels, or of more than are read."""
    if width <= 0 or height <= 0:
        raise ImageError(
            f"has {width} x {height} pixels. Export the slice again.",
            where=where,
            code="image-empty",
        )
    if width * height > max_pixels:
        raise ImageError(
            f"has {width} x {height} pixels, {1e-6 * width * height:.0f} million. At most "
            f"{1e-6 * max_pixels:.0f} million are read. --max-megapixels allows more.",
            where=where,
            code="image-too-large",
            numbers={"width_px": width, "height_px": height, "max_pixels": max_pixels},
        )


def _png(data: bytes, where: str, max_pixels: int) -> Header:
    if b"IEND" not in data[-64:]:  # decoders fill what is missing with grey and say nothing
        raise ImageError(
            "the PNG is cut short: it has no IEND chunk. Copy the file again.", where=where
        )
    check_size(*struct.unpack_from(">II", data, 16), where, max_pixels)
    at, orientation, frames, opaque = len(PNG), 1, 1, data[25] in (0, 2, 3)
    while at + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, at)
        if kind == b"acTL":
            frames = struct.unpack_from(">I", data, at + 8)[0]
        elif kind == b"tRNS":
            opaque = False
        elif kind == b"eXIf" and data[at + 8 : at + 12] in ORDER:
            tags = next(directories(data[at + 8 : at + 8 + size]), {})
            orientation = tags.get(ORIENTATION, 1)
        at += 12 + size
    if frames > 1:
        raise ImageError(f"is animated, {frames} frames. Export one picture.", where=where)
    return Header("PNG", opaque=opaque, orientation=orientation)


def _jpeg(data: bytes, where: str, max_pixels: int) -> Header:
    if b"\xff\xd9" not in data[-4096:]:
        raise ImageError(
            "the JPEG is cut short: it has no end marker. Copy the file again.", where=where
        )
    at = 2
    while True:
        if data[at] != 0xFF:
            raise IndexError
        marker = data[at + 1]
        if marker == 0xFF:  # filling
            at += 1
        elif 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, at + 5)
            check_size(width, height, where, max_pixels)
            break
        else:
            at += 2 + struct.unpack_from(">H", data, at + 2)[0]
    if (scans := data.count(b"\xff\xda")) > MOST_SCANS:
        raise ImageError(f"has {scans} scans. At most {MOST_SCANS} are read.", where=where)
    return Header("JPEG", opaque=True)


def _bmp(data: bytes, where: str, max_pixels: int) -> Header:
    old = struct.unpack_from("<I", data, 14)[0] == 12
    width, height = struct.unpack_from("<HH" if old else "<ii", data, 18)
    check_size(width, abs(height), where, max_pixels)  # below 0: from top to bottom
    return Header("BMP")


def _tiff(data: bytes, where: str, max_pixels: int) -> Header:
    pages = 0
    for pages, page in enumerate(directories(data), start=1):
        if pages > MOST_PAGES:
            raise ImageError(
                f"has more than {MOST_PAGES} pages. Export the page that is meant.", where=where
            )
        check_size(page.get(WIDTH, 0), page.get(HEIGHT, 0), where, max_pixels)
    return Header("TIFF", pages)


def _decode(data: bytes, header: Header, where: str, frame: int | None) -> NDArray:
    import cv2

    buffer = np.frombuffer(data, np.uint8)
    try:
        with _native_stderr() as said:
            if header.opaque and frame in (None, 1):  # EXIF orientation is applied here
                rgb = cv2.imdecode(buffer, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_ANYDEPTH)
            else:
                at = index_of("page", frame, header.pages, where)
                _, pages = cv2.imdecodemulti(buffer, cv2.IMREAD_UNCHANGED, range=(at, at + 1))
                rgb = _upright(_page(pages[0]), header.orientation) if len(pages) else None
            said.seek(0)
            lines = said.read().decode(errors="replace").splitlines()
    except cv2.error as error:
        raise ImageError(
            f"cannot be decoded: {error.err}. Export the slice again.", where=where
        ) from None
    # libjpeg makes up what it cannot decode, says so, and calls it a success.
    damage = next((line for line in lines if line.startswith(LIBJPEG_DAMAGE)), None)
    if damage and header.kind == "JPEG":
        raise ImageError(f"the JPEG is damaged: {damage}. Copy the file again.", where=where)
    if rgb is None:
        raise ImageError(
            f"the {header.kind} cannot be decoded. Export the slice again.", where=where
        )
    if rgb.dtype not in (np.uint8, np.uint16):
        raise ImageError(
            f"has {rgb.dtype} samples. Export the slice with 8 or 16 bits.", where=where
        )
    return rgb


def index_of(what: str, frame: int | None, count: int, where: str) -> int:
    """Of the page or frame asked for, which count from 1; raises `ImageError` if there is none."""
    if frame is None and count > 1:
        raise ImageError(f"has {count} {what}s. Choose one, 1 to {count} (--frame).", where=where)
    if count < 1:
        raise ImageError(
            f"says that it has {count} {what}s. Export the slice again.", where=where,
            code="no-frames", numbers={"count": count},
        )  # fmt: skip
    at = 0 if frame is None else frame - 1
    if not 0 <= at < count:
        raise ImageError(f"has no {what} {frame}. It has {count}, from 1.", where=where)
    return at


def _page(page: NDArray) -> NDArray:
    """A page in colour, red first; what is transparent is laid over black."""
    import cv2

    if page.ndim == 2 or page.shape[2] == 3:
        return cv2.cvtColor(page, cv2.COLOR_GRAY2RGB if page.ndim == 2 else cv2.COLOR_BGR2RGB)
    full = np.iinfo(page.dtype).max
    rgb = np.empty((*page.shape[:2], 3), page.dtype)
    for first in range(0, len(page), ROWS_AT_ONCE):
        rows = page[first : first + ROWS_AT_ONCE]
        alpha = rows[..., 3:].astype(np.uint32)
        rgb[first : first + ROWS_AT_ONCE] = (rows[..., 2::-1] * alpha + full // 2) // full
    return rgb


def _upright(rgb: NDArray, orientation: int) -> NDArray:
    """A PNG with alpha, turned as its EXIF says (OpenCV does so for the others)."""
    if orientation in (5, 6, 7, 8):
        rgb = rgb.transpose(1, 0, 2)
    if orientation in (2, 3, 6, 7):
        rgb = rgb[:, ::-1]
    if orientation in (3, 4, 7, 8):
        rgb = rgb[::-1]
    return np.ascontiguousarray(rgb)


@contextmanager
def _native_stderr() -> Iterator[BinaryIO]:
    """Keep libpng, libjpeg and others off stderr; yields a file of what they said."""
    saved = None
    with os.fdopen(os.memfd_create("native stderr"), "w+b") as said:  # 2, where there is no stderr
        with suppress(OSError):
            saved = os.dup(2)
        try:
            os.dup2(said.fileno(), 2)
            yield said
        finally:
            if saved is None:
                os.close(2)
            else:
                os.dup2(saved, 2)
                os.close(saved)
