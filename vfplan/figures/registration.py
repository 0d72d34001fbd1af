"""A picture of a registration: residuals on the slice, and the predicted error along the curve."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.display import MAX_DRAWN, MM, nice_length
from vfplan.errors import SettingError
from vfplan.figures.style import DPI, MARGIN_IN, WIDTH_PX, on_slice
from vfplan.geometry.lines import plane_normal
from vfplan.palette import CONTACT, FORCE, HIP

if TYPE_CHECKING:
    from vfplan.fixture import Fixture
    from vfplan.images.read import PlannedImage
    from vfplan.registration.registration import Registration

Array = NDArray[np.float64]

# Height [in] of the strip under the view: a row of scale bars and one of the legend.
STRIP_IN = 2 * MARGIN_IN

# Width [in] of the strip on the right of the view: the bar of colours, its numbers, its name.
BAR_IN = 2.5 * MARGIN_IN


@dataclass(frozen=True)
class View:
    """The slice that a picture shows, with its pixels u and v in a registration's source.

    width, height: its size [px]
    axes: (k, 2) a step of one pixel along u and along v, in the source
    origin: (k,) the place of the pixel (0, 0), in the source
    """

    width: float
    height: float
    axes: Array
    origin: Array

    def pixels(self, places: Array) -> Array:
        """(M, 2) pixels of places (M, k) in the source, projected onto the slice."""
        return (places - self.origin) @ np.linalg.pinv(self.axes).T


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
    if registration.source.shape[1] == 2:
        places = curve.points[:, :2]
        view = view_of_pixels(registration, curve, image)
    else:
        view = view_in_patient(image)
        places = curve.points
        if curve.frame == "image":
            places = curve.points[:, :2] @ view.axes.T + view.origin

    # A step of one pixel of the view, in the robot's frame.
    linear = registration.T_target_source[:3, : len(view.axes)] @ view.axes
    m_per_px = float(np.exp(np.log(np.linalg.svd(linear, compute_uv=False)).mean()))
    residuals_px = registration.vectors @ np.linalg.pinv(linear).T
    factor = exaggeration(residuals_px, 0.07 * view.width)

    inch = WIDTH_PX / view.width / DPI
    legend = {"loc": "lower left", "columnspacing": 1.2}
    size = (view.width, view.height)
    with on_slice(path, size, inch, STRIP_IN, BAR_IN, **legend) as (figure, axes):
        if image is not None:
            grey = image.rgb.astype(np.float32).mean(axis=2) / np.iinfo(image.rgb.dtype).max
            axes.imshow(0.35 + 0.6 * grey, cmap="gray", vmin=0, vmax=1, interpolation="bilinear")
        if curve.curve is None and registration.source.shape[1] == 3:
            coloured = draw_points(axes, registration, places, view)
        else:
            coloured = draw_band(axes, registration, curve, places, view, m_per_px)
        width_in = figure.get_size_inches()[0]
        bar = figure.add_axes((1 - 0.92 / width_in, 0.3, 0.18 / width_in, 0.5))
        figure.colorbar(coloured, cax=bar).set_label("predicted TRE [mm rms]")
        bar.grid(False)
        draw_markers(axes, registration, view, linear, residuals_px * factor, factor)
        draw_scale(axes, view, MM * m_per_px, factor)


def view_of_pixels(registration: Registration, curve: Fixture, image: PlannedImage | None) -> View:
    """The slice on which the markers were given in pixels."""
    size = curve.image if image is None else image
    if size is not None:
        width, height = float(size.width_px), float(size.height_px)
    else:
        reach = np.vstack([registration.source, curve.points[:, :2]]).max(axis=0)
        width, height = (reach * 1.1).tolist()
    return View(width, height, np.eye(2), np.zeros(2))


def view_in_patient(image: PlannedImage | None) -> View:
    """The slice where it lies in the patient."""
    if image is None or image.T_patient_image is None:
        message = (
            "The markers are given in the patient's frame, and nothing says where a slice lies "
            "there. Give the DICOM slice of the curve by --image, or leave --picture-out out."
        )
        raise SettingError(message, code="no-slice")
    place = image.T_patient_image[:3]
    return View(float(image.width_px), float(image.height_px), place[:, :2], place[:, 2])


def exaggeration(lengths_px: Array, wanted_px: float) -> float:
    """A round factor (1, 2, 5, 10, ...) that makes the longest about as long as wanted."""
    longest = float(np.linalg.norm(lengths_px, axis=-1).max()) if lengths_px.size else 0.0
    if not longest > 0:
        return 1.0
    return nice_length(max(wanted_px / longest, 1.0))


def draw_points(axes: Any, registration: Registration, places: Array, view: View) -> Any:
    """The points of a surface or a cloud, coloured by the predicted RMS TRE."""
    drawn = places[:: max(1, len(places) // MAX_DRAWN)]
    tre_mm = registration.tre_m(drawn) * MM
    return axes.scatter(*view.pixels(drawn).T, c=tre_mm, cmap="viridis", s=3, lw=0)


def draw_band(
    axes: Any, registration: Registration, curve: Fixture, places: Array, view: View,
    m_per_px: float,
) -> Any:  # fmt: skip
    """The predicted RMS TRE as colour, and the 95 % band for the whole curve as width.

    places: (M, k) the curve's points in the registration's source
    """
    from matplotlib.collections import LineCollection, PolyCollection

    points = view.pixels(places)
    start, end = drawn_segments(curve, points)
    tre_mm = registration.tre_m(places) * MM
    half_px = registration.tre95_curve_m(places) / m_per_px
    factor = exaggeration(half_px[:, None], 0.02 * view.width)
    a, b = points[start], points[end]
    across = np.column_stack([-(b - a)[:, 1], (b - a)[:, 0]])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    out_a = across * half_px[start, None] * factor
    out_b = across * half_px[end, None] * factor
    quads = np.stack([a - out_a, a + out_a, b + out_b, b - out_b], axis=1)
    low = tre_mm.min()
    look = {"cmap": "viridis", "clim": (low, max(tre_mm.max(), low + 1e-9))}
    middle = (tre_mm[start] + tre_mm[end]) / 2
    axes.add_collection(PolyCollection(quads, array=middle, alpha=0.45, lw=0, **look))
    line = LineCollection(np.stack([a, b], axis=1), array=middle, lw=2.0, **look)
    axes.add_collection(line)
    axes.plot([], [], lw=6, alpha=0.45, color="#21918c", label=f"95 % band, drawn {factor:g}x")
    return line


def drawn_segments(curve: Fixture, points: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of both ends of the straight pieces to draw; closed strokes are closed.

    points: (M, 2) the curve's points in the view [px]
    """
    count = len(points)
    stroke, closed = np.zeros(count, int), [False]
    if curve.curve is not None:
        stroke, closed = curve.curve.stroke, curve.curve.closed
    every = max(1, count // MAX_DRAWN)
    starts, ends = [], []
    for number, is_closed in enumerate(closed):
        members = np.flatnonzero(stroke == number)
        drawn = [*members[::every], members[-1], *members[: int(is_closed)]]
        starts += drawn[:-1]
        ends += drawn[1:]
    start, end = np.array(starts), np.array(ends)
    has_length = (points[start] != points[end]).any(axis=1)
    return start[has_length], end[has_length]


def draw_markers(
    axes: Any, registration: Registration, view: View, linear: Array, arrows: Array, factor: float
) -> None:
    """A cross for each marker, its residual as an arrow, and both as numbers.

    linear: (3, 2) a step of one pixel along u and along v, in the robot's frame
    arrows: (N, 2) the residuals [px], `factor` times larger than life
    """
    markers = view.pixels(registration.source)
    used = registration.used
    axes.plot(*markers[used].T, "+", ms=9, mew=1.4, color=HIP, label="marker")
    if not used.all():
        axes.plot(*markers[~used].T, "x", ms=9, mew=1.6, color=FORCE, label="left out")
    axes.plot([], [], color=CONTACT, lw=1.4, label=f"residual, drawn {factor:g}x")
    normal = plane_normal(linear)
    normal /= np.linalg.norm(normal)
    residuals_mm = registration.vectors * MM
    across_mm = residuals_mm @ normal
    whole_mm = np.linalg.norm(residuals_mm, axis=1)
    border = 0.7 * axes.get_xlim()[1]
    for k, label in enumerate(registration.labels):
        place = markers[k]
        is_outlier = label in registration.outliers
        word = "  outlier" if is_outlier else ""
        text = f"{label}  {whole_mm[k]:.2f} mm ({across_mm[k]:+.2f}){word}"
        colour, width = (CONTACT, 2.4) if is_outlier else (FORCE, 1.4)
        look = {"arrowstyle": "-|>", "color": CONTACT, "lw": width, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", xy=place + arrows[k], xytext=place, arrowprops=look)
        # On the right the label would leave the slice.
        side, shift = ("right", -6) if place[0] > border else ("left", 6)
        box = {"fc": "white", "ec": "none", "alpha": 0.6, "pad": 0.8}
        where = {"xytext": (shift, -11), "textcoords": "offset points", "ha": side, "bbox": box}
        axes.annotate(text, place, color=colour, fontsize="small", **where)


def draw_scale(axes: Any, view: View, mm_per_px: float, factor: float) -> None:
    """A bar under the view, of a length in its plane, and of residuals drawn larger than life."""
    words = {"va": "center", "clip_on": False, "fontsize": "small"}
    y = view.height + 0.28 * STRIP_IN * DPI / WIDTH_PX * view.width
    length_mm = nice_length(0.15 * view.width * mm_per_px)
    ends = 0.02 * view.width + np.array([0.0, length_mm / mm_per_px])
    axes.plot(ends, [y, y], color=FORCE, lw=2.5, clip_on=False, solid_capstyle="butt")
    text = f"{length_mm:g} mm in the slice, {length_mm / factor:g} mm of a residual"
    axes.text(ends[1] + 0.01 * view.width, y, text, **words)
    note = "beside each marker: its residual\n(its part across the slice)"
    axes.text(0.70 * view.width, y, note, **words)
