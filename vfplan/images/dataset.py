"""Open a DICOM file, check it, and name what is wrong with it. The package pydicom parses it.

Slices, drawings on slices and outlines for surfaces are all opened here. No message repeats a value
of the file that could name the patient.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError, VfplanError
from vfplan.geometry import UNIT_ROUNDED
from vfplan.io.files import nameless_file

# Bytes that are parsed outside the sandbox. Each 8 may be an element, which takes its time.
MAX_PARSED_BYTES = 24 << 20
# Items of sequences that are parsed outside the sandbox: contours and frames.
MAX_ITEMS = 200_000
# The transfer syntax of a file that is compressed as a whole (PS3.5 A.5).
DEFLATED = b"1.2.840.10008.1.2.1.99"
# The tag that begins an item of a sequence (PS3.5 7.5).
ITEM = b"\xfe\xff\x00\xe0"
# How an element of pixels may begin: with either explicit type, or with none.
PIXEL_DATA = (b"\xe0\x7f\x10\x00OB\0\0", b"\xe0\x7f\x10\x00OW\0\0", b"\xe0\x7f\x10\x00")
# A data set without a preamble begins with an element of a lower number than this or this one.
LAST_FIRST_ELEMENT = 0x1199


def is_dicom(data: bytes) -> bool:
    """Whether the bytes begin as a DICOM file does (PS3.10 7.1)."""
    return data[128:132] == b"DICM"


def begins_like_dicom(data: bytes) -> bool:
    """Whether the bytes begin as a DICOM file or as a data set without its preamble.

    Without a preamble a data set begins with group 0002 or 0008, in either of the usual encodings.
    """
    if is_dicom(data):
        return True
    group = data[:2]
    element = int.from_bytes(data[2:4], "little")
    if group not in (b"\x02\x00", b"\x08\x00") or element > LAST_FIRST_ELEMENT:
        return False
    has_type = data[4:6].isalpha() and data[4:6].isupper()
    return has_type or int.from_bytes(data[4:8], "little") < len(data)


@contextmanager
def open_dataset(
    file: BinaryIO, where: str, kind: type[InputError], *, needs_preamble: bool = True
) -> Iterator[Any]:
    """Yield a DICOM file's data set.

    pydicom parses many values when they are first used. What it raises inside the block is
    therefore named too.

    Parameters
    ----------
    file, where
        The file and its name for messages.
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

    try:
        with silent_pydicom():
            yield pydicom.dcmread(file, force=not needs_preamble)
    except (VfplanError, MemoryError):
        raise
    except Exception as error:  # A file from outside: pydicom raises all kinds.
        text = f"the DICOM file cannot be read ({type(error).__name__}). Export it again."
        if isinstance(error, AttributeError):
            text = f"the DICOM file has no {error.name or 'such attribute'}. Export it again."
        raise kind(text, where=where, code="dicom-unreadable") from None


@contextmanager
def silent_pydicom() -> Iterator[None]:
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


def refuse_costly(data: bytes, where: str) -> None:
    """Refuse a file whose parsing could fill memory or time.

    It is asked of files that are parsed outside the sandbox. Raises `InputError`.
    """
    if DEFLATED in data[:4096]:
        raise InputError(
            "is deflated as a whole. Export it without compression.",
            where=where, code="dicom-costly",
        )  # fmt: skip
    parsed_bytes = pixels_begin(data)
    if parsed_bytes > MAX_PARSED_BYTES:
        raise InputError(
            f"holds {parsed_bytes} bytes beside pixels; at most {MAX_PARSED_BYTES} are read. "
            "Export fewer structures.",
            where=where, code="dicom-costly",
            numbers={"bytes": parsed_bytes, "bytes_max": MAX_PARSED_BYTES},
        )  # fmt: skip
    items = data.count(ITEM, 0, parsed_bytes)
    if items > MAX_ITEMS:
        raise InputError(
            f"has {items} items; at most {MAX_ITEMS} are read. Export fewer structures.",
            where=where, code="dicom-costly", numbers={"items": items, "items_max": MAX_ITEMS},
        )  # fmt: skip


def pixels_begin(data: bytes) -> int:
    """Where the pixels begin that reach to the end of the file; its end where there are none."""
    for tag in PIXEL_DATA:
        start = data.find(tag)
        first = start + len(tag) + 4
        length = int.from_bytes(data[first - 4 : first], "little")
        if start >= 0 and (length == 0xFFFFFFFF or first + length == len(data)):
            return start
    return len(data)


def group_value(dataset: Any, group: str, keyword: str, frame_index: int | None = None) -> Any:
    """A value of a multi-frame object's functional groups; `None` where it is not there.

    Without `frame_index` the value that all frames share, otherwise the frame's own before that.
    """
    frames = dataset.get("PerFrameFunctionalGroupsSequence")
    items = frames[frame_index].get(group) if frame_index is not None and frames else None
    if not items:
        shared = dataset.get("SharedFunctionalGroupsSequence") or [{}]
        items = shared[0].get(group)
    if not items:
        return None
    return items[0].get(keyword)


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
    lengths = np.linalg.norm(directions, axis=1)
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
