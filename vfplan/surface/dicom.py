"""Outlines in DICOM: RTSTRUCT's contours and SEG's frames, with pydicom.

Names, dates and identifiers of the patient are not read; a structure that is named like the patient
loses its name.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError, VfplanError, requires_extra
from vfplan.images.dicom import silent
from vfplan.images.read import is_dicom
from vfplan.io.files import read_bytes
from vfplan.surface.contours import Contours, Structure, choose_structure
from vfplan.surface.labels import rings_of_mask, rings_of_share

Array = NDArray[np.float64]
RTSTRUCT = "1.2.840.10008.5.1.4.1.1.481.3"
SEG = ("1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7")
DEFLATED = b"1.2.840.10008.1.2.1.99"
MAX_BYTES = 1 << 28
MAX_BESIDE_PIXELS = 24 << 20  # every 8 bytes may be an element, and each takes its time
MAX_ITEMS = 200_000  # of sequences: contours, frames
PIXEL_DATA = (b"\xe0\x7f\x10\x00OB\0\0", b"\xe0\x7f\x10\x00OW\0\0", b"\xe0\x7f\x10\x00")
MAX_PIXELS = 1 << 28
CLOSED = ("CLOSED_PLANAR", "CLOSEDPLANAR_XOR")
UNIT_ROUNDED = 1e-3  # of a direction's length: written in decimals, made unit again
FRAME_ROUNDED_M = 1e-6


def plainly_dicom(data: bytes) -> bool:
    """Whether bytes are DICOM: by the mark after the preamble, or by a first element's tag.

    Without preamble a data set begins with group 0002 or 0008, in either of the usual encodings.
    """
    if is_dicom(data):
        return True
    group, element = data[:2], int.from_bytes(data[2:4], "little")
    if group not in (b"\x02\x00", b"\x08\x00") or element > 0x1199:
        return False
    explicit = data[4:6].isalpha() and data[4:6].isupper()
    return explicit or int.from_bytes(data[4:8], "little") < len(data)


def read_dicom_contours(path: Path, structure: str | None) -> Contours:
    """One structure of an RTSTRUCT or a DICOM SEG.

    Raises InputError: damaged, of another kind, without such a structure, or of a shape that is not
        supported
    Raises MissingExtra: pydicom is not installed
    """
    where = str(path)
    data, digest = read_bytes(path, MAX_BYTES)
    with _quiet(where):
        dataset = _dataset(data, where)
        kind = str(dataset.get("SOPClassUID", ""))
        if kind == RTSTRUCT:
            return _rtstruct(dataset, structure, {"contours": digest}, where)
        if kind in SEG:
            return _seg(dataset, structure, {"labels": digest}, where)
        modality = str(dataset.get("Modality", "")) or "an unknown kind"
        raise InputError(
            f"is DICOM of {modality[:16]}. Give RTSTRUCT, SEG or a folder of drawn slices.",
            where=where,
        )


@contextmanager
def _quiet(where: str) -> Iterator[None]:
    """Silence pydicom and turn what it raises into one line without the values it stumbled over."""
    try:
        with silent():
            yield
    except (VfplanError, MemoryError):
        raise
    except AttributeError as error:
        raise InputError(
            f"the DICOM file cannot be read: it has no {error.name or 'such attribute'}.",
            where=where,
        ) from None
    except Exception as error:  # a file from outside: pydicom raises all kinds
        raise InputError(
            f"the DICOM file cannot be read ({type(error).__name__}).", where=where
        ) from None


def _dataset(data: bytes, where: str) -> Any:
    with requires_extra("reading DICOM needs pydicom", "surface", where):
        import pydicom
    if DEFLATED in data[:4096]:
        raise InputError("is deflated as a whole. Export it without compression.", where=where)
    beside = _pixels_begin(data)
    if beside > MAX_BESIDE_PIXELS:
        raise InputError(
            f"holds {beside} bytes beside pixels. At most {MAX_BESIDE_PIXELS} are read.",
            where=where,
        )
    items = data.count(b"\xfe\xff\x00\xe0", 0, beside)
    if items > MAX_ITEMS:
        raise InputError(f"has {items} items. At most {MAX_ITEMS} are read.", where=where)
    return pydicom.dcmread(io.BytesIO(data), force=True)


def _pixels_begin(data: bytes) -> int:
    """Where the pixels begin that reach to the end of the file; its end where there are none."""
    for tag in PIXEL_DATA:
        at = data.find(tag)
        length = int.from_bytes(data[at + len(tag) : at + len(tag) + 4], "little")
        if at >= 0 and (length == 0xFFFFFFFF or at + len(tag) + 4 + length == len(data)):
            return at
    return len(data)


def _names(dataset: Any, found: list[tuple[int, str]]) -> tuple[Structure, ...]:
    """Structures; a name that holds the patient's name or number is left out."""
    secret = []
    for keyword in ("PatientName", "PatientID", "OtherPatientIDs", "PatientBirthName"):
        text = str(dataset.get(keyword, "") or "")
        secret += [part.lower() for part in text.replace("^", " ").split() if len(part) > 2]
    return tuple(
        Structure(number, "" if any(part in name.lower() for part in secret) else name)
        for number, name in found
    )


def _rtstruct(dataset: Any, wanted: str | None, inputs: dict[str, str], where: str) -> Contours:
    found = [
        (int(roi.ROINumber), str(roi.get("ROIName", "")))
        for roi in dataset.get("StructureSetROISequence") or ()
    ]
    structures = _names(dataset, found)
    chosen = choose_structure(structures, wanted)
    drawn = [
        roi
        for roi in dataset.get("ROIContourSequence") or ()
        if int(roi.ReferencedROINumber) == chosen.number
    ]
    rings, others = [], 0
    for contour in (c for roi in drawn for c in roi.get("ContourSequence") or ()):
        if str(contour.get("ContourGeometricType", "")) not in CLOSED:
            others += 1
            continue
        rings.append(_points(contour, where))
    if not rings:
        raise InputError(
            f"structure {chosen.number} has no closed contour"
            + (f"; {others} are open or single points" if others else ""),
            where=where,
        )
    remarks = ()
    if others:
        remarks = (f"{others} contours that are open or single points are left out",)
    return Contours(tuple(rings), structures, chosen.number, inputs, remarks=remarks)


def _points(contour: Any, where: str) -> Array:
    """(M, 3) LPS [m] of one contour, from its text as it stands in the file."""
    raw = contour.get_item("ContourData")
    value = raw.value
    if isinstance(value, bytes):
        numbers = np.array(value.rstrip(b" \0").split(b"\\"), dtype=np.float64)
    else:
        numbers = np.array([float(x) for x in value], dtype=np.float64)
    if numbers.size % 3 or not np.isfinite(numbers).all():
        raise InputError("a contour is not made of triples of finite numbers.", where=where)
    points = numbers.reshape(-1, 3) * 1e-3
    return points[:-1] if len(points) > 3 and np.array_equal(points[0], points[-1]) else points


def _seg(dataset: Any, wanted: str | None, inputs: dict[str, str], where: str) -> Contours:
    from pydicom.pixels import iter_pixels

    found = [
        (int(segment.SegmentNumber), str(segment.get("SegmentLabel", "")))
        for segment in dataset.SegmentSequence
    ]
    structures = _names(dataset, found)
    chosen = choose_structure(structures, wanted)
    kind = str(dataset.SegmentationType)
    if kind not in ("BINARY", "FRACTIONAL", "LABELMAP"):
        raise InputError(f"is a segmentation of type {kind[:16]!r}.", where=where)
    rows, columns = int(dataset.Rows), int(dataset.Columns)
    frames = int(dataset.get("NumberOfFrames") or 1)
    if not 0 < rows * columns * frames <= MAX_PIXELS:
        raise InputError(
            f"says that it has {frames} frames of {rows} x {columns}. {MAX_PIXELS} pixels are "
            "allowed in all.",
            where=where,
        )
    corners, axes, normal, own = _frames(dataset, frames, chosen.number, where)
    most = float(dataset.get("MaximumFractionalValue", 1) or 1)
    rings: list[Array] = []
    shown, stairs = set(), 0
    for k, pixels in zip(own, iter_pixels(dataset, indices=own), strict=True):
        if kind == "FRACTIONAL":
            borders = rings_of_share(pixels / most)
        else:
            borders, smoothed = rings_of_mask(
                pixels == (chosen.number if kind == "LABELMAP" else 1)
            )
            stairs += not smoothed
        rings += [corners[k] + border[:, ::-1] @ axes.T for border in borders]
        if borders:
            shown.add(k)
    if not rings:
        raise InputError(
            f"segment {chosen.number} has no pixels. Choose another with --structure.", where=where
        )
    at = corners @ normal
    drawn = np.array([at[k] for k in shown])
    empty = np.array([np.abs(drawn - z).min() > FRAME_ROUNDED_M for z in at])
    remarks = ()
    if stairs:
        text = "smoothing would lose or join parts of the structure"
        remarks = (f"{stairs} slices keep their stairs: {text}",)
    return Contours(
        tuple(rings), structures, chosen.number, inputs, normal, corners[empty], remarks
    )


def _frames(
    dataset: Any, count: int, segment: int, where: str
) -> tuple[Array, Array, Array, list[int]]:
    """Corners (count, 3) and axes (3, 2) [m] of the frames, their normal, and the segment's own."""
    places = [_frame(dataset, k, where) for k in range(count)]
    axes = places[0][1]
    if any(np.abs(place[1] - axes).max() > 1e-12 for place in places):
        raise InputError("its frames differ in orientation or pixel spacing.", where=where)
    own = [k for k, place in enumerate(places) if place[2] in (None, segment)]
    corners = np.array([place[0] for place in places])
    normal = np.cross(axes[:, 0], axes[:, 1])
    normal /= np.linalg.norm(normal)
    _refuse_doubled(np.sort(corners[own] @ normal), where)
    return corners, axes, normal, own


def _refuse_doubled(at: Array, where: str) -> None:
    close = np.flatnonzero(np.diff(at) < FRAME_ROUNDED_M)
    if len(close):
        raise InputError(
            f"two frames of the segment lie in one slice, at {1e3 * at[close[0]]:.3f} mm along "
            "its normal.",
            where=where,
        )


def _frame(dataset: Any, k: int, where: str) -> tuple[Array, Array, int | None]:
    """Corner (3,) [m], axes (3, 2) of a step along columns and rows [m], and the segment."""
    own = dataset.PerFrameFunctionalGroupsSequence[k]
    shared = (dataset.get("SharedFunctionalGroupsSequence") or [{}])[0]

    def look(group: str, name: str) -> Any:
        inner = own.get(group) or shared.get(group)
        return None if not inner else inner[0].get(name)

    corner = look("PlanePositionSequence", "ImagePositionPatient")
    direction = look("PlaneOrientationSequence", "ImageOrientationPatient")
    spacing = look("PixelMeasuresSequence", "PixelSpacing")
    if corner is None or direction is None or spacing is None:
        raise InputError(f"frame {k + 1} does not say where it lies in the patient.", where=where)
    segment = look("SegmentIdentificationSequence", "ReferencedSegmentNumber")
    return (
        np.array([float(x) for x in corner]) * 1e-3,
        pixel_axes(direction, spacing, where),
        None if segment is None else int(segment),
    )


def pixel_axes(direction: Any, spacing: Any, where: str) -> Array:
    """(3, 2) step from column to column and from row to row [m] (PS3.3 C.7.6.2.1.1).

    Raises `InputError` where the directions are not unit and square, or the spacing is none.
    """
    axes = np.array([float(x) for x in direction]).reshape(2, 3)
    between = np.array([float(x) for x in spacing])
    lengths = np.linalg.norm(axes, axis=1)
    if not (np.abs(lengths - 1) < UNIT_ROUNDED).all() or abs(axes[0] @ axes[1]) > UNIT_ROUNDED:
        raise InputError("ImageOrientationPatient is no pair of square unit vectors.", where=where)
    if between.shape != (2,) or not ((between > 1e-2) & (between < 100)).all():
        raise InputError("PixelSpacing is not two lengths from 0.01 to 100 mm.", where=where)
    axes = axes / lengths[:, None]
    return np.column_stack([axes[0] * between[1], axes[1] * between[0]]) * 1e-3
