"""Label maps in volumes: `.seg.nrrd` and `.nrrd` by pynrrd's header reader, NIfTI by nibabel.

Both are read in a process of its own, whose memory and time are limited by the file's header.

A mask knows its border to half a pixel only. The signed distance to the half-tone border, smoothed
by one pixel, crosses 0 where the border was on average: about 0.13 of a pixel off (RMS) on a bone.
"""

from __future__ import annotations

import io
import logging
import re
import warnings
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, InputError, VfplanError, requires_extra
from vfplan.geometry.lines import Array, unit_normal
from vfplan.images.raster import chosen_index
from vfplan.io.files import (
    GZIP_OR_ZLIB,
    MAX_DECOMPRESSED_BYTES,
    MAX_SETTINGS_BYTES,
    OpenedFile,
    decompress,
)  # fmt: skip
from vfplan.io.sandbox import raise_limits, raise_limits_for, run_in_sandbox
from vfplan.surface.outline import SAME_M, Contours, Structure, choose_structure

# Standard deviation of the smoothing [px], as the stairs of a mask are a pixel long.
SMOOTHING_PX = 1.0
# Empty pixels around a mask: as far as the smoothing reaches (SciPy cuts at 4 deviations).
PAD_PX = round(4 * SMOOTHING_PX)
# Shortest side of a voxel [m]. The finest scans of micro-CT have it.
MIN_VOXEL_M = 1e-5
# Longest side of a voxel [m]. A longer one is a slip of units.
MAX_VOXEL_M = 0.1
# Smallest volume of a voxel over that of a box with its sides. It is 0.87 where a gantry leans by
# 30 degrees.
MIN_VOXEL_VOLUME = 0.1
# Bytes of voxels in a byte of a file at most. Gzip cannot pack tighter than 1,032 to 1, and bzip2
# packs label maps 100 to 1.
MAX_PACKING = 2048
# Bytes of memory that a voxel may take while it is unpacked, scaled and outlined.
BYTES_PER_VOXEL = 32
# Voxels a second that are outlined at least.
VOXELS_PER_SECOND = 4_000_000


# A label map as its file has it: (L, I, J, K) integers; each structure -> its layer, and the label
# that its voxels have there; and (4, 4), which maps [i j k 1] to patient LPS [m].
LabelVolume = tuple[NDArray, dict[Structure, tuple[int, int]], Array]


def checked_place(T_lps_voxel: Array) -> Array:
    """The affine itself; raises `InputError` where it gives voxels no sound place."""
    columns = T_lps_voxel[:3, :3]
    sides = np.linalg.norm(columns, axis=0)
    is_sound = np.isfinite(T_lps_voxel).all() and (sides >= MIN_VOXEL_M).all()
    if not (is_sound and (sides <= MAX_VOXEL_M).all()):
        listed = ", ".join(f"{1e3 * side:.3g}" for side in sides)
        raise InputError(
            f"its voxels have sides of {listed} mm; {1e3 * MIN_VOXEL_M:g} to "
            f"{1e3 * MAX_VOXEL_M:g} mm are allowed. Check the unit of the file.",
            code="voxel-size",
        )
    if abs(np.linalg.det(columns / sides)) < MIN_VOXEL_VOLUME:
        raise InputError(
            "its voxels' axes are nearly in one plane. Export the label map again.",
            code="voxel-axes",
        )
    return T_lps_voxel


def rings_of_mask(inside: NDArray) -> tuple[list[Array], bool]:
    """(rings, smoothed): (M, 2) row and column [px] of each border of an (H, W) mask.

    Where smoothing would lose or join parts or holes, that slice keeps its stairs and `smoothed`
    is false.
    """
    from scipy.ndimage import distance_transform_edt, find_objects, gaussian_filter

    boxes = find_objects(inside.astype(np.uint8))
    if not boxes:
        return [], True
    mask = np.pad(inside[boxes[0]], PAD_PX)
    distance = distance_transform_edt(~mask) - distance_transform_edt(mask)
    distance -= np.where(mask, -0.5, 0.5)
    borders = zero_rings(distance)
    smooth_borders = zero_rings(gaussian_filter(distance, SMOOTHING_PX))
    keeps_parts = len(smooth_borders) == len(borders)
    first = np.array([side.start for side in boxes[0]])
    rings = smooth_borders if keeps_parts else borders
    return [ring + first - PAD_PX for ring in rings], keeps_parts


def zero_rings(values: Array) -> list[Array]:
    """Closed rings of the level 0, joined across corners that touch, without the repeated end."""
    from skimage.measure import find_contours

    return [ring[:-1] for ring in find_contours(values, 0.0) if len(ring) > 3]


def contours_of_volume(volume: LabelVolume, structure: str | None) -> Contours:
    """The outlines of one structure of a label map, slice by slice.

    The slices are those of the axis along which the voxels are longest, the last where all are
    equal.

    Raises
    ------
    InputError
        There is no such structure, or there are several and none was named.
    CurveError
        The structure has no voxels.
    """
    layers, places, T_lps_voxel = volume
    chosen = choose_structure(tuple(places), structure)
    steps = T_lps_voxel[:3, :3]
    sides = np.linalg.norm(steps, axis=0)
    across = 2 - int(np.argmax(np.round(sides[::-1] / sides.max(), 6)))
    layer, label = places[chosen]
    slices = np.moveaxis(layers[layer], across, 0)
    corners = T_lps_voxel[:3, 3] + np.arange(len(slices))[:, None] * steps[:, across]
    borders = (rings_of_mask(one == label) for one in slices)
    return contours_of_slices(
        tuple(places), chosen.number, {}, borders, corners, np.delete(steps, across, axis=1)
    )


def contours_of_slices(
    structures: tuple[Structure, ...],
    chosen: int,
    inputs: dict[str, str],
    borders: Iterable[tuple[list[Array], bool]],
    corners: Array,
    axes: Array,
) -> Contours:
    """The outlines of the chosen structure from its borders on parallel slices.

    borders: of each slice, as `rings_of_mask` gives them
    corners: (F, 3) the centre of each slice's first pixel [m]
    axes: (3, 2) a step from row to row and from column to column [m]
    Raises CurveError: no slice shows the structure
    """
    rings: list[Array] = []
    drawn = []
    stairs = 0
    for k, (borders_of_slice, is_smooth) in enumerate(borders):
        rings += [corners[k] + border @ axes.T for border in borders_of_slice]
        drawn += [k] * len(borders_of_slice)
        stairs += not is_smooth
    if not rings:
        raise CurveError(
            f"structure {chosen} has no pixels. Choose another with --structure.",
            code="structure-empty", numbers={"structure": chosen},
        )  # fmt: skip
    normal = unit_normal(axes)
    heights = corners @ normal
    is_empty = np.abs(heights[drawn] - heights[:, None]).min(axis=1) > SAME_M
    remarks: tuple[str, ...] = ()
    if stairs:
        remarks = (
            f"{stairs} slices keep their stairs, because smoothing would lose or join parts of the "
            "structure. Look at thin parts in the label map.",
        )
    return Contours(tuple(rings), structures, chosen, inputs, normal, corners[is_empty], remarks)


# Distance up to which NIfTI's sform and qform are the same: single precision and a quaternion round
# as far.
PLACES_AGREE_M = SAME_M / 2
# NRRD's name of a direction -> the axis of LPS and the sign there. Of a space like "LPS" a letter
# stands for each.
DIRECTIONS = {
    "left": (0, 1), "right": (0, -1), "posterior": (1, 1), "anterior": (1, -1),
    "superior": (2, 1), "inferior": (2, -1),
}  # fmt: skip
DIRECTIONS |= {name[0]: axis for name, axis in DIRECTIONS.items()}
# NRRD's name of a unit -> metres.
METRES = {
    "m": 1.0, "cm": 1e-2, "mm": 1e-3, "millimeter": 1e-3, "um": 1e-6, "µm": 1e-6, "micron": 1e-6,
    "nm": 1e-9,
}  # fmt: skip
# NRRD's name of an encoding -> the compression that it is.
COMPRESSIONS = {"raw": None, "gzip": "gzip", "gz": "gzip", "bzip2": "bzip2", "bz2": "bzip2"}
# A NIfTI file's first bytes, where it is of the first version: its header's size.
NIFTI_1 = ((348).to_bytes(4, "little"), (348).to_bytes(4, "big"))
GZIP = b"\x1f\x8b"
NRRD = b"NRRD"


@contextmanager
def library_errors(message: str) -> Iterator[None]:
    """Name what a library raises about a file from outside; it may raise all kinds of errors."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except VfplanError:
        raise
    except Exception as error:
        raise InputError(
            f"{message} ({type(error).__name__}). Export the label map again.",
            code="volume-unreadable",
        ) from None


def read_label_map(path: Path, structure: str | None) -> Contours:
    """The outlines of a structure of a label map; raises as its reader does."""
    file = OpenedFile(path)
    job = "vfplan.surface.volumes:outlines"
    answers = run_in_sandbox(job, structure, file=file, where=str(path))
    structures, chosen, normal, empty, remarks = next(answers)
    return Contours(
        tuple(ring for (ring,) in answers), tuple(Structure(*each) for each in structures),
        chosen, {"labels": file.sha256()}, normal=np.array(normal),
        empty=np.array(empty).reshape(-1, 3), remarks=tuple(remarks),
    )  # fmt: skip


def outlines(file: BinaryIO, structure: str | None) -> Iterator[Any]:
    """What `read_label_map` returns, in the sandbox: a head with all but the rings, then these."""
    found = contours_of_volume(read_volume(file), structure)
    structures = [(each.number, each.name) for each in found.structures]
    yield [structures, found.chosen, found.normal.tolist(), found.empty.tolist(), found.remarks]
    for ring in found.rings:
        yield (ring,)


def grey_slice(file: BinaryIO, number: int | None) -> Iterator[Any]:
    """A slice of a volume across its third axis, in the sandbox, for `vfplan.images.read`.

    number: from 1; of several `None` is refused, and 0 only counts them
    Yields how many there are, (4, 3) T_patient_image [m] and the range of the volume, then the
    (H, W) greys, uint16.
    """
    layers, _, place = read_volume(file, has_labels=False)
    if len(layers) != 1:
        raise InputError("holds several volumes. Export one.", code="volume-unsupported")
    voxels = layers[0]
    # A slice is looked at from the feet: the patient's left is right, and the back is below.
    for axis in range(2):
        if place[axis, axis] < 0:
            voxels = np.flip(voxels, axis)
            place[:3, 3] += place[:3, axis] * (voxels.shape[axis] - 1)
            place[:3, axis] *= -1
    index = chosen_index("slice", 1 if number == 0 else number, voxels.shape[2])
    place[:3, 3] += index * place[:3, 2]
    low, high = float(voxels.min()), float(voxels.max())
    if not np.isfinite([low, high]).all():
        text = "holds voxels that are no finite numbers. Export it with a value in their place."
        raise InputError(text, code="volume-unsupported")
    yield [voxels.shape[2], place[:, [0, 1, 3]].tolist(), [low, high]]
    if number != 0:
        share = (voxels[:, :, index].T.astype(float) - low) / (high - low or 1.0)
        yield (np.rint(np.iinfo(np.uint16).max * share).astype("<u2"),)


def read_volume(file: BinaryIO, *, has_labels: bool = True) -> LabelVolume:
    """The volume in a file, NRRD or NIfTI; raises as its reader does."""
    raise_limits_for(file)
    data = file.read()
    read = read_nrrd if data.startswith(NRRD) else read_nifti
    return read(data, has_labels=has_labels)


def read_nrrd(data: bytes, *, has_labels: bool = True) -> LabelVolume:
    """A Slicer segmentation, or any label map, in one NRRD file; without labels a volume of greys.

    Raises
    ------
    InputError
        The file is damaged, has no place in the patient, or is no label map.
    MissingExtra
        pynrrd is not installed.
    """
    with requires_extra("reading NRRD needs pynrrd", "surface"):
        import nrrd
        from nrrd.reader import _determine_datatype

    # An empty line ends the header.
    end = re.search(rb"\n\n|\r\n\r\n", data[:MAX_SETTINGS_BYTES])
    if end is None:
        raise InputError("has no NRRD header that ends. Export it again.", code="volume-unreadable")
    with library_errors("its NRRD header cannot be read"):
        header = dict(nrrd.read_header(io.BytesIO(data[: end.end()])))
    with library_errors("its NRRD header does not say what it holds"):
        dtype = np.dtype(_determine_datatype(header))
        sizes = [int(n) for n in header["sizes"]]
        encoding = str(header["encoding"]).lower()
    if encoding not in COMPRESSIONS:
        text = f"has the encoding {encoding!r}. Save it from Slicer as one .seg.nrrd."
        raise InputError(text, code="volume-unsupported")
    kinds = "iu" if has_labels else "iuf"
    if dtype.kind not in kinds or len(sizes) not in (3, 4) or min(sizes) < 1:
        raise InputError(f"holds {dtype} of {sizes}. Give a label map.", code="not-a-label-map")
    size = int(np.prod(sizes, dtype=object)) * dtype.itemsize
    require_size(size, len(data))
    # Voxels of another file are never looked for.
    voxels = data[end.end() :]
    if compression := COMPRESSIONS[encoding]:
        voxels = decompress(voxels, compression, size)
    if len(voxels) != size:
        raise InputError(
            f"holds {len(voxels)} bytes of voxels, and its header says {size}. Save it from Slicer "
            "as one .seg.nrrd.",
            code="volume-unreadable", numbers={"bytes": len(voxels), "bytes_wanted": size},
        )  # fmt: skip
    layers = np.frombuffer(voxels, dtype).reshape((1, *sizes)[-4:], order="F")
    T_lps_voxel = nrrd_place(header)
    places = (nrrd_segments(header, len(layers)) or places_of_labels(layers)) if has_labels else {}
    return layers, places, T_lps_voxel


def require_size(size: int, file_bytes: int) -> None:
    """Refuse voxels that no such file holds; allow the memory and the time that others need."""
    largest = min(MAX_DECOMPRESSED_BYTES, MAX_SETTINGS_BYTES + MAX_PACKING * file_bytes)
    if size > largest:
        raise InputError(
            f"says that it holds {size} bytes of voxels; {largest} are allowed in a file of its "
            "length. Export a part of it, packed by gzip.",
            code="volume-too-large", numbers={"bytes": size, "bytes_max": largest},
        )  # fmt: skip
    raise_limits(BYTES_PER_VOXEL * size, size // VOXELS_PER_SECOND)


def nrrd_place(header: dict[str, Any]) -> NDArray:
    """(4, 4) T_lps_voxel [m] as the header states it."""
    space = str(header.get("space", "")).lower()
    axes = [DIRECTIONS.get(word, (0, 0)) for word in (space.split("-") if "-" in space else space)]
    if sorted(axis for axis, _ in axes) != [0, 1, 2]:
        raise InputError(
            f"its space is {space!r}. Give one of the patient, such as LPS or RAS.",
            code="volume-without-place",
        )
    units = [str(unit).lower() for unit in header.get("space units", ["mm"] * 3)]
    if len(units) != 3 or not METRES.keys() >= {*units}:
        raise InputError(
            f"its space units are {', '.join(units)[:60]!r}. Give one of {', '.join(METRES)} for "
            "each axis.",
            code="unit-unknown",
        )
    # Each axis of the space in LPS [m].
    lps_space = np.zeros((3, 3))
    for column, (axis, sign) in enumerate(axes):
        lps_space[axis, column] = sign * METRES[units[column]]
    try:
        directions = np.array(header["space directions"], float)[-3:]
        T_lps_voxel = np.eye(4)
        T_lps_voxel[:3, :3] = lps_space @ directions.T
        T_lps_voxel[:3, 3] = lps_space @ np.array(header["space origin"], float)
    except (KeyError, ValueError, TypeError):
        raise InputError(
            "does not say where its voxels lie in the patient. Export it with its place.",
            code="volume-without-place",
        ) from None
    return checked_place(T_lps_voxel)


def nrrd_segments(header: dict[str, Any], layer_count: int) -> dict[Structure, tuple[int, int]]:
    """The segments as Slicer writes them, with their places; none in a plain label map.

    Numbered in their order: in two layers the same label may stand for two segments.
    """
    places = {}
    for key in header:
        prefix, _, field = str(key).partition("_")
        if field != "LabelValue" or not prefix.startswith("Segment"):
            continue
        with library_errors("a segment's label or layer is no number"):
            label = int(header[key])
            layer = int(header.get(f"{prefix}_Layer", 0))
        if not 0 <= layer < layer_count:
            raise InputError(
                f"a segment is in layer {layer} of {layer_count}. Save it from Slicer again.",
                code="volume-unreadable",
            )
        structure = Structure(len(places) + 1, str(header.get(f"{prefix}_Name", "")))
        places[structure] = layer, label
    return places


def read_nifti(data: bytes, *, has_labels: bool = True) -> LabelVolume:
    """A label map in a `.nii` or `.nii.gz` file; without labels a volume of greys.

    Raises
    ------
    InputError
        The file is damaged, has no place in the patient or two, or is no label map.
    MissingExtra
        nibabel is not installed.
    """
    with requires_extra("reading NIfTI needs nibabel", "surface"):
        import nibabel
    logging.getLogger("nibabel.global").setLevel(logging.CRITICAL)
    is_packed = data.startswith(GZIP)
    with library_errors("cannot be read as NIfTI"):
        head = zlib.decompressobj(GZIP_OR_ZLIB).decompress(data, 540) if is_packed else data
        kind = nibabel.Nifti1Image if head[:4] in NIFTI_1 else nibabel.Nifti2Image
        header = kind.header_class(head[: kind.header_class.template_dtype.itemsize])
        shape = tuple(int(n) for n in header.get_data_shape())
        size = int(np.prod(shape, dtype=object)) * header.get_data_dtype().itemsize
    if min(shape, default=0) < 1:
        raise InputError(f"its voxels are {shape}. Give one volume.", code="not-a-label-map")
    require_size(size, len(data))
    if is_packed:
        # Extensions come between the header and the voxels.
        data = decompress(data, "gzip", min(size + MAX_SETTINGS_BYTES, MAX_DECOMPRESSED_BYTES))
    with library_errors("cannot be read as NIfTI"):
        image = kind.from_bytes(data)
        labels = np.asanyarray(image.dataobj)
        T_lps_voxel = nifti_place(image)
    if labels.ndim == 4 and labels.shape[3] == 1:
        labels = labels[..., 0]
    if labels.ndim != 3:
        raise InputError(f"its voxels are {shape}. Give one volume.", code="not-a-label-map")
    if not has_labels:
        return labels[None], {}, T_lps_voxel
    if labels.dtype.kind not in "iu":
        if labels.dtype.kind != "f" or not (np.rint(labels) == labels).all():
            raise InputError(
                "holds fractions. Give a label map, whose voxels are whole numbers.",
                code="not-a-label-map",
            )
        labels = labels.astype(np.int32)
    layers = labels[None]
    return layers, places_of_labels(layers), T_lps_voxel


def nifti_place(image: Any) -> NDArray:
    """(4, 4) T_lps_voxel [m] of the file's two places, which must agree if both are given."""
    sform, sform_code = image.get_sform(coded=True)
    qform, qform_code = image.get_qform(coded=True)
    if not sform_code and not qform_code:
        raise InputError(
            "does not say where its voxels lie in the patient. Export it with its place.",
            code="volume-without-place",
        )
    # The codes of an unnamed unit, the metre, the millimetre and the micrometre.
    metres_of_code = {0: 1e-3, 1: 1.0, 2: 1e-3, 3: 1e-6}
    code = int(image.header["xyzt_units"]) & 7
    if code not in metres_of_code:
        raise InputError(
            f"its unit of length has the code {code}; 0 to 3 are allowed. Export it in "
            "millimetres.",
            code="volume-without-place",
        )
    metres = metres_of_code[code]
    if sform_code and qform_code:
        corner = np.array([*image.shape[:3], 1.0])
        both_ends = np.column_stack([(sform - qform) @ corner, (sform - qform)[:, 3]])
        distance = np.abs(both_ends[:3]).max() * metres
        if not distance <= PLACES_AGREE_M:
            raise InputError(
                f"its two places in the patient (sform, qform) are {1e3 * distance:.3g} mm "
                f"apart; {1e3 * PLACES_AGREE_M:g} mm is rounding. Remove the wrong one.",
                code="volume-places-differ", numbers={"distance_mm": 1e3 * distance},
            )  # fmt: skip
    T_lps_voxel = np.array(sform if sform_code else qform, float)
    T_lps_voxel[:3] *= np.array([-metres, -metres, metres])[:, None]
    return checked_place(T_lps_voxel)


def places_of_labels(layers: NDArray) -> dict[Structure, tuple[int, int]]:
    """The structures of a plain label map: each label but 0 is one."""
    if len(layers) > 1:
        raise InputError(
            f"has {len(layers)} layers and names no segments. Save it from Slicer as .seg.nrrd.",
            code="volume-unsupported",
        )
    labels = np.unique(layers)
    largest_allowed = np.iinfo(np.uint16).max
    if labels[0] < 0 or labels[-1] > largest_allowed:
        raise InputError(
            f"holds labels {labels[0]} to {labels[-1]}; 0 to {largest_allowed} are allowed. Give a "
            "label map.",
            code="not-a-label-map",
        )
    return {Structure(label): (0, label) for label in labels[labels > 0].tolist()}
