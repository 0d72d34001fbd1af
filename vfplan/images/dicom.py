"""Read a planned slice from DICOM, with the `dicom` extra (pydicom).

A surgeon's drawing comes as a colour secondary capture; a grey slice holds no pen, but gives a
vector curve its place (`T_patient_image`). Names, dates and other identifiers are not read, but
for the image's own, which a drawing on it is held against.

pydicom and its decoders run in a process apart: a file can be made to fill memory or time in many
ways (elements without number, deflated zeros, runs, a JPEG larger than its own header says).
"""

from __future__ import annotations

import logging
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import ImageError, MissingExtra, requires_extra
from vfplan.images.read import check_size, index_of
from vfplan.io.sandbox import raise_limits, run_in_sandbox

COLOUR = {"RGB", "PALETTE COLOR"}
DECIMALS = 1e-3  # of a direction: what writing it in decimals may cost
GREY = {"MONOCHROME1", "MONOCHROME2"}
PIXEL_BYTES = 48  # of memory that a pixel may take while it is decoded, rescaled and windowed
PIXELS_A_SECOND = 2_000_000  # at least, of the slowest decoder
PART_BYTES = 1 << 26  # of pixels at a time on their way here


def read_dicom(
    data: bytes, where: str, frame: int | None, imager_spacing: bool, max_pixels: int
) -> tuple[NDArray, tuple[float, float] | None, NDArray | None, str]:
    """Pixels, spacing and place of a DICOM file.

    Parameters
    ----------
    data, where
        The file's bytes and its name for messages.
    frame
        Which frame, from 1; needed when there are several.
    imager_spacing
        Take ImagerPixelSpacing (at the detector, not in the patient) where PixelSpacing is absent.

    Returns
    -------
    rgb, pixel_spacing_mm, T_patient_image, instance
        (H, W, 3) uint8 or uint16; (along u, along v) [mm/px] or `None`; (4, 3) mapping [u v 1] to
        the patient's LPS frame [m], or `None`; the SOP instance UID, by which a drawing names it.

    Raises
    ------
    ImageError
        Not an image, damaged, of a kind that is not supported, or its reading took too much.
    MissingExtra
        pydicom is not installed.
    """
    job = "vfplan.images.dicom:decoded"
    with in_memory(data) as file:
        found = run_in_sandbox(
            job, where, frame, imager_spacing, max_pixels, file=file, where=where, kind=ImageError
        )
        head = next(found)
        rgb = np.empty(head["shape"], head["dtype"])
        row = 0
        for (part,) in found:
            rgb[row : row + len(part)] = part
            row += len(part)
    place = head["place"]
    spacing = head["spacing"] and tuple(head["spacing"])
    return rgb, spacing, place and np.array(place), head["instance"]


def in_memory(data: bytes) -> BinaryIO:
    """A nameless file, so that no folder need be writable."""
    file = os.fdopen(os.memfd_create("DICOM"), "w+b")
    file.write(data)
    file.flush()
    return file


# What follows runs in a process apart (`vfplan.io.sandbox`).


def prepare() -> None:
    """Load the library before any file is read, if it is there."""
    with suppress(ModuleNotFoundError):
        import pydicom.pixels  # noqa: F401


def decoded(
    file: BinaryIO, where: str, frame: int | None, imager_spacing: bool, max_pixels: int
) -> Iterator[dict[str, Any] | tuple[NDArray]]:
    """What `read_dicom` returns: shape, type, spacing and place, then rows of pixels."""
    raise_limits(2 * file.seek(0, os.SEEK_END), 0)
    file.seek(0)
    with quiet(where):
        dataset = _image_of(file, where)
        count = int(dataset.get("NumberOfFrames") or 1)
        rgb = _pixels(dataset, where, index_of("frame", frame, count, where), max_pixels)
        spacing = _spacing(dataset, where, imager_spacing)
        place = _place(dataset, _spacing(dataset, where, imager=False))
    yield {
        "shape": rgb.shape,
        "dtype": rgb.dtype.str,
        "spacing": spacing,
        "place": None if place is None else place.tolist(),
        "instance": str(dataset.get("SOPInstanceUID", "")),
    }
    rows = max(1, PART_BYTES // rgb[0].nbytes)
    for first in range(0, len(rgb), rows):
        yield (rgb[first : first + rows],)


@contextmanager
def quiet(where: str) -> Iterator[None]:
    """Silence pydicom and turn whatever it raises into an `ImageError`."""
    try:
        with silent():
            yield
    except (ImageError, MissingExtra, MemoryError):
        raise
    except Exception as error:  # a file from outside: pydicom raises all kinds
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ImageError(f"the DICOM file cannot be read: {reason}.", where=where) from None


@contextmanager
def silent() -> Iterator[None]:
    """Let pydicom neither log nor warn."""
    log = logging.getLogger("pydicom")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)


def dataset_of(file: BinaryIO, where: str) -> Any:
    """A DICOM file's data set, whatever it holds; raises `MissingExtra`."""
    with requires_extra("reading DICOM needs pydicom", "dicom", where):
        import pydicom
    return pydicom.dcmread(file)


def _image_of(file: BinaryIO, where: str) -> Any:
    dataset = dataset_of(file, where)
    if not any(name in dataset for name in ("PixelData", "FloatPixelData", "DoubleFloatPixelData")):
        kind = dataset.get("Modality") or "no image"
        raise ImageError(
            f"the DICOM file holds no pixels ({kind}). Export the slice itself.", where=where
        )
    return dataset


def _pixels(dataset: Any, where: str, index: int, max_pixels: int) -> NDArray:
    from pydicom.pixels import apply_color_lut, pixel_array

    kind = str(dataset.get("PhotometricInterpretation", ""))
    if not (kind in COLOUR | GREY or kind.startswith("YBR")):
        raise ImageError(
            f"PhotometricInterpretation {kind!r} is not supported. Export the slice as RGB.",
            where=where,
        )
    check_size(int(dataset.Columns), int(dataset.Rows), where, max_pixels)
    pixels = int(dataset.Columns) * int(dataset.Rows)
    raise_limits(PIXEL_BYTES * pixels, pixels // PIXELS_A_SECOND)
    bits = int(dataset.BitsAllocated)
    if bits not in (8, 16) and kind not in GREY:
        raise ImageError(f"has {bits} bits a sample. Export the slice with 8 or 16.", where=where)
    pixels = pixel_array(dataset, index=index)  # YBR becomes RGB here
    if kind in GREY:
        return _windowed(dataset, pixels, kind == "MONOCHROME1")
    if kind == "PALETTE COLOR":
        pixels = apply_color_lut(pixels, dataset)
        stored = 8 * pixels.itemsize
    else:
        stored = int(dataset.get("BitsStored") or bits)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype.kind != "u":
        raise ImageError(f"its pixels are {pixels.shape} of {pixels.dtype}.", where=where)
    shift = 8 * pixels.itemsize - stored
    return np.ascontiguousarray(pixels << shift if shift else pixels)


def _windowed(
    dataset: Any, stored: NDArray, inverted: bool
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """(H, W, 3) grey: rescaled, then windowed, or stretched where no window is.

    Pixels of more than 8 bits stay so, so that a person can narrow the window.
    """
    from pydicom.pixels import apply_modality_lut, apply_windowing

    values = apply_modality_lut(stored, dataset).astype(np.float64)
    if "WindowCenter" in dataset and "WindowWidth" in dataset:
        values = apply_windowing(values, dataset)
    low, high = float(values.min()), float(values.max())
    shown = (values - low) / ((high - low) or 1.0)
    if inverted:
        shown = 1 - shown
    depth = np.uint8
    if stored.dtype.itemsize > 1:
        depth = np.uint16
    grey = np.rint(np.iinfo(depth).max * shown).astype(depth)
    return np.repeat(grey[..., None], 3, axis=2)


def _spacing(dataset: Any, where: str, imager: bool) -> tuple[float, float] | None:
    """(along u, along v) [mm]; DICOM writes the distance between *rows* first (PS3.3 10.7.1.3)."""
    names = ("PixelSpacing", "ImagerPixelSpacing") if imager else ("PixelSpacing",)
    for name in names:
        value = dataset.get(name) or _shared(dataset, "PixelMeasuresSequence", name)
        if value is None:
            continue
        numbers = [float(x) for x in (value if hasattr(value, "__len__") else [value])]
        if len(numbers) != 2 or not all(0 < x < float("inf") for x in numbers):
            raise ImageError(f"{name} is {numbers}. Give two numbers above 0.", where=where)
        return numbers[1], numbers[0]
    return None


def _place(dataset: Any, spacing: tuple[float, float] | None) -> NDArray | None:
    """(4, 3) T_patient_image [m] from position and orientation (PS3.3 C.7.6.2.1.1).

    `None` where one is missing, not finite, or the directions are not square to each other and of
    length 1 but for their decimals, which are made exact.
    """
    corner = dataset.get("ImagePositionPatient")
    axes = dataset.get("ImageOrientationPatient")
    if corner is None or axes is None or spacing is None or len(corner) != 3 or len(axes) != 6:
        return None
    along = np.reshape([float(x) for x in axes], (2, 3))
    lengths = np.linalg.norm(along, axis=1)
    if not (np.abs(lengths - 1) < DECIMALS).all() or not abs(along[0] @ along[1]) < DECIMALS:
        return None
    T_patient_image = np.zeros((4, 3))
    T_patient_image[:3, :2] = (along / lengths[:, None]).T * np.array(spacing) * 1e-3
    T_patient_image[:3, 2] = [float(x) * 1e-3 for x in corner]
    T_patient_image[3, 2] = 1
    return T_patient_image if np.isfinite(T_patient_image).all() else None


def _shared(dataset: Any, group: str, name: str) -> Any:
    """A value of an enhanced multi-frame object's shared functional groups."""
    shared = dataset.get("SharedFunctionalGroupsSequence") or [{}]
    inner = shared[0].get(group) or [{}]
    return inner[0].get(name)
