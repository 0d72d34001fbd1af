"""What kind of source files are, and the reader of each."""

from __future__ import annotations

from pathlib import Path

from vfplan.errors import InputError
from vfplan.io.files import naming_place, opened_file
from vfplan.surface.contours import Contours
from vfplan.surface.labels import contours_of_volume

HEAD_BYTES = 256
SUFFIXES = "RTSTRUCT, DICOM SEG, .seg.nrrd, .nii, .nii.gz, .mrk.json or a folder of drawn slices"


def read_contours(
    sources: list[Path], structure: str | None = None, colour: str = "red"
) -> Contours:
    """The outlines of one structure.

    sources: one file; or several `.mrk.json`; or a folder of DICOM slices, each with a drawing
    structure: its name or number in a source that holds several
    colour: the pen's, on drawn slices
    Raises InputError: a source that is none of these, damaged, or without such a structure
    """
    from vfplan.surface import curves, dicom, volumes

    first = sources[0]
    if first.is_dir():
        _alone(sources)
        _unstructured(structure, first)
        return curves.read_drawn_slices(first, colour)
    if all(path.name.lower().endswith(".json") for path in sources):
        _unstructured(structure, first)
        return curves.read_slicer_curves(sources)
    _alone(sources)
    name = first.name.lower()
    with opened_file(first) as file:
        head = file.read(HEAD_BYTES)
    with naming_place(first):
        if head.startswith(b"NRRD"):
            return contours_of_volume(volumes.read_nrrd(first), structure)
        if name.endswith((".nii", ".nii.gz")):
            return contours_of_volume(volumes.read_nifti(first), structure)
        if dicom.plainly_dicom(head):
            return dicom.read_dicom_contours(first, structure)
    raise InputError(f"is none of {SUFFIXES}.", where=str(first))


def _alone(sources: list[Path]) -> None:
    if len(sources) > 1:
        raise InputError(
            f"{len(sources)} sources. Several are taken of Slicer's .mrk.json only.",
            where=str(sources[1]),
        )


def _unstructured(structure: str | None, where: Path) -> None:
    if structure is not None:
        raise InputError(
            f"a structure was asked for ({structure!r}), and drawn curves have no names.",
            where=str(where),
        )
