"""Read DICOM: open a file, check it, name what is wrong with it; and a planned slice.

A surgeon's drawing comes as a colour secondary capture; a grey slice holds no pen, but gives a
vector curve its place (`T_patient_image`). Drawings on slices and outlines for surfaces are opened
here too. Names, dates and other identifiers are not read, except the image's own identifier, by
which a drawing on it is recognised. No message repeats a value of the file that could name the
patient.

The package pydicom parses the files. For slices it and its decoders run in a child process. A file
can be made to fill memory or time in many ways: elements without number, deflated zeros, runs, a
JPEG larger than its own header says.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import ImageError, InputError, VfplanError
from vfplan.geometry import UNIT_ROUNDED, PixelSpacing
from vfplan.geometry.lines import plane_normal, row_lengths
from vfplan.images.raster import check_size, chosen_index
from vfplan.io.files import nameless_file
from vfplan.io.sandbox import MAX_ARRAY_BYTES, raise_limits, raise_limits_for, run_in_sandbox

# Bytes that are parsed outside the sandbox. Each 8 may be an element, which takes its time.
MAX_PARSED_BYTES = 24 << 20
# Items of sequences that are parsed outside the sandbox: contours and frames.
MAX_ITEMS = 200_000
# The tag that begins an item of a sequence (PS3.5 7.5).
ITEM = b"\xfe\xff\x00\xe0"
# How an element of pixels may begin: with either explicit type, or with none.
PIXEL_DATA = (b"\xe0\x7f\x10\x00OB\0\0", b"\xe0\x7f\x10\x00OW\0\0", b"\xe0\x7f\x10\x00")


def is_dicom(data: bytes) -> bool:
    """Whether the bytes begin as a DICOM file does (PS3.10 7.1)."""
    return data[128:132] == b"DICM"


def begins_like_dicom(data: bytes) -> bool:
    """Whether the bytes begin as a DICOM file or as a data set without its preamble.

    Without a preamble a data set begins with group 0002 or 0008.
    """
    return is_dicom(data) or data.startswith((b"\x02\x00", b"\x08\x00"))


@contextmanager
def open_dataset(
    file: BinaryIO, kind: type[InputError], *, needs_preamble: bool = True
) -> Iterator[Any]:
    """Yield a DICOM file's data set, while pydicom neither logs nor warns.

    pydicom parses many values when they are first used. What it raises inside the block is
    therefore named too.

    Parameters
    ----------
    file
        Its name for messages is the caller's to add.
    kind
        The class of the error when the file cannot be read.
    needs_preamble
        Whether a data set without preamble is refused.

    Raises
    ------
    InputError
        The file cannot be read; an error of the `kind` given.
    """
    import pydicom

    log = logging.getLogger("pydicom")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield pydicom.dcmread(file, force=not needs_preamble)
    except (VfplanError, MemoryError):
        raise
    except Exception as error:  # A file from outside: pydicom raises all kinds.
        text = f"the DICOM file cannot be read ({type(error).__name__}). Export it again."
        if isinstance(error, AttributeError):
            text = f"the DICOM file has no {error.name or 'such attribute'}. Export it again."
        raise kind(text, code="dicom-unreadable") from None
    finally:
        log.setLevel(level)


def refuse_costly(data: bytes) -> None:
    """Refuse a file whose parsing could fill memory or time.

    It is asked of files that are parsed outside the sandbox. Raises `InputError`.
    """
    parsed_bytes = pixels_begin(data)
    items = data.count(ITEM, 0, parsed_bytes)
    text, numbers = "", {}
    # The transfer syntax of a file that is compressed as a whole (PS3.5 A.5).
    if b"1.2.840.10008.1.2.1.99" in data[:4096]:
        text = "is deflated as a whole. Export it without compression."
    elif parsed_bytes > MAX_PARSED_BYTES:
        text = (
            f"holds {parsed_bytes} bytes beside pixels; at most {MAX_PARSED_BYTES} are read. "
            "Export fewer structures."
        )
        numbers = {"bytes": parsed_bytes, "bytes_max": MAX_PARSED_BYTES}
    elif items > MAX_ITEMS:
        text = f"has {items} items; at most {MAX_ITEMS} are read. Export fewer structures."
        numbers = {"items": items, "items_max": MAX_ITEMS}
    if text:
        raise InputError(text, code="dicom-costly", numbers=numbers)


def pixels_begin(data: bytes) -> int:
    """Where the pixels begin that reach to the end of the file; its end where there are none."""
    for tag in PIXEL_DATA:
        start = data.find(tag)
        first = start + len(tag) + 4
        length = int.from_bytes(data[first - 4 : first], "little")
        if start >= 0 and (length == 0xFFFFFFFF or first + length == len(data)):
            return start
    return len(data)


def group_value(dataset: Any, group: str, keyword: str, frame_index: int | None) -> Any:
    """A value of a multi-frame object's functional groups; `None` where it is not there.

    Without `frame_index` the value that all frames share, otherwise the frame's own before that.
    """
    frames = dataset.get("PerFrameFunctionalGroupsSequence")
    items = frames[frame_index].get(group) if frame_index is not None and frames else None
    if not items:
        shared = dataset.get("SharedFunctionalGroupsSequence") or [{}]
        items = shared[0].get(group)
    return items[0].get(keyword) if items else None


def pixel_axes(orientation: Any, spacing_mm: tuple[float, float]) -> NDArray[np.float64] | None:
    """(3, 2) steps from column to column and from row to row [m] (PS3.3 C.7.6.2.1.1).

    Directions that are unit and square but for their decimals are made unit. `None` where they are
    not.

    Parameters
    ----------
    orientation
        ImageOrientationPatient: the directions of a row and of a column.
    spacing_mm
        (between columns, between rows) [mm]. DICOM writes the distance between *rows* first.
    """
    numbers = [float(x) for x in orientation]
    if len(numbers) != 6:
        return None
    directions = np.reshape(numbers, (2, 3))
    lengths = row_lengths(directions)
    is_unit = (np.abs(lengths - 1) < UNIT_ROUNDED).all()
    is_square = abs(directions[0] @ directions[1]) < UNIT_ROUNDED
    if not (is_unit and is_square):
        return None
    return (directions / lengths[:, None]).T * np.array(spacing_mm) * 1e-3


def memory_file(data: bytes) -> BinaryIO:
    """A file without a name, which the sandbox can open. No folder need be writable."""
    file = nameless_file()
    file.write(data)
    file.flush()
    return file


# Elements that hold pixels.
PIXEL_ELEMENTS = ("PixelData", "FloatPixelData", "DoubleFloatPixelData")
# Bytes of memory that a pixel may take while it is decoded, rescaled and windowed.
BYTES_PER_PIXEL = 48
# Pixels a second that the slowest decoder reads at least.
PIXELS_PER_SECOND = 2_000_000
# Frames of a file that can be chosen from.
MAX_FRAMES = 10_000
# Bytes of pixels that the child process hands over at a time: a quarter of the largest array.
PART_BYTES = MAX_ARRAY_BYTES // 4


def read_dicom(
    data: bytes, where: str, frame: int | None, imager_spacing: bool, max_pixels: int
) -> tuple[NDArray, PixelSpacing, NDArray | None, str, list[str], Any]:
    """Pixels, spacing and place of a DICOM file.

    Parameters
    ----------
    data, where
        The file's bytes and its name for messages.
    frame
        Which frame, from 1; needed when there are several.
    imager_spacing
        Take ImagerPixelSpacing (at the detector, not in the patient) where PixelSpacing is absent.
    max_pixels
        A larger picture is refused before it is decoded.

    Returns
    -------
    rgb, pixel_spacing_mm, T_patient_image, instance, remarks, grey_range
        (H, W, 3) uint8 or uint16; (along u, along v) [mm/px] or `None`; (4, 3) mapping [u v 1] to
        the patient's LPS frame [m], or `None`; the SOP instance UID, by which a drawing names it;
        codes of what the file says beside its pixels; the values of black and white (Hounsfield
        units in a CT), `None` in colour.

    Raises
    ------
    ImageError
        Not an image, damaged, of a kind that is not supported, or its reading took too much.
    """
    with memory_file(data) as file:
        parts = run_in_sandbox(
            "vfplan.images.dicom:decode", frame, imager_spacing, max_pixels,
            file=file, where=where, kind=ImageError,
        )  # fmt: skip
        shape, dtype, spacing_mm, place, instance, remarks, grey_range = next(parts)
        rgb = np.empty(shape, dtype)
        row = 0
        for (rows,) in parts:
            rgb[row : row + len(rows)] = rows
            row += len(rows)
    pixel_spacing_mm = tuple(spacing_mm) if spacing_mm is not None else None
    T_patient_image = np.array(place) if place is not None else None
    return rgb, pixel_spacing_mm, T_patient_image, instance, remarks, grey_range


# --- In the child process (`vfplan.io.sandbox`) --------------------------------------------------


def prepare() -> None:
    """Load pydicom before any file is read."""
    import pydicom.pixels  # noqa: F401


def decode(
    file: BinaryIO, frame: int | None, imager_spacing: bool, max_pixels: int
) -> Iterator[list[Any] | tuple[NDArray]]:
    """What `read_dicom` returns: a head with all but the pixels, then rows of pixels."""
    raise_limits_for(file)
    with open_dataset(file, ImageError) as dataset:
        if not any(name in dataset for name in PIXEL_ELEMENTS):
            modality = dataset.get("Modality") or "no image"
            raise ImageError(
                f"the DICOM file holds no pixels ({modality}). Export the slice itself."
            )
        index = chosen_index("frame", frame, int(dataset.get("NumberOfFrames") or 1))
        rgb, grey_range = read_pixels(dataset, index, max_pixels)
        patient_spacing_mm = read_spacing(dataset, "PixelSpacing", index)
        spacing_mm = patient_spacing_mm
        if spacing_mm is None and imager_spacing:
            spacing_mm = read_spacing(dataset, "ImagerPixelSpacing", index)
        place = place_in_patient(dataset, patient_spacing_mm, index)
        remarks = []
        # The groups of overlay planes have even numbers from 0x6000 to 0x60FF.
        if any(tag.group & 0xFF00 == 0x6000 for tag in dataset.keys()):  # noqa: SIM118
            remarks.append("overlay-left-out")
        aspect = dataset.get("PixelAspectRatio") or [1, 1]
        if float(aspect[0]) != float(aspect[1]):
            remarks.append("pixel-aspect")
    place = None if place is None else place.tolist()
    instance = str(dataset.get("SOPInstanceUID", ""))
    yield [rgb.shape, rgb.dtype.str, spacing_mm, place, instance, remarks, grey_range]
    rows = max(1, PART_BYTES // rgb[0].nbytes)
    for first in range(0, len(rgb), rows):
        yield (rgb[first : first + rows],)


def describe(file: BinaryIO) -> Iterator[list[Any]]:
    """The series of a file, its title, and the height of each frame along the slices' normal."""
    raise_limits_for(file)
    heights = []
    with open_dataset(file, ImageError) as dataset:
        frames = int(dataset.get("NumberOfFrames") or 1)
        has_pixels = any(name in dataset for name in PIXEL_ELEMENTS)
        for index in range(min(frames, MAX_FRAMES) if has_pixels else 0):
            place = place_in_patient(dataset, read_spacing(dataset, "PixelSpacing", index), index)
            if place is not None:
                normal = plane_normal(place[:3, :2])
                height = float(normal @ place[:3, 2] / np.linalg.norm(normal))
            heights.append(None if place is None else height)
        series = str(dataset.get("SeriesInstanceUID", ""))
        title = f"{dataset.get('Modality', 'series')} {dataset.get('SeriesNumber') or ''}".strip()
    yield [series, title, heights]


def read_pixels(dataset: Any, index: int, max_pixels: int) -> tuple[NDArray, list[float] | None]:
    """(H, W, 3) uint8 or uint16 pixels of one frame, which fill the range of their type.

    Also the values of black and white, where they are grey.
    """
    from pydicom.pixels import apply_color_lut, pixel_array

    kind = str(dataset.get("PhotometricInterpretation", ""))
    is_grey = kind in ("MONOCHROME1", "MONOCHROME2")
    if not is_grey and kind not in ("RGB", "PALETTE COLOR") and not kind.startswith("YBR"):
        raise ImageError(
            f"PhotometricInterpretation {kind!r} is not supported. Export the slice as RGB."
        )
    width, height = int(dataset.Columns), int(dataset.Rows)
    check_size(width, height, max_pixels)
    raise_limits(BYTES_PER_PIXEL * width * height, width * height // PIXELS_PER_SECOND)
    try:
        pixels = pixel_array(dataset, index=index)  # YBR becomes RGB here.
    except RuntimeError:
        compression = str(dataset.file_meta.TransferSyntaxUID.name)[:64]
        raise ImageError(
            f"its pixels cannot be unpacked ({compression}). Export it without compression."
        ) from None
    if is_grey:
        return windowed_grey(dataset, pixels, kind == "MONOCHROME1")
    stored_bits = int(dataset.get("BitsStored") or dataset.BitsAllocated)
    if kind == "PALETTE COLOR":
        pixels = apply_color_lut(pixels, dataset)
        stored_bits = 8 * pixels.itemsize
    is_colour = pixels.ndim == 3 and pixels.shape[2] == 3
    if not is_colour or pixels.dtype not in (np.uint8, np.uint16):
        raise ImageError(
            f"its pixels are {pixels.shape} of {pixels.dtype}. Export the slice as RGB of 8 or 16 "
            "bits."
        )
    unused_bits = 8 * pixels.itemsize - stored_bits
    if unused_bits:
        pixels = pixels << unused_bits
    return np.ascontiguousarray(pixels), None


def windowed_grey(dataset: Any, stored: NDArray, inverted: bool) -> tuple[NDArray, list[float]]:
    """(H, W, 3) grey: rescaled, then windowed, or stretched where no window is; and its range.

    Pixels of more than 8 bits stay so, so that a person can narrow the window.
    """
    from pydicom.pixels import apply_modality_lut, apply_windowing

    values = apply_modality_lut(stored, dataset).astype(float)
    windowed = values
    if "WindowCenter" in dataset and "WindowWidth" in dataset:
        windowed = apply_windowing(values, dataset)
    low, high = float(windowed.min()), float(windowed.max())
    brightness = (windowed - low) / (high - low or 1.0)
    if inverted:
        brightness = 1 - brightness
    depth = np.uint16 if stored.dtype.itemsize > 1 else np.uint8
    grey = np.rint(np.iinfo(depth).max * brightness).astype(depth)
    # Of windowed pixels, the values between which the greys rise.
    range_ = [float(values[windowed == low].max()), float(values[windowed == high].min())]
    return np.repeat(grey[..., None], 3, axis=2), range_[::-1] if inverted else range_


def read_spacing(dataset: Any, name: str, index: int) -> PixelSpacing:
    """(along u, along v) [mm]; DICOM writes the distance between *rows* first (PS3.3 10.7.1.3)."""
    value = dataset.get(name)
    if not value:
        # An enhanced multi-frame object holds it in its functional groups.
        value = group_value(dataset, "PixelMeasuresSequence", name, index)
    if value is None:
        return None
    numbers = [float(number) for number in np.ravel(value)]
    if len(numbers) != 2 or not all(0 < number < float("inf") for number in numbers):
        raise ImageError(f"{name} is {numbers}. Give two numbers above 0.")
    return numbers[1], numbers[0]


def place_in_patient(dataset: Any, spacing_mm: PixelSpacing, index: int) -> NDArray | None:
    """(4, 3) T_patient_image [m] from position and orientation (PS3.3 C.7.6.2.1.1).

    `None` where one is missing or not finite, or where the directions are not of length 1 and
    square to each other but for their decimals. Those decimals are then taken off.
    """
    corner, axes = (
        group_value(dataset, f"Plane{name}Sequence", f"Image{name}Patient", index)
        or dataset.get(f"Image{name}Patient")
        for name in ("Position", "Orientation")
    )
    if corner is None or axes is None or spacing_mm is None:
        return None
    steps = pixel_axes(axes, spacing_mm)
    if steps is None or len(corner) != 3:
        return None
    T_patient_image = np.zeros((4, 3))
    T_patient_image[:3, :2] = steps
    T_patient_image[:3, 2] = [float(number) * 1e-3 for number in corner]
    T_patient_image[3, 2] = 1
    return T_patient_image if np.isfinite(T_patient_image).all() else None
