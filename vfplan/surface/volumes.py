"""Label maps in volumes: `.seg.nrrd` and `.nrrd` by pynrrd's header reader, NIfTI by nibabel."""

from __future__ import annotations

import io
import logging
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import InputError, requires_extra
from vfplan.io.files import MAX_DECOMPRESSED_BYTES, decompress, first_decompressed, read_bytes
from vfplan.surface.contours import Structure
from vfplan.surface.labels import LabelVolume, checked_place

NRRD_HEADER = 1 << 20
# Sign of each patient axis against LPS, by the name that a header gives its space.
SPACES = {
    "left-posterior-superior": (1, 1, 1),
    "lps": (1, 1, 1),
    "right-anterior-superior": (-1, -1, 1),
    "ras": (-1, -1, 1),
    "left-anterior-superior": (1, -1, 1),
    "las": (1, -1, 1),
}
NIFTI_HEADER = 1 << 20  # with its extensions
NIFTI_UNITS = {0: 1e-3, 1: 1.0, 2: 1e-3, 3: 1e-6}
PLACES_AGREE_M = 1e-5  # sform and qform, rounded to single precision and to a quaternion
MAX_LABELS = 65536


def read_nrrd(path: Path) -> LabelVolume:
    """A Slicer segmentation, or any label map, in one NRRD file.

    Raises InputError: damaged, without a place in the patient, or no label map
    Raises MissingExtra: pynrrd is not installed
    """
    where = str(path)
    data, digest = read_bytes(path)
    end = data.find(b"\n\n", 0, NRRD_HEADER)
    end = data.find(b"\r\n\r\n", 0, NRRD_HEADER) + 2 if end < 0 else end
    if end < 2:
        raise InputError("has no NRRD header that ends.", where=where)
    header = _nrrd_header(data[: end + 2], where)
    layers = _nrrd_layers(header, data[end + 2 :], where)
    return _with_labels(
        layers,
        _nrrd_place(header, layers.ndim, where),
        _nrrd_segments(header, where),
        digest,
        where,
    )


def _nrrd_header(head: bytes, where: str) -> dict[str, Any]:
    with requires_extra("reading NRRD needs pynrrd", "surface", where):
        import nrrd
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return dict(nrrd.read_header(io.BytesIO(head)))
    except Exception as error:  # a file from outside: the library raises all kinds
        raise InputError(
            f"its NRRD header cannot be read ({type(error).__name__}).", where=where
        ) from None


def _nrrd_layers(header: dict[str, Any], data: bytes, where: str) -> NDArray:
    """(L, I, J, K) from the bytes behind a header."""
    from nrrd.reader import _determine_datatype

    if "data file" in header or "datafile" in header:
        raise InputError("its voxels are in another file. Give one file.", where=where)
    try:
        dtype = np.dtype(_determine_datatype(header))
        sizes = [int(n) for n in header["sizes"]]
        encoding = str(header["encoding"]).lower()
    except Exception as error:
        raise InputError(
            f"its NRRD header does not say what it holds ({type(error).__name__}).", where=where
        ) from None
    kinds = {"raw": None, "gzip": "gzip", "gz": "gzip", "bzip2": "bzip2", "bz2": "bzip2"}
    if encoding not in kinds:
        raise InputError(f"encoding {encoding!r}. Give raw, gzip or bzip2.", where=where)
    if dtype.kind not in "iu" or len(sizes) not in (3, 4) or min(sizes) < 1:
        raise InputError(f"holds {dtype} of {sizes}. Give a label map.", where=where)
    wanted = int(np.prod(sizes, dtype=object)) * dtype.itemsize
    if wanted > MAX_DECOMPRESSED_BYTES:
        raise InputError(
            f"says that it holds {wanted} bytes. {MAX_DECOMPRESSED_BYTES} allowed.", where=where
        )
    if header.get("line skip") or header.get("byte skip"):
        raise InputError("skips lines or bytes. Save it from Slicer as .seg.nrrd.", where=where)
    kind = kinds[encoding]
    voxels = data if kind is None else decompress(data, kind, where, wanted)
    if len(voxels) != wanted:
        raise InputError(f"holds {len(voxels)} bytes of voxels. {wanted} are wanted.", where=where)
    array = np.frombuffer(voxels, dtype).reshape(sizes, order="F")
    return array if array.ndim == 4 else array[None]


def _nrrd_place(header: dict[str, Any], dimensions: int, where: str) -> NDArray:
    space = str(header.get("space", "")).lower()
    if space not in SPACES:
        raise InputError(f"space is {space!r}. One of {', '.join(SPACES)} is wanted.", where=where)
    try:
        directions = np.array(header["space directions"], dtype=float)[-3:]
        origin = np.array(header["space origin"], dtype=float)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = directions.T * 1e-3, origin * 1e-3
    except (KeyError, ValueError, TypeError):
        raise InputError("does not say where its voxels lie in the patient.", where=where) from None
    T[:3] *= np.array(SPACES[space])[:, None]
    return checked_place(T, where)


def _nrrd_segments(header: dict[str, Any], where: str) -> list[tuple[Structure, int, int]] | None:
    """(structure, layer, label) as Slicer writes them; `None` for a plain label map.

    Numbered in their order: in two layers the same label may stand for two segments.
    """
    found = []
    for key in header:
        name, _, what = str(key).partition("_")
        if what != "LabelValue" or not name.startswith("Segment"):
            continue
        try:
            label, layer = int(header[key]), int(header.get(f"{name}_Layer", 0))
        except ValueError:
            raise InputError("a segment's label or layer is no number.", where=where) from None
        segment = Structure(len(found) + 1, str(header.get(f"{name}_Name", "")))
        found.append((segment, layer, label))
    return found or None


def read_nifti(path: Path) -> LabelVolume:
    """A label map in a `.nii` or `.nii.gz` file.

    Raises InputError: damaged, without a place in the patient or with two, or no label map
    Raises MissingExtra: nibabel is not installed
    """
    where = str(path)
    data, digest = read_bytes(path)
    with requires_extra("reading NIfTI needs nibabel", "surface", where):
        import nibabel
    if data[:2] == b"\x1f\x8b":
        data = decompress(data, "gzip", where, _nifti_bytes(first_decompressed(data), where))
    log = logging.getLogger("nibabel.global")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        kind = nibabel.Nifti1Image if data[:4] in _sizeof(348) else nibabel.Nifti2Image
        image = kind.from_bytes(data)
        shape = tuple(int(n) for n in image.shape)
        dtype = image.get_data_dtype()
        size = int(np.prod(shape, dtype=object)) * dtype.itemsize
        if size > len(data):
            raise InputError(f"says that it holds {size} bytes of voxels.", where=where)
        labels = np.asanyarray(image.dataobj)
        T = _nifti_place(image, where)
    except InputError:
        raise
    except Exception as error:  # a file from outside: the library raises all kinds
        raise InputError(
            f"cannot be read as NIfTI ({type(error).__name__}).", where=where
        ) from None
    finally:
        log.setLevel(level)
    if labels.ndim == 4 and labels.shape[3] == 1:
        labels = labels[..., 0]
    if labels.ndim != 3:
        raise InputError(f"its voxels are {shape}. Give a volume.", where=where)
    return _with_labels(_whole(labels, where)[None], T, None, digest, where)


def _nifti_bytes(head: bytes, where: str) -> int:
    """The most bytes that a file with this header can want, extensions included."""
    order = "little" if head[:4] in (_sizeof(348)[0], _sizeof(540)[0]) else "big"
    one = head[:4] in _sizeof(348)
    at, width = (40, 2) if one else (16, 8)
    sizes = [int.from_bytes(head[at + width * k :][:width], order) for k in range(1, 8)]
    count = min(max(int.from_bytes(head[at : at + width], order), 1), 7)
    voxels = 8 * int(np.prod(sizes[:count], dtype=object))
    if voxels > 8 * MAX_DECOMPRESSED_BYTES:
        raise InputError(f"says that it has voxels {sizes[:count]}, too many.", where=where)
    return min(voxels + NIFTI_HEADER, MAX_DECOMPRESSED_BYTES)


def _sizeof(size: int) -> tuple[bytes, bytes]:
    return size.to_bytes(4, "little"), size.to_bytes(4, "big")


def _nifti_place(image: Any, where: str) -> NDArray:
    sform, s_code = image.get_sform(coded=True)
    qform, q_code = image.get_qform(coded=True)
    if not s_code and not q_code:
        raise InputError("does not say where its voxels lie in the patient.", where=where)
    unit = int(image.header["xyzt_units"]) & 7
    if unit not in NIFTI_UNITS:
        raise InputError(
            f"its unit of length has the code {unit}; 0 to 3 are allowed.", where=where
        )
    metres = NIFTI_UNITS[unit]
    if s_code and q_code:
        corner = np.array([*image.shape[:3], 1.0])
        apart = max(np.abs((sform - qform) @ corner)[:3].max(), np.abs(sform - qform)[:3, 3].max())
        if not apart * metres <= PLACES_AGREE_M:
            raise InputError(
                f"its two places in the patient (sform, qform) are {1e3 * apart * metres:.3g} mm "
                f"apart. {1e3 * PLACES_AGREE_M:g} mm is rounding.",
                where=where,
            )
    T = np.array(sform if s_code else qform, dtype=float)
    T[:3] *= np.array([-metres, -metres, metres])[:, None]
    return checked_place(T, where)


def _whole(labels: NDArray, where: str) -> NDArray:
    """The same labels as integers; refuses fractions."""
    if labels.dtype.kind in "iu":
        return labels
    if labels.dtype.kind != "f" or not (np.rint(labels) == labels).all():
        raise InputError("holds fractions. Whole numbers label structures.", where=where)
    return labels.astype(np.int32)


def _with_labels(
    layers: NDArray,
    T: NDArray,
    segments: list[tuple[Structure, int, int]] | None,
    digest: str,
    where: str,
) -> LabelVolume:
    inputs = {"labels": digest}
    if segments is not None:
        wrong = [layer for _, layer, _ in segments if not 0 <= layer < len(layers)]
        if wrong:
            raise InputError(f"a segment is in layer {wrong[0]} of {len(layers)}.", where=where)
        held = {s.number: (layer, value) for s, layer, value in segments}
        return LabelVolume(layers, held, T, tuple(s for s, _, _ in segments), inputs)
    if len(layers) > 1:
        raise InputError(f"has {len(layers)} layers and names no segments.", where=where)
    least, largest = int(layers.min()), int(layers.max())
    if least < 0 or largest >= MAX_LABELS:
        raise InputError(
            f"holds labels {least} to {largest}; 0 to {MAX_LABELS - 1} are allowed.", where=where
        )
    seen = np.zeros(largest + 1, dtype=bool)
    for k in range(layers.shape[3]):
        seen[layers[0, :, :, k]] = True
    structures = tuple(Structure(int(n)) for n in np.flatnonzero(seen[1:]) + 1)
    return LabelVolume(layers, {s.number: (0, s.number) for s in structures}, T, structures, inputs)
