"""Outlines in DICOM: the contours of an RTSTRUCT and the frames of a SEG.

Names, dates and identifiers of the patient are not read. A structure that is named like the patient
loses its name.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError
from vfplan.images.dataset import group_value, open_dataset, pixel_axes, refuse_costly
from vfplan.io.files import MAX_TEXT_BYTES, read_bytes
from vfplan.surface.outline import Contours, Structure, choose_structure
from vfplan.surface.slicing import SAME_M
from vfplan.surface.volumes import (
    MAX_VOXEL_M,
    MIN_VOXEL_M,
    rings_of_mask,
    rings_of_share,
    stairs_remark,
)

Array = NDArray[np.float64]
RTSTRUCT = "1.2.840.10008.5.1.4.1.1.481.3"
SEG = ("1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7")
SEGMENTATION_TYPES = ("BINARY", "FRACTIONAL", "LABELMAP")
CLOSED_CONTOURS = ("CLOSED_PLANAR", "CLOSEDPLANAR_XOR")
MAX_BYTES = MAX_TEXT_BYTES
"""Largest size of a file [bytes]; the contours in it are text. One of a whole pelvis has some ten
million."""


def read_dicom_contours(path: Path, structure: str | None) -> Contours:
    """The outlines of one structure of an RTSTRUCT or a DICOM SEG.

    Raises
    ------
    InputError
        The file is damaged, of another kind, or of a shape that is not supported, or there is no
        such structure.
    MissingExtra
        pydicom is not installed.
    """
    where = str(path)
    data, digest = read_bytes(path, MAX_BYTES)
    refuse_costly(data, where)
    with open_dataset(
        io.BytesIO(data), where, InputError, extra="surface", needs_preamble=False
    ) as dataset:
        kind = str(dataset.get("SOPClassUID", ""))
        if kind == RTSTRUCT:
            return contours_of_rtstruct(dataset, structure, {"contours": digest}, where)
        if kind in SEG:
            return contours_of_segmentation(dataset, structure, {"labels": digest}, where)
        modality = str(dataset.get("Modality", "")) or "an unknown kind"
        raise InputError(
            f"is DICOM of {modality[:16]}. Give RTSTRUCT, SEG or a folder of drawn slices.",
            where=where,
            code="source-unknown",
        )


def without_patient_names(
    dataset: Any, numbered_names: list[tuple[int, str]]
) -> tuple[Structure, ...]:
    """Structures; a name that holds a part of the patient's name or number is left out."""
    secrets = []
    for keyword in ("PatientName", "PatientID", "OtherPatientIDs", "PatientBirthName"):
        text = str(dataset.get(keyword, "") or "")
        for part in text.replace("^", " ").split():
            if len(part) > 2:
                secrets.append(part.lower())
    structures = []
    for number, name in numbered_names:
        for secret in secrets:
            if secret in name.lower():
                name = ""
        structures.append(Structure(number, name))
    return tuple(structures)


def contours_of_rtstruct(
    dataset: Any, wanted: str | None, inputs: dict[str, str], where: str
) -> Contours:
    """The closed contours of one structure of an RTSTRUCT."""
    numbered_names = []
    for roi in dataset.get("StructureSetROISequence") or ():
        numbered_names.append((int(roi.ROINumber), str(roi.get("ROIName", ""))))
    structures = without_patient_names(dataset, numbered_names)
    chosen = choose_structure(structures, wanted)

    rings = []
    others = 0
    for roi in dataset.get("ROIContourSequence") or ():
        if int(roi.ReferencedROINumber) != chosen.number:
            continue
        for contour in roi.get("ContourSequence") or ():
            if str(contour.get("ContourGeometricType", "")) in CLOSED_CONTOURS:
                rings.append(ring_of_contour(contour, where))
            else:
                others += 1
    if not rings:
        raise InputError(
            f"structure {chosen.number} has no closed contour and {others} that are open or single "
            "points. Choose another with --structure, or draw its outlines.",
            where=where,
            code="structure-empty",
            numbers={"structure": chosen.number, "others": others},
        )
    remarks = ()
    if others:
        remarks = (
            f"{others} contours are open or single points and are left out. Close them if they are "
            "outlines.",
        )
    return Contours(tuple(rings), structures, chosen.number, inputs, remarks=remarks)


def ring_of_contour(contour: Any, where: str) -> Array:
    """(M, 3) LPS [m] of one contour, from its text as it stands in the file."""
    value = contour.get_item("ContourData").value
    if isinstance(value, bytes):
        value = value.rstrip(b" \0").split(b"\\")
    numbers = np.array([float(x) for x in value], dtype=np.float64)
    if numbers.size % 3 or not np.isfinite(numbers).all():
        raise InputError(
            "a contour is not made of triples of finite numbers. Export the structure again.",
            where=where,
            code="outline-not-finite",
        )
    points = numbers.reshape(-1, 3) * 1e-3
    return points[:-1] if len(points) > 3 and np.array_equal(points[0], points[-1]) else points


def contours_of_segmentation(
    dataset: Any, wanted: str | None, inputs: dict[str, str], where: str
) -> Contours:
    """The borders of one segment of a SEG, frame by frame."""
    from pydicom.pixels import iter_pixels

    numbered_names = []
    for segment in dataset.SegmentSequence:
        numbered_names.append((int(segment.SegmentNumber), str(segment.get("SegmentLabel", ""))))
    structures = without_patient_names(dataset, numbered_names)
    chosen = choose_structure(structures, wanted)
    kind = str(dataset.SegmentationType)
    if kind not in SEGMENTATION_TYPES:
        raise InputError(
            f"is a segmentation of type {kind[:16]!r}. Give BINARY, FRACTIONAL or LABELMAP.",
            where=where,
            code="volume-unsupported",
        )
    frames = frames_of_segment(dataset, chosen.number, where)

    rings: list[Array] = []
    drawn = set()
    slices_with_stairs = 0
    largest_share = float(dataset.get("MaximumFractionalValue", 1) or 1)
    members = frames.members
    for k, pixels in zip(members, iter_pixels(dataset, indices=members), strict=True):
        if kind == "FRACTIONAL":
            borders = rings_of_share(pixels / largest_share)
        else:
            label = chosen.number if kind == "LABELMAP" else 1
            borders, is_smooth = rings_of_mask(pixels == label)
            if not is_smooth:
                slices_with_stairs += 1
        for border in borders:
            rings.append(frames.corners[k] + border[:, ::-1] @ frames.axes.T)
            drawn.add(k)
    if not rings:
        raise InputError(
            f"segment {chosen.number} has no pixels. Choose another with --structure.",
            where=where,
            code="structure-empty",
            numbers={"structure": chosen.number},
        )

    heights = frames.corners @ frames.normal
    drawn_heights = heights[sorted(drawn)]
    empty = []
    for corner, height in zip(frames.corners, heights, strict=True):
        if np.abs(drawn_heights - height).min() > SAME_M:
            empty.append(corner)
    return Contours(
        tuple(rings),
        structures,
        chosen.number,
        inputs,
        normal=frames.normal,
        empty=np.array(empty).reshape(-1, 3),
        remarks=stairs_remark(slices_with_stairs),
    )


@dataclass(frozen=True, eq=False)
class Frames:
    """Where the frames of a segmentation lie in the patient."""

    corners: Array
    """(F, 3) the centre of each frame's first pixel, LPS [m]."""
    axes: Array
    """(3, 2) a step from column to column and from row to row, LPS [m]."""
    normal: Array
    """(3,) unit normal of the frames."""
    members: list[int]
    """Which frames belong to the segment, from 0."""


def frames_of_segment(dataset: Any, segment: int, where: str) -> Frames:
    """The frames of a segmentation; raises `InputError` where their places are not sound."""
    rows = int(dataset.Rows)
    columns = int(dataset.Columns)
    count = int(dataset.get("NumberOfFrames") or 1)
    # A pixel takes a byte or more, and a thousand frames of 512 x 512 have fewer pixels.
    if not 0 < rows * columns * count <= MAX_BYTES:
        raise InputError(
            f"says that it has {count} frames of {rows} x {columns}; {MAX_BYTES} pixels are "
            "allowed in all. Export a part of it.",
            where=where,
            code="volume-too-large",
            numbers={"frames": count, "rows": rows, "columns": columns},
        )
    corners = []
    axes = None
    members = []
    for k in range(count):
        corner, frame_axes = frame_place(dataset, k, where)
        corners.append(corner)
        if axes is None:
            axes = frame_axes
        if np.abs(frame_axes - axes).max() > 1e-12:
            raise InputError(
                f"frame {k + 1} differs from the first in orientation or pixel spacing. Export "
                "parallel frames of one size.",
                where=where,
                code="volume-unsupported",
            )
        number = group_value(dataset, "SegmentIdentificationSequence", "ReferencedSegmentNumber", k)
        if number is None or int(number) == segment:
            members.append(k)
    corners = np.array(corners)
    normal = np.cross(axes[:, 0], axes[:, 1])
    normal /= np.linalg.norm(normal)

    heights = np.sort(corners[members] @ normal)
    doubled = np.flatnonzero(np.diff(heights) < SAME_M)
    if len(doubled):
        raise InputError(
            f"two frames of the segment lie in one slice, at {1e3 * heights[doubled[0]]:.3f} mm "
            "along its normal. Export each slice once.",
            where=where,
            code="slices-doubled",
        )
    return Frames(corners, axes, normal, members)


def frame_place(dataset: Any, k: int, where: str) -> tuple[Array, Array]:
    """Corner (3,) and axes (3, 2) of a frame, LPS [m]."""
    corner = group_value(dataset, "PlanePositionSequence", "ImagePositionPatient", k)
    orientation = group_value(dataset, "PlaneOrientationSequence", "ImageOrientationPatient", k)
    spacing = group_value(dataset, "PixelMeasuresSequence", "PixelSpacing", k)
    if corner is None or orientation is None or spacing is None:
        raise InputError(
            f"frame {k + 1} does not say where it lies in the patient. Export it with its place.",
            where=where,
            code="volume-without-place",
        )
    # DICOM writes the distance between rows first.
    between = [float(x) for x in spacing]
    if len(between) != 2 or not all(MIN_VOXEL_M < 1e-3 * x < MAX_VOXEL_M for x in between):
        raise InputError(
            f"PixelSpacing of frame {k + 1} is not two lengths from {1e3 * MIN_VOXEL_M:g} to "
            f"{1e3 * MAX_VOXEL_M:g} mm. Export it again.",
            where=where,
            code="volume-without-place",
        )
    axes = pixel_axes(orientation, (between[1], between[0]))
    if axes is None:
        raise InputError(
            f"ImageOrientationPatient of frame {k + 1} is no pair of square unit vectors. Export "
            "it again.",
            where=where,
            code="volume-without-place",
        )
    return np.array([float(x) for x in corner]) * 1e-3, axes
