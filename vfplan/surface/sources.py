"""What kind of source files are, and the reader of each."""

from __future__ import annotations

from pathlib import Path

from vfplan.dicom.dataset import begins_like_dicom
from vfplan.errors import InputError
from vfplan.io.files import naming_place, opened_file
from vfplan.surface.contours import Contours
from vfplan.surface.labelmaps import contours_of_volume

HEAD_BYTES = 256
"""Number of bytes by which a file's kind is known. DICOM's mark ends at byte 132."""
SOURCE_TYPES = (
    "RTSTRUCT, DICOM SEG, .seg.nrrd, .nii, .nii.gz, .mrk.json or a folder of drawn slices"
)


def read_contours(
    sources: list[Path], structure: str | None = None, colour: str = "red"
) -> Contours:
    """The outlines of one structure.

    Parameters
    ----------
    sources
        One file; or several `.mrk.json`; or a folder of DICOM slices, each with a drawing.
    structure
        Its name or number in a source that holds several.
    colour
        The pen's, on drawn slices.

    Raises
    ------
    InputError
        A source is none of these, is damaged, or has no such structure.
    """
    from vfplan.surface import curves, dicom, volumes

    first = sources[0]
    where = str(first)
    are_curves = all(path.name.lower().endswith(".json") for path in sources)
    if len(sources) > 1 and not are_curves:
        raise InputError(
            f"is one of {len(sources)} sources. Give one; several are read of .mrk.json alone.",
            where=str(sources[1]),
            code="source-several",
            numbers={"sources": len(sources)},
        )
    if structure is not None and (are_curves or first.is_dir()):
        raise InputError(
            f"holds drawn curves, which have no names. Leave --structure {structure!r} out.",
            where=where,
            code="structure-unknown",
        )
    if first.is_dir():
        return curves.read_drawn_slices(first, colour)
    if are_curves:
        return curves.read_slicer_curves(sources)

    with opened_file(first) as file:
        head = file.read(HEAD_BYTES)
    with naming_place(where):
        if head.startswith(b"NRRD"):
            return contours_of_volume(volumes.read_nrrd(first), structure)
        if first.name.lower().endswith((".nii", ".nii.gz")):
            return contours_of_volume(volumes.read_nifti(first), structure)
        if begins_like_dicom(head):
            return dicom.read_dicom_contours(first, structure)
    raise InputError(
        f"is no source of outlines. Give {SOURCE_TYPES}.", where=where, code="source-unknown"
    )
