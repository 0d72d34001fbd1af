"""A line of a DICOM presentation state, and the image that it was drawn on."""

from __future__ import annotations

from dataclasses import replace

from vfplan.dicom.graphics import Annotation, read_annotations
from vfplan.errors import CurveError
from vfplan.images.read import PlannedImage
from vfplan.vectors.curve import VectorDrawing, distinct_points, without_repeated_end


def read_presentation(
    data: bytes, number: int | None, where: str
) -> tuple[Annotation, tuple[str, ...]]:
    """The one line of a DICOM presentation state, or number `number` from 1, and warnings.

    Raises `CurveError` where there is no such line, or several and none was chosen.
    """
    annotations = read_annotations(data, where)
    lines = []
    names = []
    not_read = ""
    for annotation in annotations:
        if annotation.points is not None:
            lines.append(annotation)
            names.append(f"{len(lines)}: {annotation.name}")
    for annotation in annotations[len(lines) :][:8]:
        not_read += f"; not read: {annotation.name}"
    listed = "; ".join(names[:8]) + not_read
    numbers = {"curves": len(lines), "number": number}
    count = "1 curve" if len(lines) == 1 else f"{len(lines)} curves"
    if number is None and len(annotations) > 1:
        raise CurveError(
            f"holds {count} and none was chosen. Choose one with --stroke N: {listed}",
            where=where,
            code="vector-several",
            numbers=numbers,
        )
    if number is not None and number > len(lines):
        raise CurveError(
            f"holds no curve number {number}. Choose one of these: {listed}",
            where=where,
            code="vector-number",
            numbers=numbers,
        )
    if len(annotations) == 1:
        return lines[0], ()
    chosen = (number or 1) - 1
    warning = (
        f"{where}: of {count} {names[chosen]} is taken{not_read}. Choose another with --stroke N "
        "where it is the wrong one"
    )
    return lines[chosen], (warning,)


def read_presentation_curve(data: bytes, number: int | None, where: str) -> VectorDrawing:
    """A line of a DICOM presentation state."""
    drawn, warnings = read_presentation(data, number, where)
    points, closed = without_repeated_end(drawn.points)
    points = distinct_points(points, closed, where)
    curve = VectorDrawing(points, closed, drawn.smooth, "", warnings, drawn.drawn_on)
    if not curve.smooth:
        return curve
    warning = (
        f"{where}: DICOM leaves open how points are joined. A spline was laid through them, "
        f"up to {curve.distance_from_straight():.2g} px from straight lines. Compare it with the "
        "drawing"
    )
    return replace(curve, warnings=(*warnings, warning))


def check_drawn_on(
    drawn_on: dict[str, list[int]], image: PlannedImage, frame: int | None, where: str
) -> tuple[str, ...]:
    """A warning where it cannot be told whether a curve was drawn on an image.

    Raises `CurveError` where it was drawn on others.
    """
    if not drawn_on:
        return ()
    if not image.instance:
        warning = (
            f"{where}: names the DICOM image that it is drawn on, and this image has no such name. "
            "Check that it is the same"
        )
        return (warning,)
    if image.instance not in drawn_on:
        raise CurveError(
            f"is drawn on {len(drawn_on)} other image(s), the first "
            f"{next(iter(drawn_on))[:64]}, and this one is {image.instance[:64]}. Give the "
            "image that it is drawn on",
            where=where,
            code="drawn-on-another-image",
            numbers={"images": len(drawn_on)},
        )
    frames = drawn_on[image.instance]
    if frames and (frame or 1) not in frames:
        raise CurveError(
            f"is drawn on frame {frames[0]}, not {frame or 1}. Give --frame {frames[0]}",
            where=where,
            code="drawn-on-another-frame",
            numbers={"frame": frame or 1, "drawn_on_frame": frames[0]},
        )
    return ()
