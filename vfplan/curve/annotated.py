"""A curve drawn on a DICOM image beside its pixels, as `images.annotations` finds it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import CurveError
from vfplan.images.annotations import Annotation, read_annotations
from vfplan.images.read import PlannedImage


def read_annotated(
    data: bytes, number: int | None, where: str
) -> tuple[NDArray[np.float64], Annotation, dict[str, Any], tuple[str, ...]]:
    """The (M, 2) points [px] of the one line drawn in a DICOM file, or of number `number`, from 1.

    With it what was taken, whether it is `closed` where its own pixels say so, and warnings.

    Raises `CurveError` where there is none, or several and none was chosen.
    """
    found = read_annotations(data, where)
    drawn = [each for each in found if each.points is not None or each.plane is not None]
    one, told, stroke = drawn[0], (), number
    others = "".join(f"; not read: {each.name}" for each in found[len(drawn) :][:8])
    if len(found) > 1:
        names = [f"{k}: {each.name}" for k, each in enumerate(drawn, 1)]
        listed = "; ".join(names[:8]) + others
        count = f"{len(drawn)} curve{'s' * (len(drawn) > 1)}"
        if number is None:
            fault = f"{count} and none was chosen (--stroke with a number): {listed}"
            raise CurveError(f"holds {fault}", where=where)
        if number > len(drawn):
            raise CurveError(f"holds no curve number {number}: {listed}", where=where)
        one, stroke = drawn[number - 1], None
        told = (f"{where}: of {count} {names[number - 1]} is taken{others}",)
    if one.plane is None:
        if stroke not in (None, 1):
            raise CurveError(f"holds no curve number {number}: 1: {one.name}", where=where)
        return one.points, one, {}, told
    points, closed, more = _along(one, stroke, where)
    return points, one, {"closed": closed}, (*told, *more)


def _along(
    one: Annotation, stroke: int | None, where: str
) -> tuple[NDArray[np.float64], bool, tuple[str, ...]]:
    """The middle of the line in an overlay plane, found as a red pen's is."""
    from vfplan.curve.extraction import extract_curve

    rgb = np.zeros((*one.plane.shape, 3), np.uint8)
    rgb[one.plane, 0] = 255
    try:
        found = extract_curve(PlannedImage(rgb), stroke=stroke)
    except CurveError as error:
        raise CurveError(f"{one.name}: {error.message}", where=where) from None
    stroke = found.strokes[0]
    warnings = tuple(f"{one.name}: {each}" for each in found.warnings)
    return stroke.points_px + one.origin, stroke.closed, warnings


def check_drawn_on(
    drawn_on: dict[str, list[int]], image: PlannedImage, frame: int | None, where: str
) -> tuple[str, ...]:
    """A warning where it cannot be told whether a curve was drawn on an image.

    Raises `CurveError` where it was drawn on others.
    """
    if not drawn_on:
        return ()
    if not image.instance:
        return (f"{where}: is drawn on a DICOM image; whether it is this one cannot be told",)
    if image.instance not in drawn_on:
        raise CurveError(
            f"is drawn on {len(drawn_on)} other image(s), the first {next(iter(drawn_on))[:64]}; "
            f"this one is {image.instance[:64]}",
            where=where,
        )
    frames = drawn_on[image.instance]
    if frames and (frame or 1) not in frames:
        raise CurveError(f"is drawn on frame {frames[0]}, not {frame or 1}", where=where)
    return ()
