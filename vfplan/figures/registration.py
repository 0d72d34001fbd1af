"""A picture of a registration: residuals on the slice, and the predicted error along the curve."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vfplan.display import MAX_DRAWN, MM, nice_length
from vfplan.errors import SettingError
from vfplan.figures.style import DPI, MARGIN_IN, WIDTH_PX, draw_scale, on_slice, pixels_on
from vfplan.fixture import Curve
from vfplan.geometry.lines import Array, normals, plane_normal, ring_of, row_lengths, unit_normal
from vfplan.images.read import as_uint8
from vfplan.palette import CLOUD, ERROR, FORCE, TUBE

if TYPE_CHECKING:
    from vfplan.fixture import Fixture
    from vfplan.images.read import PlannedImage
    from vfplan.registration.registration import Registration


# Width [in] of the strip on the right of a cloud: the bar of colours, its numbers, its name.
BAR_IN = 2.5 * MARGIN_IN


# Height [pt] of a marker's label, and where one may stand: so many labels below its usual place.
LABEL_PT = 11.0
LINES_LOWER = (0, 1, -2, 2, -3, 3, -4, 4, -5, 5, -6, 6, -7, 7)


def draw_registration(
    registration: Registration, curve: Fixture, path: Path, *, image: PlannedImage | None = None
) -> None:
    """Write the slice with each marker's residual as an arrow and the error band along the curve.

    The arrows and the band are drawn larger than life; the picture states by how much, and a bar
    below it shows the scale of the slice and of the residuals. The arrow goes from where the
    transform puts the marker (seen in the image) to where it was measured; beside each marker
    stands the whole residual, and its part across the slice's plane, which cannot be drawn there.

    Markers in the patient's frame are projected onto the slice.

    Raises `SettingError` for markers in the patient's frame without a slice that says where it lies
    in the patient.
    """
    places, shown = curve.points, image
    if registration.source.shape[1] == 2:
        plane, places = np.eye(2, 3), places[:, :2]
        shown = image or curve.image
    elif image is None or image.T_patient_image is None:
        message = (
            "The markers are given in the patient's frame, and nothing says where a slice lies "
            "there. Give the DICOM slice of the curve by --image, or leave --picture-out out."
        )
        raise SettingError(message, code="no-slice")
    else:
        plane = image.T_patient_image[:3]
        if curve.frame == "image":
            places = places[:, :2] @ plane[:, :2].T + plane[:, 2]
    if shown is None:
        width, height = 1.1 * np.vstack([registration.source, places]).max(axis=0)
    else:
        width, height = shown.width_px, shown.height_px

    # A step of one pixel of the view, in the robot's frame.
    linear = registration.T_target_source[:3, : len(plane)] @ plane[:, :2]
    m_per_px = np.sqrt(np.linalg.norm(plane_normal(linear)))
    residuals_px = registration.vectors @ np.linalg.pinv(linear).T
    factor = exaggeration(residuals_px, 0.07 * width)

    is_cloud = curve.curve is None and len(plane) == 3
    sizes = (width, height), WIDTH_PX / width / DPI, MARGIN_IN, BAR_IN * is_cloud
    with on_slice(path, *sizes, loc="lower left", fontsize="small") as (figure, axes):
        if image is not None:
            axes.imshow(as_uint8(image.rgb), interpolation="bilinear")
        points = pixels_on(plane, places)
        if is_cloud:
            # The points of a surface or a cloud.
            every = max(1, len(points) // MAX_DRAWN)
            tre_mm = registration.tre_m(places[::every]) * MM
            coloured = axes.scatter(*points[::every].T, c=tre_mm, cmap="viridis", s=3, lw=0)
            width_in = figure.get_size_inches()[0]
            bar = figure.add_axes((1 - 0.92 / width_in, 0.3, 0.18 / width_in, 0.5))
            figure.colorbar(coloured, cax=bar, label="predicted TRE [mm rms]")
            bar.grid(False)
        else:
            draw_band(axes, curve, points, registration.tre95_curve_m(places) / m_per_px)
        markers = pixels_on(plane, registration.source)
        draw_markers(axes, registration, markers, linear, residuals_px * factor, factor)
        draw_scale(axes, MM * m_per_px, factor)


def exaggeration(lengths_px: Array, wanted_px: float) -> float:
    """A round factor (1, 2, 5, 10, ...) that makes the longest about as long as wanted."""
    longest = float(np.linalg.norm(lengths_px, axis=-1).max(initial=0.0))
    return nice_length(max(wanted_px / longest, 1.0)) if longest > 0 else 1.0


def draw_band(axes: Any, curve: Fixture, points: Array, half_px: Array) -> None:
    """The curve, and the 95 % band for all of it.

    points: (M, 2) the curve's points on the slice [px]
    half_px: (M,) half the width of the band at each point
    """
    factor = exaggeration(half_px[:, None], 0.02 * axes.get_xlim()[1])
    drawn = curve.curve or Curve(np.zeros(len(points), np.int32), np.array([False]))
    sized = np.column_stack([points, factor * half_px])
    for number, closed in enumerate(drawn.closed):
        ring = ring_of(sized[drawn.stroke == number], closed)
        line = ring[:, :2]
        out = ring[:, 2:] * normals(line, closed=False)
        border = np.vstack([line - out, (line + out)[::-1]])
        axes.fill(*border.T, color=ERROR, alpha=0.45, lw=0)
        axes.plot(*line.T, color=CLOUD, lw=2.0)
    axes.plot([], [], lw=6, alpha=0.45, color=ERROR, label=f"95 % band, drawn {factor:g}x")


def draw_markers(
    axes: Any, registration: Registration, markers: Array, linear: Array, arrows: Array,
    factor: float,
) -> None:  # fmt: skip
    """A cross for each marker, its residual as an arrow, and both as numbers.

    markers: (N, 2) their places on the slice [px]
    linear: (3, 2) a step of one pixel along u and along v, in the robot's frame
    arrows: (N, 2) the residuals [px], `factor` times larger than life
    """
    used = registration.used
    axes.plot(*markers[used].T, "+", ms=9, mew=1.4, color=TUBE, label="marker")
    if not used.all():
        axes.plot(*markers[~used].T, "x", ms=9, mew=1.6, color=FORCE, label="left out")
    label = f"residual (in brackets: across the slice), drawn {factor:g}x"
    axes.plot([], [], color=ERROR, lw=1.4, label=label)
    residuals_mm = registration.vectors * MM
    across_mm = residuals_mm @ unit_normal(linear)
    whole_mm = row_lengths(residuals_mm)
    border = 0.7 * axes.get_xlim()[1]
    taken = []
    for k, label in enumerate(registration.labels):
        place = markers[k]
        text = f"{label}  {whole_mm[k]:.2f} mm ({across_mm[k]:+z.2f})"
        colour, width = FORCE, 1.4
        if label in registration.outliers:
            text, colour, width = f"{text}  outlier", ERROR, 2.4
        look = {"arrowstyle": "-|>", "color": ERROR, "lw": width, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", xy=place + arrows[k], xytext=place, arrowprops=look)
        # On the right the label would leave the slice.
        side, shift = ("right", -6) if place[0] > border else ("left", 6)
        box = {"fc": "white", "ec": "none", "alpha": 0.6, "pad": 0.8}
        where = {"xytext": (shift, -11), "textcoords": "offset points", "ha": side, "bbox": box}
        shown = axes.annotate(text, place, color=colour, fontsize="small", **where)
        for lines in LINES_LOWER:
            shown.xyann = (shift, -11 - LABEL_PT * lines)
            extent = shown.get_window_extent()
            is_inside = axes.bbox.y0 <= extent.y0 and extent.y1 <= axes.bbox.y1
            if is_inside and not extent.count_overlaps(taken):
                break
        taken.append(extent)
        # A label that stands farther off than the first place is led to its marker.
        if lines:
            leader = {"arrowstyle": "-", "color": FORCE, "lw": 0.7}
            axes.annotate("", place, shown.xyann, textcoords="offset points", arrowprops=leader)
