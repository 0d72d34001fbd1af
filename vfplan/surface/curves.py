"""Outlines drawn one a slice: Slicer's closed curves, and DICOM slices with a pen's drawing."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, ImageError, InputError, MarkerError
from vfplan.io.files import read_whole
from vfplan.surface.contours import Contours, Structure

Array = NDArray[np.float64]
MAX_MARKUPS_BYTES = 1 << 26
"""Largest file of curves [bytes]; a curve of a thousand points takes 200 kB."""
MAX_SLICES = 4096
"""Largest number of files in a folder of slices; a scan has some hundreds."""


def read_slicer_curves(paths: list[Path]) -> Contours:
    """Every ClosedCurve of one or more `.mrk.json` files.

    Raises `InputError` where a file holds none, an open curve, or is damaged.
    """
    from vfplan.markers.slicer import lps_points, markups_of
    from vfplan.vectors.read import FINE_M, VectorCurve

    rings, digest = [], hashlib.sha256()
    for path in paths:
        where = str(path)
        data = read_whole(path, MAX_MARKUPS_BYTES, InputError)
        digest.update(hashlib.sha256(data).digest())
        try:
            markups = markups_of(data.decode("utf-8-sig"), where)
            kinds = [markup.get("type") for markup in markups]
            if set(kinds) != {"ClosedCurve"}:
                other = "nothing"
                for kind in kinds:
                    if kind != "ClosedCurve":
                        other = kind
                        break
                raise InputError(f"holds {other!r}. Give closed curves.", where=where)
            points = [lps_points(markup, where) for markup in markups]
        except UnicodeDecodeError:
            raise InputError(
                "is not UTF-8 text. Save the markups from Slicer as .mrk.json.", where=where
            ) from None
        except MarkerError as error:
            raise InputError(error.message, where=error.where) from None
        for ring in points:
            if len(ring) < 3:
                raise InputError(f"a curve has {len(ring)} points. Give at least 3.", where=where)
            rings.append(VectorCurve(ring, True, True, "").fine(FINE_M))
    return Contours(tuple(rings), (Structure(1),), 1, {"curves": digest.hexdigest()})


def read_drawn_slices(folder: Path, colour: str) -> Contours:
    """The closed curves drawn on a folder's DICOM slices, each placed by its own slice.

    Slices without a drawing are passed over; they are named by their place in the folder's order,
    for exporters name files by identifiers.

    Raises InputError: a file that is no DICOM slice, has no place in the patient, or a drawing that
        is not closed
    """
    from vfplan.curve import load_libraries
    from vfplan.images.read import read_image
    from vfplan.planning import ExtractSettings, extract

    load_libraries()
    files = []
    for path in sorted(folder.iterdir()):
        if path.is_file():
            files.append(path)
    if not 2 <= len(files) <= MAX_SLICES:
        raise InputError(
            f"holds {len(files)} files; 2 to {MAX_SLICES} slices are wanted.", where=str(folder)
        )
    rings, digest = [], hashlib.sha256()
    slices_without_drawing = 0
    for number, path in enumerate(files, start=1):
        where = f"{folder}, file {number} of {len(files)} by name"
        try:
            rgb = read_image(path).rgb
            red, green, blue = rgb[..., 0], rgb[..., 1], rgb[..., 2]
            if np.array_equal(red, green) and np.array_equal(red, blue):
                slices_without_drawing += 1
                continue
            extracted = extract(path, ExtractSettings(colour=colour, stroke="all"))
        except InputError as error:
            raise type(error)(error.message, where=where) from None
        place = extracted.image.T_patient_image
        if place is None:
            raise ImageError(
                "does not say where it lies in the patient. Give DICOM slices.", where=where
            )
        digest.update(bytes.fromhex(extracted.image.sha256))
        for stroke in extracted.extraction.strokes:
            if not stroke.closed:
                raise CurveError(
                    f"a drawing of {stroke.length_px:.0f} px is open. Close the outline.",
                    where=where,
                )
            pixels = np.c_[stroke.points_px, np.ones(len(stroke.points_px))]
            rings.append((pixels @ place.T)[:, :3])
    if not rings:
        raise CurveError(
            f"none of {len(files)} slices shows a drawing. Name the pen's colour with --colour.",
            where=str(folder),
        )
    remarks = ()
    if slices_without_drawing:
        remarks = (f"{slices_without_drawing} of {len(files)} slices show no drawing",)
    inputs = {"slices": digest.hexdigest()}
    return Contours(tuple(rings), (Structure(1),), 1, inputs, remarks=remarks)
