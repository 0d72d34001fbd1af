"""Outlines drawn one a slice: Slicer's closed curves, and DICOM slices with a pen's drawing."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError, ImageError, InputError, MarkerError
from vfplan.io.files import MAX_TEXT_BYTES, read_whole
from vfplan.surface.outline import Contours, Structure

Array = NDArray[np.float64]


def read_slicer_curves(paths: list[Path]) -> Contours:
    """Every ClosedCurve of one or more `.mrk.json` files.

    Raises `InputError` where a file holds none, an open curve, or is damaged.
    """
    from vfplan.markers.slicer import lps_points, markups_of
    from vfplan.vectors.read import FINE_M, VectorDrawing

    rings = []
    digest = hashlib.sha256()
    for path in paths:
        where = str(path)
        data = read_whole(path, MAX_TEXT_BYTES, InputError)
        digest.update(hashlib.sha256(data).digest())
        try:
            markups = markups_of(data.decode("utf-8-sig"), where)
            types = {str(markup.get("type")) for markup in markups}
            if types != {"ClosedCurve"}:
                types.discard("ClosedCurve")
                content = repr(min(types)[:32]) if types else "nothing"
                raise InputError(
                    f"holds {content}. Give closed curves.", where=where, code="curve-not-closed"
                )
            curves = [lps_points(markup, where) for markup in markups]
        except UnicodeDecodeError:
            raise InputError(
                "is not UTF-8 text. Save the markups from Slicer as .mrk.json.", where=where
            ) from None
        except MarkerError as error:
            raise InputError(
                error.message, where=error.where, code=error.code, numbers=error.numbers
            ) from None
        for points in curves:
            if len(points) < 3:
                raise InputError(
                    f"a curve has {len(points)} points. Give at least 3.",
                    where=where,
                    code="outline-empty",
                )
            rings.append(VectorDrawing(points, True, True, "").stroke(FINE_M).points)
    return Contours(tuple(rings), (Structure(1),), 1, {"curves": digest.hexdigest()})


def read_drawn_slices(folder: Path, colour: str) -> Contours:
    """The closed curves drawn on a folder's DICOM slices, each placed by its own slice.

    Slices without a drawing are passed over; they are named by their place in the folder's order,
    for exporters name files by identifiers.

    Raises `InputError` for a file that is no DICOM slice or has no place in the patient, and for a
    drawing that is not closed.
    """
    from vfplan.curve.extraction import load_libraries
    from vfplan.images.raster import MAX_TIFF_PARTS
    from vfplan.images.read import read_image
    from vfplan.planning.extraction import extract
    from vfplan.planning.settings import ExtractSettings

    load_libraries()
    files = [path for path in sorted(folder.iterdir()) if path.is_file()]
    if not 2 <= len(files) <= MAX_TIFF_PARTS:
        raise InputError(
            f"holds {len(files)} files. Give 2 to {MAX_TIFF_PARTS} slices.",
            where=str(folder),
            code="slices-too-few",
            numbers={"slices": len(files), "slices_min": 2, "slices_max": MAX_TIFF_PARTS},
        )
    rings = []
    digest = hashlib.sha256()
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
            raise type(error)(
                error.message, where=where, code=error.code, numbers=error.numbers
            ) from None
        place = extracted.image.T_patient_image
        if place is None:
            raise ImageError(
                "does not say where it lies in the patient. Give DICOM slices.",
                where=where,
                code="slice-without-place",
            )
        digest.update(bytes.fromhex(extracted.image.sha256))
        for stroke in extracted.extraction.strokes:
            if not stroke.closed:
                raise CurveError(
                    f"a drawing of {stroke.length:.0f} px is open. Close the outline.",
                    where=where,
                    code="outline-open",
                    numbers={"length_px": stroke.length},
                )
            pixels = np.c_[stroke.points_px, np.ones(len(stroke.points_px))]
            rings.append((pixels @ place.T)[:, :3])
    if not rings:
        raise CurveError(
            f"none of {len(files)} slices shows a drawing. Name the pen's colour with --colour.",
            where=str(folder),
            code="structure-empty",
            numbers={"slices": len(files)},
        )
    remarks = ()
    if slices_without_drawing:
        remarks = (
            f"{slices_without_drawing} of {len(files)} slices show no drawing. Check that none was "
            "forgotten.",
        )
    inputs = {"slices": digest.hexdigest()}
    return Contours(tuple(rings), (Structure(1),), 1, inputs, remarks=remarks)
