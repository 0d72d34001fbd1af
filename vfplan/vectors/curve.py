"""A curve of straight lines or a spline, as a drawing program left it.

A DICOM presentation state holds lines as points on the image that they were drawn on. Its graphics
(GSPS, PS3.3 C.10.5) count pixels from the upper left corner of the first one, so half a pixel is
subtracted here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from vfplan.display import count
from vfplan.engine.parameters import MAX_POINTS
from vfplan.errors import CurveError, ImageError
from vfplan.fixture import Stroke
from vfplan.geometry import CORNER_PX, ROUNDING
from vfplan.geometry.lines import (
    Array,
    arc_lengths,
    evenly,
    interpolated,
    on_segments,
    ring_of,
    row_lengths,
    step_lengths,
)
from vfplan.images.dicom import memory_file, open_dataset
from vfplan.images.read import PlannedImage
from vfplan.io.files import MAX_NUMBER
from vfplan.io.sandbox import raise_limits_for, run_in_sandbox

# Distance [m] between the points of a curve in the patient. It is half a pixel of a fine scan.
FINE_M = 2.5e-4
# How a file says that its points are joined: by straight lines; by a spline that no one names; or
# by the one of 3D Slicer, VTK's cardinal spline over the number of the point, whose ends rest.
Joined = Literal["straight", "spline", "slicer"]
# Places between two points by which the length of a spline is estimated.
PLACES_A_PIECE = 16


# DICOM images, each with its frames; of one without frames all are meant.
Images = dict[str, list[int]]


@dataclass(frozen=True, eq=False)
class VectorDrawing:
    """A curve as a drawing program left it.

    Parameters
    ----------
    points
        (M, 2) control points or vertices (u, v) [px], or (M, 3) in the patient's LPS frame [m].
    closed
        Whether the last point joins the first.
    joined
        What runs through the points.
    sha256
        SHA-256 of the file's bytes, lower-case hex.
    warnings
        What the file leaves open, and how it was taken.
    drawn_on
        The DICOM images that it says it was drawn on, each with its frames; none where it does
        not say.
    type_difference_m
        How far Slicer's two types of curve differ [m], where neither was chosen.
    measured_from
        Where on the first pixel a calibrated program counts from; (M, 2) points are then in mm.
    """

    points: Array
    closed: bool
    joined: Joined
    sha256: str = ""
    warnings: tuple[str, ...] = ()
    drawn_on: Images = field(default_factory=dict)
    type_difference_m: float = 0.0
    measured_from: str | None = None

    def stroke(self, step: float) -> Stroke:
        """The curve as a stroke whose points are `step` apart in arc length, ends included.

        Raises `CurveError` where these are more than a bundle holds.
        """
        # A spline is longer than its chords.
        rough = self.at(self._parameters(PLACES_A_PIECE))
        lengths = step_lengths(rough).reshape(-1, PLACES_A_PIECE).sum(1)
        steps = lengths.sum() / step
        if not steps < MAX_POINTS:
            raise CurveError(
                f"is a curve of {steps:.3g} points, and at most {MAX_POINTS} fit into a "
                "bundle. Give a shorter one",
                code="vector-too-long", numbers={"points": float(steps), "points_max": MAX_POINTS},
            )  # fmt: skip
        line = self.at(self._parameters(np.ceil(8 * lengths / step) + PLACES_A_PIECE))
        even = evenly(line, False, step)
        return Stroke(even[:-1] if self.closed else even, self.closed)

    def distance_from_straight(self) -> float:
        """The largest distance of the spline from straight lines between its points; their unit."""
        ring = ring_of(self.points, self.closed)
        curve = self.at(self._parameters(PLACES_A_PIECE)).reshape(-1, ring.shape[1])[:-1]
        ends = (np.repeat(side, PLACES_A_PIECE, axis=0) for side in (ring[:-1], ring[1:]))
        return float(row_lengths(curve - on_segments(curve, *ends)).max())

    def at(self, parameters: NDArray) -> Array:
        """(K, 2|3) points at float numbers of the curve's points."""
        ring = ring_of(self.points, self.closed)
        numbers = np.arange(len(ring))
        if self.joined == "straight" or len(ring) < 3:
            return interpolated(parameters, numbers, ring)
        from scipy.interpolate import CubicSpline

        ends = "periodic" if self.closed else "clamped"
        if self.joined == "slicer":
            return CubicSpline(numbers, ring, bc_type=ends)(parameters)
        chords = arc_lengths(self.points, self.closed)
        spline = CubicSpline(chords, ring, bc_type="periodic" if self.closed else "natural")
        return spline(np.interp(parameters, numbers, chords))

    def _parameters(self, counts: Any) -> Array:
        """Float numbers of points that cut each piece into so many parts, ends included."""
        pieces = len(self.points) - (not self.closed)
        ends = np.append(0, np.cumsum(np.broadcast_to(counts, pieces)))
        return np.interp(np.arange(ends[-1] + 1), ends, np.arange(pieces + 1))


def without_repeated_end(points: NDArray) -> tuple[NDArray, bool]:
    """The points without the last where it repeats the first, and whether it does."""
    if len(points) > 3 and np.array_equal(points[0], points[-1]):
        return points[:-1], True
    return points, False


def distinct_points(points: NDArray, closed: bool) -> NDArray:
    """The points without repetitions; raises `CurveError` where too few or none real are left."""
    if not np.isfinite(points).all():
        raise CurveError(
            "holds a point that is not finite. Correct the file", code="point-not-finite"
        )
    largest = float(np.abs(points).max(initial=0.0))
    if largest > MAX_NUMBER:
        raise CurveError(
            f"holds a coordinate of {largest:g}. Give at most {MAX_NUMBER:g}",
            code="coordinate-too-large",
            numbers={"coordinate": largest, "coordinate_max": MAX_NUMBER},
        )
    if len(points):
        chords = arc_lengths(points, False)
        same = ROUNDING * chords[-1]
        points = points[np.r_[True, np.diff(chords) > same]]
        if closed and np.linalg.norm(points[-1] - points[0]) <= same:
            points = points[:-1]
    wanted = 3 if closed else 2
    if len(points) < wanted:
        raise CurveError(
            f"holds {len(points)} different points. Give at least {wanted}",
            code="too-few-points", numbers={"points": len(points), "points_min": wanted},
        )  # fmt: skip
    return points


def read_presentation_curve(data: bytes, number: int | None, where: str) -> VectorDrawing:
    """The one line of a DICOM presentation state, or number `number` from 1.

    Raises `CurveError` where there is no such line, or several and none was chosen.
    """
    with memory_file(data) as file:
        job = "vfplan.vectors.curve:read_line"
        drawn, (points,) = run_in_sandbox(
            job, where, number, file=file, where=where, kind=CurveError
        )
    points, closed = without_repeated_end(points)
    curve = VectorDrawing(
        distinct_points(points, closed), closed, drawn["joined"],
        warnings=tuple(drawn["warnings"]), drawn_on=drawn["drawn_on"],
    )  # fmt: skip
    if curve.joined == "straight":
        return curve
    warning = (
        f"{where}: DICOM leaves open how points are joined. A spline was laid through them, "
        f"up to {curve.distance_from_straight():.2g} px from straight lines. Compare it with the "
        "drawing"
    )
    return replace(curve, warnings=(*curve.warnings, warning))


def read_line(file: BinaryIO, where: str, number: int | None) -> Iterator[Any]:
    """The chosen line, in the child process: how it was drawn, then its points [px or m]."""
    raise_limits_for(file)
    lines, others = [], []
    with open_dataset(file, ImageError) as dataset:
        everything = (*graphics(dataset), *report_curves(dataset), *contours(dataset))
        for kind, name, drawn_on, values, width in everything:
            if kind in OPEN or kind in CLOSED:
                points = np.array(values, float).reshape(-1, width)
                lines.append((kind, name, drawn_on, points))
            else:
                others.append(name)
        modality = str(dataset.get("Modality", ""))[:16]
    if not lines:
        content = "; ".join(others[:6]) or f"no drawing ({modality})"
        raise CurveError(
            f"is DICOM with {content}. Give a presentation state, a report or an RTSTRUCT with a "
            "line in it."
        )
    names = [f"{k}: {line[1]}" for k, line in enumerate(lines, start=1)]
    not_read = "".join(f"; not read: {name}" for name in others[:8])
    listed = "; ".join(names[:8]) + not_read
    numbers = {"curves": len(lines), "number": number}
    curves = count(len(lines), "curve")
    is_alone = len(lines) + len(others) == 1
    if number is None and not is_alone:
        raise CurveError(
            f"holds {curves} and none was chosen. Choose one with --stroke N: {listed}",
            code="vector-several", numbers=numbers,
        )  # fmt: skip
    if number is not None and number > len(lines):
        raise CurveError(
            f"holds no curve number {number}. Choose one of these: {listed}",
            code="vector-number", numbers=numbers,
        )  # fmt: skip
    chosen = (number or 1) - 1
    kind, _, drawn_on, points = lines[chosen]
    warnings = []
    if not is_alone:
        warnings = [
            f"{where}: of {curves} {names[chosen]} is taken{not_read}. Choose another with "
            "--stroke N where it is the wrong one"
        ]
    if kind in CLOSED:
        points = np.vstack([points, points[:1]])
    joined = "spline" if kind == "INTERPOLATED" else "straight"
    yield {"joined": joined, "drawn_on": drawn_on, "warnings": warnings}
    yield (points - CORNER_PX if points.shape[1] == 2 else 1e-3 * points,)


# Lines of presentation states and reports, and contours of structures, that are open or closed.
OPEN = ("POLYLINE", "INTERPOLATED", "OPEN_PLANAR", "OPEN_NONPLANAR")
CLOSED = ("POLYGON", "CLOSED_PLANAR", "CLOSEDPLANAR_XOR")
# A kind, a name, the images that it is drawn on, coordinates [px or mm], and how many a point has.
Drawn = tuple[str, str, Images, Any, int]


def graphics(dataset: Any) -> Iterator[Drawn]:
    """The graphics of a presentation state; one that is no line in pixels is of no kind."""
    # Where an annotation names no images, those of the whole presentation state are meant.
    images_of_series: Images = {}
    for series in dataset.get("ReferencedSeriesSequence") or ():
        images_of_series |= referenced_images(series)
    for item in dataset.get("GraphicAnnotationSequence") or ():
        drawn_on = referenced_images(item) or images_of_series
        layer = str(item.get("GraphicLayer", ""))[:32]
        for graphic in item.get("GraphicObjectSequence") or ():
            kind = str(graphic.get("GraphicType", ""))[:16]
            units = str(graphic.get("GraphicAnnotationUnits", ""))[:16]
            count = int(graphic.get("NumberOfGraphicPoints") or 0)
            name = f"{kind} of {count} points, layer {layer!r}"
            if kind not in ("POLYLINE", "INTERPOLATED") or units != "PIXEL":
                yield "", f"{name}, in {units} units", drawn_on, (), 2
                continue
            values = graphic.GraphicData
            if len(values) != 2 * count:
                raise CurveError(
                    f"{name} has {len(values)} coordinates, and two a point are wanted. "
                    "Export the presentation state again.",
                    code="vector-unreadable",
                )
            yield kind, name, drawn_on, values, 2


def report_curves(item: Any) -> Iterator[Drawn]:
    """What a structured report (TID 1500, as OHIF saves it) marks on images or in space."""
    for part in item.get("ContentSequence") or ():
        width = {"SCOORD": 2, "SCOORD3D": 3}.get(str(part.get("ValueType", "")))
        if width is not None:
            drawn_on: Images = {}
            for source in part.get("ContentSequence") or ():
                drawn_on |= referenced_images(source, "ReferencedSOPSequence")
            kind, values = str(part.GraphicType)[:16], part.GraphicData
            name = f"{kind} of {len(values) // width} points, in the report"
            yield kind, name, drawn_on, values, width
        yield from report_curves(part)


def contours(dataset: Any) -> Iterator[Drawn]:
    """The contours of an RTSTRUCT."""
    for roi in dataset.get("ROIContourSequence") or ():
        for contour in roi.get("ContourSequence") or ():
            kind, values = str(contour.ContourGeometricType)[:16], contour.ContourData
            name = f"{kind} of {len(values) // 3} points, structure {roi.ReferencedROINumber}"
            yield kind, name, referenced_images(contour, "ContourImageSequence"), values, 3


def referenced_images(item: Any, sequence: str = "ReferencedImageSequence") -> Images:
    """The images that an item refers to, each with its frames; without frames all are meant."""
    images = {}
    for image in item.get(sequence) or ():
        frames = np.ravel(image.get("ReferencedFrameNumber") or []).astype(int)
        images[str(image.ReferencedSOPInstanceUID)] = frames.tolist()
    return images


def check_drawn_on(
    drawn_on: Images, image: PlannedImage, frame: int | None, where: str
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
            where=where, code="drawn-on-another-image", numbers={"images": len(drawn_on)},
        )  # fmt: skip
    frames = drawn_on[image.instance]
    if frames and (frame or 1) not in frames:
        raise CurveError(
            f"is drawn on frame {frames[0]}, not {frame or 1}. Give --frame {frames[0]}",
            where=where, code="drawn-on-another-frame",
            numbers={"frame": frame or 1, "drawn_on_frame": frames[0]},
        )  # fmt: skip
    return ()
