"""Read a planned slice: PNG, JPEG, TIFF, BMP or DICOM -> PlannedImage.

Pixels: u to the right, v down, and the *centre* of the top-left pixel is (0, 0).
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import ImageError
from vfplan.images.header import JPEG, PNG, Header, is_dicom, read_header
from vfplan.io.reading import read_whole

MOST_BYTES = 2**31 - 1  # more the decoders do not take
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
            "an image array is (H, W, 3) of uint8 or uint16, red first; "
            f"got {rgb.shape} of {rgb.dtype}"
        )
    return PlannedImage(rgb, None, hashlib.sha256(np.ascontiguousarray(rgb)).hexdigest())


def read_image(
    path: str | Path,
    *,
    frame: int | None = None,
    pixel_spacing_mm: tuple[float, float] | None = None,
    imager_spacing: bool = False,
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

    Raises
    ------
    ImageError
        The file is missing, not an image, damaged, or of a kind that is not supported.
    MissingExtra
        A DICOM file, and pydicom is not installed.
    """
    data = _bytes(Path(path))
    where = str(path)
    sha256 = hashlib.sha256(data).hexdigest()
    if is_dicom(data):
        from vfplan.images.dicom import read_dicom

        with _scratch("DICOM") as file:
            file.write(data)
            file.flush()
            rgb, spacing, place, own = read_dicom(file, where, frame, imager_spacing)
        return PlannedImage(rgb, pixel_spacing_mm or spacing, sha256, place, own)
    _refuse_truncated(data, where)
    header = read_header(data, where)
    return PlannedImage(_decode(data, header, where, frame), pixel_spacing_mm, sha256)


def _bytes(path: Path) -> bytes:
    data = read_whole(path, MOST_BYTES, ImageError)
    if not data:
        raise ImageError("is empty; an image is wanted", where=str(path))
    return data


def _refuse_truncated(data: bytes, where: str) -> None:
    # Decoders fill what is missing with grey and say nothing.
    if data.startswith(PNG) and b"IEND" not in data[-64:]:
        raise ImageError("the PNG is cut short: it has no IEND chunk", where=where)
    if data.startswith(JPEG) and b"\xff\xd9" not in data[-4096:]:
        raise ImageError("the JPEG is cut short: it has no end-of-image marker", where=where)


def _decode(data: bytes, header: Header, where: str, frame: int | None) -> NDArray:
    import cv2

    buffer = np.frombuffer(data, np.uint8)
    try:
        with _native_stderr() as said:
            if _is_opaque(data) and frame in (None, 1):  # EXIF orientation is applied here
                rgb = cv2.imdecode(buffer, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_ANYDEPTH)
            else:
                chosen = _page_index(header, where, frame)
                pages = cv2.imdecodemulti(buffer, cv2.IMREAD_UNCHANGED, range=(chosen, chosen + 1))[
                    1
                ]
                rgb = _upright(_page(pages[0]), header) if len(pages) else None
            _refuse_damaged(data, said(), where)
    except cv2.error as error:
        raise ImageError(f"cannot be decoded: {error.err}", where=where) from None
    if rgb is None:
        raise ImageError(f"the {header.kind} cannot be decoded", where=where)
    if rgb.dtype not in (np.uint8, np.uint16):
        raise ImageError(f"has {rgb.dtype} samples; 8 or 16 bits are wanted", where=where)
    return rgb


def _refuse_damaged(data: bytes, said: str, where: str) -> None:
    # libjpeg makes up what it cannot decode, says so, and calls it a success.
    damage = next((x for x in said.splitlines() if x.startswith(LIBJPEG_DAMAGE)), None)
    if damage and data.startswith(JPEG):
        raise ImageError(f"the JPEG is damaged: {damage}", where=where)


def _is_opaque(data: bytes) -> bool:
    """A JPEG, or a PNG without alpha: neither has pages either."""
    if data.startswith(PNG):
        return data[25] in (0, 2, 3) and b"tRNS" not in data[: data.find(b"IDAT")]
    return data.startswith(JPEG)


def _page_index(header: Header, where: str, frame: int | None) -> int:
    if frame is None and header.pages > 1:
        raise ImageError(
            f"has {header.pages} pages; choose one, 1 to {header.pages} (--frame)", where=where
        )
    if not 1 <= (frame or 1) <= header.pages:
        raise ImageError(f"has no page {frame}; it has {header.pages}, from 1", where=where)
    return (frame or 1) - 1


def _page(page: NDArray) -> NDArray:
    import cv2

    if page.ndim == 3 and page.shape[2] == 4:
        return _over_black(page)
    return cv2.cvtColor(page, cv2.COLOR_GRAY2RGB if page.ndim == 2 else cv2.COLOR_BGR2RGB)


def _upright(rgb: NDArray, header: Header) -> NDArray:
    """A PNG with alpha, turned as its EXIF says (OpenCV does so for the others)."""
    orientation = header.orientation
    if orientation in (5, 6, 7, 8):
        rgb = rgb.transpose(1, 0, 2)
    if orientation in (2, 3, 6, 7):
        rgb = rgb[:, ::-1]
    if orientation in (3, 4, 7, 8):
        rgb = rgb[::-1]
    return np.ascontiguousarray(rgb)


def _scratch(name: str) -> BinaryIO:
    """A nameless file; in memory where the system can, so that no folder need be writable."""
    if hasattr(os, "memfd_create"):
        return os.fdopen(os.memfd_create(name), "w+b")
    return cast("BinaryIO", tempfile.TemporaryFile())


@contextmanager
def _native_stderr() -> Iterator[Callable[[], str]]:
    """Keep libpng, libjpeg and others off stderr; yields a function that tells what they said."""
    with _scratch("native stderr") as log:

        def said() -> str:
            log.seek(0)
            return log.read().decode(errors="replace")

        try:
            saved = os.dup(2)
        except OSError:  # there is no stderr
            saved = None
        try:
            os.dup2(log.fileno(), 2)
            yield said
        finally:
            if saved is None:
                os.close(2)
            else:
                os.dup2(saved, 2)
                os.close(saved)


def _over_black(bgra: NDArray) -> NDArray:
    full = np.iinfo(bgra.dtype).max
    alpha = bgra[..., 3:].astype(np.uint32)
    return ((bgra[..., 2::-1] * alpha + full // 2) // full).astype(bgra.dtype)
