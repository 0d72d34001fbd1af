"""The lines of a DICOM presentation state, as points on the image that it was drawn on.

Graphics (GSPS, PS3.3 C.10.5) count pixels from the upper left corner of the first one, so half a
pixel is subtracted here.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from vfplan.dicom.dataset import memory_file, open_dataset
from vfplan.errors import CurveError, ImageError
from vfplan.geometry import CORNER_PX
from vfplan.io.sandbox import raise_limits, run_in_sandbox

IS_SMOOTH = {"POLYLINE": False, "INTERPOLATED": True}
"""The types of graphic that are lines, and whether each is curved between its points."""


@dataclass(frozen=True, eq=False)
class Annotation:
    """One graphic that was drawn on an image.

    name: what it is, for messages
    drawn_on: the images' SOP instance UIDs, each with its frames, from 1; empty where all are meant
    points: a line's (M, 2) points (u, v) [px]; `None` for a graphic that is no line
    smooth: whether a line is curved between its points
    """

    name: str
    drawn_on: dict[str, list[int]]
    points: NDArray[np.float64] | None = None
    smooth: bool = False


def read_annotations(data: bytes, where: str) -> list[Annotation]:
    """The lines of a DICOM presentation state, then its graphics that are no lines.

    Raises `CurveError` where there is no line, `ImageError` for a damaged file, `MissingExtra`.
    """
    annotations = []
    with memory_file(data) as file:
        answers = run_in_sandbox(
            "vfplan.dicom.graphics:read_graphics",
            where,
            file=file,
            where=where,
            kind=CurveError,
        )
        for head in answers:
            points = next(answers)[0] - CORNER_PX if head.pop("is_line") else None
            annotations.append(Annotation(points=points, **head))
    return annotations


def read_graphics(file: BinaryIO, where: str) -> Iterator[dict[str, Any] | tuple[NDArray]]:
    """What `read_annotations` returns, in the child process: a head each, then a line's points."""
    raise_limits(2 * file.seek(0, os.SEEK_END), 0)
    file.seek(0)
    lines = []
    others = []
    with open_dataset(file, where, ImageError) as dataset:
        # Where an annotation names no images, those of the whole presentation state are meant.
        images_of_series: dict[str, list[int]] = {}
        for series in dataset.get("ReferencedSeriesSequence") or ():
            images_of_series |= referenced_images(series)
        for item in dataset.get("GraphicAnnotationSequence") or ():
            drawn_on = referenced_images(item) or images_of_series
            layer = str(item.get("GraphicLayer", ""))[:32]
            for graphic in item.get("GraphicObjectSequence") or ():
                kind = str(graphic.get("GraphicType", ""))[:16]
                units = str(graphic.get("GraphicAnnotationUnits", ""))[:16]
                count = graphic.get("NumberOfGraphicPoints", 0)
                name = f"{kind} of {count} points, layer {layer!r}"
                if kind not in IS_SMOOTH or units != "PIXEL":
                    others.append(f"{name}, in {units} units")
                    continue
                coordinates = np.array(graphic.GraphicData, np.float64)
                if len(coordinates) != 2 * int(graphic.get("NumberOfGraphicPoints", -1)):
                    raise CurveError(
                        f"{name} has {len(coordinates)} coordinates, and two a point are wanted. "
                        "Export the presentation state again.",
                        where=where,
                        code="vector-unreadable",
                    )
                head = {
                    "is_line": True,
                    "name": name,
                    "drawn_on": drawn_on,
                    "smooth": IS_SMOOTH[kind],
                }
                lines.append((head, coordinates.reshape(-1, 2)))
        modality = str(dataset.get("Modality", ""))[:16]
    if not lines:
        content = "; ".join(others[:6]) or f"no drawing ({modality})"
        raise CurveError(
            f"is DICOM with {content}. Draw a POLYLINE or INTERPOLATED graphic in PIXEL units.",
            where=where,
        )
    for head, points in lines:
        yield head
        yield (points,)
    for name in others:
        yield {"is_line": False, "name": name, "drawn_on": {}}


def referenced_images(item: Any) -> dict[str, list[int]]:
    """The images that an item refers to, each with its frames; without frames all are meant."""
    images = {}
    for image in item.get("ReferencedImageSequence") or ():
        frames = image.get("ReferencedFrameNumber") or []
        if not hasattr(frames, "__iter__"):
            frames = [frames]
        images[str(image.ReferencedSOPInstanceUID)] = [int(frame) for frame in frames]
    return images
