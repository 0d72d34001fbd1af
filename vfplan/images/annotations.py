"""The lines of a DICOM presentation state, as points on the image that it was drawn on.

Graphics (GSPS, PS3.3 C.10.5) count pixels from the upper left corner of the first one, so half a
pixel is taken off.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError
from vfplan.images.dicom import dataset_of, in_memory, quiet
from vfplan.io.sandbox import raise_limits, run_in_sandbox

CORNER_PX = 0.5  # from a pixel's corner to its centre
LINES = {"POLYLINE": False, "INTERPOLATED": True}  # and whether it is curved between its points
WANTED = "a POLYLINE or INTERPOLATED graphic in PIXEL units is wanted"


@dataclass(frozen=True, eq=False)
class Annotation:
    """One thing drawn on an image.

    name: what it is, for messages
    drawn_on: the images' SOP instance UIDs, each with its frames, from 1; none where all are meant
    points, smooth: a graphic's (M, 2) points (u, v) [px], and whether it is curved between them

    One without points is a graphic that is no line.
    """

    name: str
    drawn_on: dict[str, list[int]]
    points: NDArray[np.float64] | None = None
    smooth: bool = False


def read_annotations(data: bytes, where: str) -> list[Annotation]:
    """The lines of a DICOM presentation state, then its graphics that are no lines.

    Raises `CurveError` where there is no line, `ImageError` for a damaged file, `MissingExtra`.
    """
    job, drawn = "vfplan.images.annotations:found_in", []
    with in_memory(data) as file:
        found = run_in_sandbox(job, where, file=file, where=where, kind=CurveError)
        for head, values in zip(found, found, strict=True):
            kind = head.pop("kind")
            points = values[0] - CORNER_PX if kind == "line" else None
            drawn.append(Annotation(points=points, **head))
    return drawn


def found_in(file: BinaryIO, where: str) -> Iterator[dict[str, Any] | tuple[NDArray]]:
    """What `read_annotations` returns, each as a head and its array; runs in a process apart."""
    raise_limits(2 * file.seek(0, os.SEEK_END), 0)
    file.seek(0)
    with quiet(where):
        dataset = dataset_of(file, where)
        drawn, others = [], []
        for item in dataset.get("GraphicAnnotationSequence") or ():
            drawn_on = _images(item) or _of_series(dataset)
            for graphic in item.get("GraphicObjectSequence") or ():
                kind, units = (
                    str(graphic.get(name, ""))[:16]
                    for name in ("GraphicType", "GraphicAnnotationUnits")
                )
                name = f"{kind} of {graphic.get('NumberOfGraphicPoints', 0)} points"
                name += f", layer {str(item.get('GraphicLayer', ''))[:32]!r}"
                if kind not in LINES or units != "PIXEL":
                    others.append(f"{name}, in {units} units")
                    continue
                numbers = np.array(graphic.GraphicData, np.float64)
                if len(numbers) != 2 * int(graphic.get("NumberOfGraphicPoints", -1)):
                    raise CurveError(f"{name} has {len(numbers)} coordinates.", where=where)
                points = numbers.reshape(-1, 2)
                head = {"kind": "line", "name": name, "drawn_on": drawn_on, "smooth": LINES[kind]}
                drawn += [head, (points,)]
    if not drawn:
        there = "; ".join(others[:6]) or f"no drawing ({str(dataset.get('Modality', ''))[:16]})"
        raise CurveError(f"is DICOM with {there}. {WANTED}.", where=where)
    yield from drawn
    for name in others:
        yield from ({"kind": "other", "name": name, "drawn_on": {}}, (np.zeros(0),))


def _images(item: Any) -> dict[str, list[int]]:
    """The images that an item refers to, each with its frames."""
    found = {}
    for image in item.get("ReferencedImageSequence") or ():
        frames = image.get("ReferencedFrameNumber") or []
        frames = frames if hasattr(frames, "__iter__") else [frames]
        found[str(image.ReferencedSOPInstanceUID)] = [int(n) for n in frames]
    return found


def _of_series(dataset: Any) -> dict[str, list[int]]:
    found = {}
    for series in dataset.get("ReferencedSeriesSequence") or ():
        found |= _images(series)
    return found
