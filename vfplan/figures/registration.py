"""A picture of a registration: residuals on the slice, and the predicted error along the curve."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vfplan.errors import SettingError
from vfplan.figures.style import DPI, nice_below, on_slice
from vfplan.palette import CONTACT, FORCE, HIP

if TYPE_CHECKING:
    from vfplan.fixture import Fixture
    from vfplan.images.read import PlannedImage
    from vfplan.registration import Registration

Array = NDArray[np.float64]

WIDTH_PX = 900.0
"""Width of the slice [px of the picture]."""

STRIP_IN = 0.9
"""Height [in] of the strip under the slice, with scale bars and legend."""

BAR_IN = 1.1
"""Width [in] of the strip on the right of the slice, with the bar of colours."""

MAX_DRAWN = 2000
"""Points of the band that are drawn at most."""


def draw_registration(
    registration: Registration,
    curve: Fixture,
    path: Path,
    *,
    image: PlannedImage | None = None,
) -> None:
    """Write the slice with each marker's residual as an arrow and the error band along the curve.

    The arrows and the band are drawn larger than life; the picture states by how much, and a bar
    beside it shows the length of one residual unit. The arrow goes from where the transform puts
    the marker (seen in the image) to where it was measured; beside each marker stands the
    whole residual, and its part across the slice's plane, which cannot be drawn there.

    Raises `SettingError` for a registration in 3-D, which has no slice to draw on.
    """
    if registration.source.shape[1] != 2:
        raise SettingError(
            "A registration of the patient's frame has no slice to draw on. Leave the picture out.",
            code="no-slice",
        )
    width, height = _size(registration, curve, image)
    arrows = _exaggeration(_in_plane_px(registration), 0.07 * width)
    inch = WIDTH_PX / width / DPI
    legend = {"loc": "lower left", "columnspacing": 1.2}
    with on_slice(path, (width, height), inch, STRIP_IN, BAR_IN, **legend) as (figure, axes):
        if image is not None:
            grey = image.rgb.astype(np.float32).mean(axis=2) / np.iinfo(image.rgb.dtype).max
            axes.imshow(0.35 + 0.6 * grey, cmap="gray", vmin=0, vmax=1, interpolation="bilinear")
        _draw_band(axes, figure, registration, curve, width)
        _draw_markers(axes, registration, arrows)
        _draw_scale(axes, registration, width, height, arrows)


def _size(
    registration: Registration, curve: Fixture, image: PlannedImage | None
) -> tuple[float, float]:
    """Width and height of the picture [px of the slice]."""
    size = image
    if size is None:
        size = curve.image
    if size is not None:
        return float(size.width_px), float(size.height_px)
    reach = np.vstack([registration.source, curve.points[:, :2]]).max(axis=0)
    return float(reach[0] * 1.1), float(reach[1] * 1.1)


def _in_plane_px(registration: Registration) -> Array:
    """(N, 2) residuals carried back into the image [px]."""
    linear = registration.T_target_source[:3, :2]
    return registration.residual_vectors_m @ np.linalg.pinv(linear).T


def _exaggeration(lengths_px: Array, wanted_px: float) -> float:
    """A round factor (1, 2, 5, 10, ...) that makes the longest about as long as wanted."""
    longest = 0.0
    if lengths_px.size:
        longest = float(np.linalg.norm(lengths_px, axis=-1).max())
    if not longest > 0:
        return 1.0
    return nice_below(max(wanted_px / longest, 1.0))


def _draw_band(
    axes: Any, figure: Any, registration: Registration, curve: Fixture, width: float
) -> None:
    """The predicted RMS TRE as colour, and the 95 % band for the whole curve as width."""
    from matplotlib.collections import LineCollection, PolyCollection

    start, end = _segments(curve)
    points = curve.points[:, :2]
    tre_mm = registration.tre_m(points) * 1e3
    half_px = registration.tre95_curve_m(points) / registration.geometry.scale
    factor = _exaggeration(half_px[:, None], 0.02 * width)
    a, b = points[start], points[end]
    across = np.column_stack([-(b - a)[:, 1], (b - a)[:, 0]])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    out_a = across * half_px[start, None] * factor
    out_b = across * half_px[end, None] * factor
    quads = np.stack([a - out_a, a + out_a, b + out_b, b - out_b], axis=1)
    low, high = tre_mm.min(), max(tre_mm.max(), tre_mm.min() + 1e-9)
    look = {"cmap": "viridis", "clim": (low, high)}
    middle = (tre_mm[start] + tre_mm[end]) / 2
    axes.add_collection(PolyCollection(quads, array=middle, alpha=0.45, lw=0, **look))
    line = LineCollection(np.stack([a, b], axis=1), array=middle, lw=2.0, **look)
    axes.add_collection(line)
    across_in = figure.get_size_inches()[0]
    bar = figure.add_axes((1 - 0.92 / across_in, 0.3, 0.18 / across_in, 0.5))
    figure.colorbar(line, cax=bar).set_label("predicted TRE [mm rms]")
    bar.grid(False)
    axes.plot([], [], lw=6, alpha=0.45, color="#21918c", label=f"95 % band, drawn {factor:g}x")


def _segments(curve: Fixture) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of both ends of the straight pieces to draw; closed strokes are closed."""
    count = len(curve.points)
    stroke, closed = np.zeros(count, int), [False]
    if curve.curve is not None:
        stroke, closed = curve.curve.stroke, curve.curve.closed
    every = max(1, count // MAX_DRAWN)
    ends: list[tuple[int, int]] = []
    for number, is_ring in enumerate(closed):
        members = np.flatnonzero(stroke == number)
        kept = np.unique(np.append(members[::every], members[-1:]))
        ends += itertools.pairwise(kept)
        if is_ring and len(kept) > 1:
            ends.append((kept[-1], kept[0]))
    pairs = np.array(ends, dtype=np.intp).reshape(-1, 2)
    lengths = np.linalg.norm(curve.points[pairs[:, 0]] - curve.points[pairs[:, 1]], axis=1)
    return pairs[lengths > 0, 0], pairs[lengths > 0, 1]


def _draw_markers(axes: Any, registration: Registration, factor: float) -> None:
    """A cross for each marker, its residual as an arrow, and both as numbers."""
    predicted = registration.source
    arrows = _in_plane_px(registration) * factor
    used = registration.used
    axes.plot(*predicted[used].T, "+", ms=9, mew=1.4, color=HIP, label="marker")
    if not used.all():
        axes.plot(*predicted[~used].T, "x", ms=9, mew=1.6, color=FORCE, label="left out")
    axes.plot([], [], color=CONTACT, lw=1.4, label=f"residual, drawn {factor:g}x")
    residuals = registration.residual_vectors_m * 1e3
    across = residuals @ registration.geometry.normal
    whole = np.linalg.norm(residuals, axis=1)
    border = 0.7 * axes.get_xlim()[1]
    for k, label in enumerate(registration.labels):
        place = predicted[k]
        text = f"{label}  {whole[k]:.2f} mm ({across[k]:+.2f})"
        width, colour = 1.4, FORCE
        if label in registration.outliers:
            text += "  outlier"
            width, colour = 2.4, CONTACT
        look = {"arrowstyle": "-|>", "color": CONTACT, "lw": width, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", xy=place + arrows[k], xytext=place, arrowprops=look)
        # On the right the label would leave the slice.
        where = {"xytext": (6, -11), "ha": "left"}
        if place[0] > border:
            where = {"xytext": (-6, -11), "ha": "right"}
        where |= {"textcoords": "offset points", "fontsize": 7}
        where["bbox"] = {"fc": "white", "ec": "none", "alpha": 0.6, "pad": 0.8}
        axes.annotate(text, place, color=colour, **where)


def _draw_scale(
    axes: Any, registration: Registration, width: float, height: float, arrows: float
) -> None:
    """Two bars under the slice: a length in the slice, and a length of the residuals."""
    scale_mm = registration.geometry.scale * 1e3
    for share, drawn, what in ((0.02, 1.0, "in the slice"), (0.36, arrows, "of a residual")):
        length = nice_below(0.15 * width * scale_mm / drawn)
        x, px = share * width, length * drawn / scale_mm
        y = height * (1 + 0.28 * STRIP_IN * DPI / WIDTH_PX * width / height)
        bar = {"color": FORCE, "lw": 2.5, "clip_on": False, "solid_capstyle": "butt"}
        axes.plot([x, x + px], [y, y], **bar)
        words = {"va": "center", "clip_on": False}
        axes.text(x + px + 0.01 * width, y, f"{length:g} mm {what}", fontsize=8, **words)
    note = "beside each marker: its residual\n(its part across the slice)"
    axes.text(0.70 * width, y, note, fontsize=7, **words)
