"""A line of a DICOM presentation state, and the image that it was drawn on."""

from __future__ import annotations

from vfplan.errors import CurveError
from vfplan.images.annotations import Annotation, read_annotations
from vfplan.images.read import PlannedImage


def read_presentation(
    data: bytes, number: int | None, where: str
) -> tuple[Annotation, tuple[str, ...]]:
    """The one line of a DICOM presentation state, or number `number` from 1, and warnings.

    Raises `CurveError` where there is no such line, or several and none was chosen.
    """
    annotations = read_annotations(data, where)
    lines = [each for each in annotations if each.points is not None]
    names = [f"{k}: {line.name}" for k, line in enumerate(lines, 1)]
    not_read = "".join(f"; not read: {each.name}" for each in annotations[len(lines) :][:8])
    listed = "; ".join(names[:8]) + not_read
    numbers = {"curves": len(lines), "number": number}
    if len(lines) == 1:
        count = "1 curve"
    else:
        count = f"{len(lines)} curves"
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
    return lines[chosen], (f"{where}: of {count} {names[chosen]} is taken{not_read}",)


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
