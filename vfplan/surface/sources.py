"""What kind of source a file of outlines is, and the reader of each that is no label map.

Outlines come as contours of an RTSTRUCT, frames of a DICOM SEG, Slicer's closed curves, or drawings
on a folder of DICOM slices. Names, dates and identifiers of the patient are not read; a structure
that is named like the patient loses its name.
"""

from __future__ import annotations

import hashlib
import io
from pathlib import Path
from typing import Any

import numpy as np

from vfplan.errors import CurveError, ImageError, InputError
from vfplan.geometry.lines import Array, homogeneous, unit_normal
from vfplan.images.dicom import (
    begins_like_dicom,
    group_value,
    open_dataset,
    place_in_patient,
    read_spacing,
    refuse_costly,
)
from vfplan.io.files import MAX_TEXT_BYTES, naming_place, opened_file, read_bytes, read_text
from vfplan.surface import volumes
from vfplan.surface.outline import SAME_M, Contours, Structure, choose_structure
from vfplan.surface.volumes import MAX_VOXEL_M, MIN_VOXEL_M
from vfplan.vectors.curve import FINE_M, VectorDrawing, without_repeated_end

# Number of bytes by which a file's kind is known. DICOM's mark ends at byte 132.
HEAD_BYTES = 256
RTSTRUCT = "1.2.840.10008.5.1.4.1.1.481.3"
SEG = ("1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7")
SEGMENTATION_TYPES = ("BINARY", "FRACTIONAL", "LABELMAP")
CLOSED_CONTOURS = ("CLOSED_PLANAR", "CLOSEDPLANAR_XOR")


def read_contours(
    sources: list[Path], structure: str | None = None, colour: str = "red",
    curve_type: str | None = None,
) -> Contours:  # fmt: skip
    """The outlines of one structure.

    Parameters
    ----------
    sources
        One file; or several `.mrk.json`; or a folder of DICOM slices, each with a drawing.
    structure
        Its name or number in a source that holds several.
    colour
        The pen's, on drawn slices.
    curve_type
        As in `read_vector_curve`.

    Raises
    ------
    InputError
        A source is none of these, is damaged, or has no such structure.
    """
    first = sources[0]
    are_curves = all(path.name.lower().endswith(".json") for path in sources)
    if len(sources) > 1 and not are_curves:
        raise InputError(
            f"is one of {len(sources)} sources. Give one; several are read of .mrk.json alone.",
            where=sources[1], code="source-several", numbers={"sources": len(sources)},
        )  # fmt: skip
    with naming_place(first):
        if structure is not None and (are_curves or first.is_dir()):
            text = f"holds drawn curves, which have no names. Leave --structure {structure!r} out."
            raise InputError(text, code="structure-unknown")
        if first.is_dir():
            return read_drawn_slices(first, colour)
        if are_curves:
            return read_slicer_curves(sources, curve_type)
        if curve_type is not None:
            text = "is no curve of Slicer. Leave --curve-type out."
            raise InputError(text, code="setting-without-effect")
        with opened_file(first) as file:
            head = file.read(HEAD_BYTES)
        if head.startswith(volumes.NRRD) or first.name.lower().endswith((".nii", ".nii.gz")):
            return volumes.read_label_map(first, structure)
        if begins_like_dicom(head):
            return read_dicom_contours(first, structure)
        raise InputError(
            "is no source of outlines. Give RTSTRUCT, DICOM SEG, .seg.nrrd, .nii, .nii.gz, "
            ".mrk.json or a folder of drawn slices.",
            code="source-unknown",
        )


def read_dicom_contours(path: Path, structure: str | None) -> Contours:
    """The outlines of one structure of an RTSTRUCT or a DICOM SEG.

    Raises
    ------
    InputError
        The file is damaged, of another kind, or of a shape that is not supported, or there is no
        such structure.
    """
    data, digest = read_bytes(path, MAX_TEXT_BYTES)
    refuse_costly(data)
    with open_dataset(io.BytesIO(data), InputError, needs_preamble=False) as dataset:
        kind = str(dataset.get("SOPClassUID", ""))
        if kind == RTSTRUCT:
            return contours_of_rtstruct(dataset, structure, {"contours": digest})
        if kind in SEG:
            return contours_of_segmentation(dataset, structure, {"labels": digest})
        modality = str(dataset.get("Modality", "")) or "an unknown kind"
        raise InputError(
            f"is DICOM of {modality[:16]}. Give RTSTRUCT, SEG or a folder of drawn slices.",
            code="source-unknown",
        )


def without_patient_names(
    dataset: Any, numbered_names: list[tuple[int, str]]
) -> tuple[Structure, ...]:
    """Structures; a name that holds a part of the patient's name or number is left out."""
    keywords = ("PatientName", "PatientID", "OtherPatientIDs", "PatientBirthName")
    text = " ".join(str(dataset.get(keyword, "") or "") for keyword in keywords)
    secrets = [part for part in text.lower().replace("^", " ").split() if len(part) > 2]
    return tuple(
        Structure(number, "" if any(secret in name.lower() for secret in secrets) else name)
        for number, name in numbered_names
    )


def contours_of_rtstruct(dataset: Any, wanted: str | None, inputs: dict[str, str]) -> Contours:
    """The closed contours of one structure of an RTSTRUCT."""
    rois = dataset.get("StructureSetROISequence") or ()
    names = [(int(roi.ROINumber), str(roi.get("ROIName", ""))) for roi in rois]
    structures = without_patient_names(dataset, names)
    chosen = choose_structure(structures, wanted)

    rings, others, broken = [], 0, 0
    for roi in dataset.get("ROIContourSequence") or ():
        if int(roi.ReferencedROINumber) != chosen.number:
            continue
        for contour in roi.get("ContourSequence") or ():
            if str(contour.get("ContourGeometricType", "")) in CLOSED_CONTOURS:
                ring = ring_of_contour(contour)
                is_ring = len(np.unique(ring, axis=0)) > 2
                rings += [ring] * is_ring
                broken += not is_ring
            else:
                others += 1
    if not rings:
        raise InputError(
            f"structure {chosen.number} has no closed contour and {others} that are open or single "
            "points. Choose another with --structure, draw its outlines, or take an open one as a "
            "curve: vfplan extract SLICE --curve FILE.",
            code="structure-empty", numbers={"structure": chosen.number, "others": others},
        )  # fmt: skip
    kinds = ((others, "open or single points", "Close"), (broken, "closed, of two points", "Draw"))
    remarks = tuple(
        f"{number} contours are {kind} and are left out. {verb} them if they are outlines."
        for number, kind, verb in kinds
        if number
    )
    return Contours(tuple(rings), structures, chosen.number, inputs, remarks=remarks)


def ring_of_contour(contour: Any) -> Array:
    """(M, 3) LPS [m] of one contour, from its text as it stands in the file."""
    value = contour.get_item("ContourData").value
    if isinstance(value, bytes):
        value = value.rstrip(b" \0").split(b"\\")
    numbers = np.array([float(x) for x in value])
    if numbers.size % 3 or not np.isfinite(numbers).all():
        raise InputError(
            "a contour is not made of triples of finite numbers. Export the structure again.",
            code="outline-not-finite",
        )
    return without_repeated_end(numbers.reshape(-1, 3) * 1e-3)[0]


def contours_of_segmentation(dataset: Any, wanted: str | None, inputs: dict[str, str]) -> Contours:
    """The borders of one segment of a SEG, frame by frame."""
    # Number 0 is the background of a LABELMAP.
    names = [
        (int(one.SegmentNumber), str(one.get("SegmentLabel", "")))
        for one in dataset.SegmentSequence
        if int(one.SegmentNumber)
    ]
    structures = without_patient_names(dataset, names)
    chosen = choose_structure(structures, wanted)
    kind = str(dataset.SegmentationType)
    if kind not in SEGMENTATION_TYPES:
        raise InputError(
            f"is a segmentation of type {kind[:16]!r}. Give BINARY, FRACTIONAL or LABELMAP.",
            code="volume-unsupported",
        )
    corners, axes, members = frames_of_segment(dataset, chosen.number)
    largest_share = float(dataset.get("MaximumFractionalValue", 1) or 1)
    frames = dataset.pixel_array.reshape(-1, int(dataset.Rows), int(dataset.Columns))
    borders: list[tuple[list[Array], bool]] = [([], True)] * len(frames)
    for k in members:
        if kind == "FRACTIONAL":
            padded = np.pad(frames[k] / largest_share, 1)
            borders[k] = [ring - 1 for ring in volumes.zero_rings(0.5 - padded)], True
        else:
            label = chosen.number if kind == "LABELMAP" else 1
            borders[k] = volumes.rings_of_mask(frames[k] == label)
    # DICOM's first step is that from column to column.
    axes = axes[:, ::-1]
    return volumes.contours_of_slices(structures, chosen.number, inputs, borders, corners, axes)


def frames_of_segment(dataset: Any, segment: int) -> tuple[Array, Array, list[int]]:
    """Where the frames of a segmentation lie, in the patient's LPS frame [m].

    (F, 3) the centre of each frame's first pixel, (3, 2) a step from column to column and from row
    to row, and which frames belong to the segment, from 0. Raises `InputError` where their places
    are not sound.
    """
    rows, columns = int(dataset.Rows), int(dataset.Columns)
    count = int(dataset.get("NumberOfFrames") or 1)
    # A pixel takes a byte or more, and a thousand frames of 512 x 512 have fewer pixels.
    if not 0 < rows * columns * count <= MAX_TEXT_BYTES:
        raise InputError(
            f"says that it has {count} frames of {rows} x {columns}; {MAX_TEXT_BYTES} pixels are "
            "allowed in all. Export a part of it.",
            code="volume-too-large", numbers={"frames": count, "rows": rows, "columns": columns},
        )  # fmt: skip
    frames = [frame_place(dataset, k) for k in range(count)]
    corners, all_axes = map(np.array, zip(*frames, strict=True))
    axes = all_axes[0]
    differs = np.abs(all_axes - axes).max(axis=(1, 2)) > 1e-12
    if differs.any():
        raise InputError(
            f"frame {differs.argmax() + 1} differs from the first in orientation or pixel spacing. "
            "Export parallel frames of one size.",
            code="volume-unsupported",
        )
    names = "SegmentIdentificationSequence", "ReferencedSegmentNumber"
    numbers = [group_value(dataset, *names, k) for k in range(count)]
    members = [k for k, number in enumerate(numbers) if number is None or int(number) == segment]

    heights = np.sort(corners[members] @ unit_normal(axes))
    doubled = np.flatnonzero(np.diff(heights) < SAME_M)
    if len(doubled):
        raise InputError(
            f"two frames of the segment lie in one slice, at {1e3 * heights[doubled[0]]:z.3f} mm "
            "along its normal. Export each slice once.",
            code="slices-doubled",
        )
    return corners, axes, members


def frame_place(dataset: Any, k: int) -> tuple[Array, Array]:
    """Corner (3,) and axes (3, 2) of a frame, LPS [m]."""
    spacing_mm = read_spacing(dataset, "PixelSpacing", k)
    place = place_in_patient(dataset, spacing_mm, k)
    if place is None or not all(MIN_VOXEL_M < 1e-3 * x < MAX_VOXEL_M for x in spacing_mm):
        raise InputError(
            f"frame {k + 1} does not say where it lies in the patient, or its PixelSpacing is not "
            f"from {1e3 * MIN_VOXEL_M:g} to {1e3 * MAX_VOXEL_M:g} mm. Export it with its place.",
            code="volume-without-place",
        )
    return place[:3, 2], place[:3, :2]


def read_slicer_curves(paths: list[Path], curve_type: str | None = None) -> Contours:
    """Every ClosedCurve of one or more `.mrk.json` files.

    Raises `InputError` where a file holds none, an open curve, or is damaged.
    """
    from vfplan.markers.correspondences import lps_points, markups_of

    rings = []
    difference_m = 0.0
    digest = hashlib.sha256()
    joined = "straight" if curve_type == "linear" else "slicer"
    for path in paths:
        text, sha256 = read_text(path, MAX_TEXT_BYTES, InputError)
        digest.update(bytes.fromhex(sha256))
        with naming_place(path):
            markups = markups_of(text)
            kinds = sorted({str(markup.get("type")) for markup in markups})
            if kinds != ["ClosedCurve"]:
                text = f"holds {', '.join(kinds)[:99] or 'nothing'}. Give closed curves."
                raise InputError(text, code="curve-not-closed")
            for points in map(lps_points, markups):
                if len(points) < 3:
                    text = f"a curve has {len(points)} points. Give at least 3."
                    raise InputError(text, code="outline-empty")
                curve = VectorDrawing(points, True, joined, "")
                if curve_type is None:
                    difference_m = max(difference_m, curve.distance_from_straight())
                rings.append(curve.stroke(FINE_M).points)
    return Contours(
        tuple(rings), (Structure(1),), 1, {"curves": digest.hexdigest()},
        type_difference_m=difference_m,
    )  # fmt: skip


def read_drawn_slices(folder: Path, colour: str) -> Contours:
    """The closed curves drawn on a folder's DICOM slices, each placed by its own slice.

    Slices without a drawing are passed over; they are named by their place in the folder's order,
    for exporters name files by identifiers.

    Raises `InputError` for a file that is no DICOM slice or has no place in the patient, and for a
    drawing that is not closed.
    """
    from vfplan.planning.extraction import extract
    from vfplan.planning.settings import ExtractSettings

    files = [path for path in sorted(folder.iterdir()) if path.is_file()]
    rings, remarks = [], []
    digest = hashlib.sha256()
    slices_without_drawing = 0
    for number, path in enumerate(files, start=1):
        where = f"{folder}, file {number} of {len(files)} by name"
        try:
            extracted = extract(path, ExtractSettings(colour=colour, stroke="all"))
        except InputError as error:
            if error.code == "image-grey":
                slices_without_drawing += 1
                continue
            error.where = where
            raise
        place = extracted.image.T_patient_image
        if place is None:
            raise ImageError(
                "does not say where it lies in the patient. Give DICOM slices.",
                where=where, code="slice-without-place",
            )  # fmt: skip
        digest.update(bytes.fromhex(extracted.image.sha256))
        remarks += [f"{where}: {finding.text}" for finding in extracted.findings if finding.is_open]
        for stroke in extracted.extraction.strokes:
            if not stroke.closed:
                raise CurveError(
                    f"a drawing of {stroke.length:.0f} px is open. Close the outline.",
                    where=where, code="outline-open", numbers={"length_px": stroke.length},
                )  # fmt: skip
            rings.append((homogeneous(stroke.points_px) @ place.T)[:, :3])
    if not rings:
        raise CurveError(
            f"none of {len(files)} slices shows a drawing. Name the pen's colour with --colour.",
            code="structure-empty", numbers={"slices": len(files)},
        )  # fmt: skip
    if slices_without_drawing:
        remarks.append(
            f"{slices_without_drawing} of {len(files)} slices show no drawing. Check that none was "
            "forgotten."
        )
    inputs = {"slices": digest.hexdigest()}
    return Contours(tuple(rings), (Structure(1),), 1, inputs, remarks=tuple(remarks))
