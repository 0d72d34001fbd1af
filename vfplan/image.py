"""Read a planned slice: PNG, JPEG, TIFF or BMP -> PlannedImage.

Pixels: u to the right, v down, and the *centre* of the top-left pixel is (0, 0).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import ImageError


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
    """

    rgb: NDArray[np.uint8] | NDArray[np.uint16]
    pixel_spacing_mm: tuple[float, float] | None = None
    sha256: str = ""

    @property
    def width_px(self) -> int:
        """Columns."""
        return self.rgb.shape[1]

    @property
    def height_px(self) -> int:
        """Rows."""
        return self.rgb.shape[0]


def as_image(image: PlannedImage | NDArray) -> PlannedImage:
    """The image itself, or an (H, W, 3) array of uint8 or uint16 wrapped as one.

    Raises `ImageError` for any other shape or type.
    """
    if isinstance(image, PlannedImage):
        return image
    rgb = np.asarray(image)
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype not in (np.uint8, np.uint16) or not rgb.size:
        raise ImageError(
            "an image array is (H, W, 3) of uint8 or uint16, red first; "
            f"got {rgb.shape} of {rgb.dtype}"
        )
    return PlannedImage(rgb, None, hashlib.sha256(np.ascontiguousarray(rgb)).hexdigest())


def read_image(
    path: str | Path, *, pixel_spacing_mm: tuple[float, float] | None = None
) -> PlannedImage:
    """Read a planned slice.

    Parameters
    ----------
    path
        A PNG (8 or 16 bit, palette, alpha), JPEG, TIFF or BMP file. EXIF orientation is applied;
        transparent pixels are laid over black.
    pixel_spacing_mm
        (along u, along v) [mm/px], when the caller knows; it wins over the file's own.

    Raises
    ------
    ImageError
        The file is missing, not an image, damaged, or of a kind that is not supported.
    """
    data = _bytes(Path(path))
    where = str(path)
    _refuse_truncated(data, where)
    rgb = _decode(data, where)
    return PlannedImage(rgb, pixel_spacing_mm, hashlib.sha256(data).hexdigest())


def _bytes(path: Path) -> bytes:
    if path.is_dir():
        raise ImageError("is a directory; an image file is wanted", where=str(path))
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise ImageError("no such file", where=str(path)) from None
    except OSError as error:
        raise ImageError(f"cannot be read: {error.strerror}", where=str(path)) from None
    if not data:
        raise ImageError("is empty; an image is wanted", where=str(path))
    return data


def _refuse_truncated(data: bytes, where: str) -> None:
    # Decoders fill what is missing with grey and say nothing.
    if data.startswith(b"\x89PNG") and b"IEND" not in data[-64:]:
        raise ImageError("the PNG is cut short: it has no IEND chunk", where=where)
    if data.startswith(b"\xff\xd8") and b"\xff\xd9" not in data[-4096:]:
        raise ImageError("the JPEG is cut short: it has no end-of-image marker", where=where)


def _decode(data: bytes, where: str) -> NDArray:
    import cv2

    buffer = np.frombuffer(data, np.uint8)
    try:
        raw = cv2.imdecode(buffer, cv2.IMREAD_UNCHANGED)
        if raw is None:
            raise ImageError("is not an image that can be read (PNG, JPEG, TIFF, BMP)", where=where)
        if raw.ndim == 3 and raw.shape[2] == 4:
            return _over_black(raw)
        rgb = cv2.imdecode(buffer, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_ANYDEPTH)
    except cv2.error as error:
        raise ImageError(f"cannot be decoded: {error.err}", where=where) from None
    if rgb.dtype not in (np.uint8, np.uint16):
        raise ImageError(f"has {rgb.dtype} samples; 8 or 16 bits are wanted", where=where)
    return rgb


def _over_black(bgra: NDArray) -> NDArray:
    full = np.iinfo(bgra.dtype).max
    alpha = bgra[..., 3:].astype(np.uint32)
    return ((bgra[..., 2::-1] * alpha + full // 2) // full).astype(bgra.dtype)
