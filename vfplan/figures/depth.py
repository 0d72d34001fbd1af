"""How deep the hand went along the planned curve: as a plot, and on the slice it was drawn on."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vfplan.display import MM, nice_length
from vfplan.errors import InputError
from vfplan.figures.style import subplots
from vfplan.fixture import Fixture
from vfplan.images.read import PlannedImage
from vfplan.palette import CLOUD, PROXY
from vfplan.replaying import Replay
from vfplan.replaying.episodes import CurveRuler
from vfplan.replaying.quantities import CONTACT_M

Array = NDArray[np.float64]

MAX_SLIDE = 50
"""Number of planned points that a proxy passes in a tick while it slides. One that passes more has
left the curve in between."""


def depth_along(replayed: Replay) -> tuple[CurveRuler, Array]:
    """The curve's ruler and (N,) the deepest penetration at each planned point [m].

    A tick counts for the planned point nearest to its proxy, and a slide from one tick to the next
    for the points between; the depth is 0 where the hand never pressed.

    Raises
    ------
    InputError
        The fixture was not drawn as a curve.
    """
    ruler = CurveRuler.of(replayed.fixture)
    if ruler is None:
        raise InputError(
            "This fixture was not drawn as a curve, so there is no depth along it. Leave the "
            "picture out.",
            code="no-curve",
        )
    ticks = replayed.ticks
    in_contact = ticks.penetration > CONTACT_M
    penetration = ticks.penetration[in_contact]
    point = ruler.nearest(ticks.proxy[in_contact])
    depth = np.zeros(len(ruler.points))
    np.maximum.at(depth, point, penetration)
    next_tick = np.diff(np.flatnonzero(in_contact)) == 1
    same_stroke = ruler.stroke[point[1:]] == ruler.stroke[point[:-1]]
    slid = np.abs(np.diff(point))
    for k in np.flatnonzero(next_tick & same_stroke & (slid > 1) & (slid <= MAX_SLIDE)):
        low, high = sorted((point[k], point[k + 1]))
        depth[low:high] = np.maximum(depth[low:high], min(penetration[k], penetration[k + 1]))
    return ruler, depth


def image_places(fixture: Fixture) -> Array:
    """(N, 2) where the planned points lie on the slice, (u, v) [px].

    This is the least-squares inverse of the registration's map from the plane into space; it is
    exact for points that the map made.

    Raises
    ------
    InputError
        The fixture was not registered from an image.
    """
    record = fixture.registration
    if record is None or record.T_robot_image.shape != (3, 3):
        raise InputError(
            "The fixture holds no registration from an image's pixels. Leave --image out.",
            code="no-image-registration",
        )
    T_robot_image = record.T_robot_image
    from_origin = fixture.points - T_robot_image[:, 2]
    return np.linalg.lstsq(T_robot_image[:, :2], from_origin.T, rcond=None)[0].T


def depth_plot(replayed: Replay) -> Figure:
    """Deepest penetration along the planned curve."""
    ruler, depth = depth_along(replayed)
    figure, axes = subplots(7.0, 2.6)
    for stroke in np.unique(ruler.stroke):
        part = ruler.stroke == stroke
        arclength_mm = MM * ruler.arclength[part]
        depth_mm = MM * depth[part]
        axes.fill_between(arclength_mm, depth_mm, color=PROXY, alpha=0.25, lw=0)
        axes.plot(arclength_mm, depth_mm, lw=0.9, color=PROXY, label=f"stroke {stroke}")
    axes.set(xlabel="along the planned curve [mm]", ylabel="deepest penetration [mm]")
    axes.set_ylim(bottom=0)
    axes.margins(x=0)
    if len(np.unique(ruler.stroke)) > 1:
        axes.legend(fontsize="small")
    return figure


def slice_depth(replayed: Replay, image: PlannedImage) -> Figure:
    """The slice with the planned curve on it, coloured by the deepest penetration.

    Raises
    ------
    InputError
        The image is not the one that the fixture was planned on.
    """
    planned = replayed.fixture.provenance.inputs.get("image")
    if planned is not None and planned != image.sha256:
        raise InputError(
            f"The image's SHA-256 is {image.sha256[:12]}..., and the fixture was planned on "
            f"{planned[:12]}.... Give the planned slice.",
            code="another-slice",
            numbers={"found": image.sha256, "expected": planned},
        )
    _, depth = depth_along(replayed)
    places = image_places(replayed.fixture)
    height, width = image.rgb.shape[:2]
    figure, axes = subplots(7.0, max(3.0, 7.0 * height / width - 0.4))
    grey = np.asarray(image.rgb, float).mean(axis=2)
    axes.imshow(grey, cmap="gray", vmax=1.25 * max(1.0, grey.max()), interpolation="nearest")
    pressed = depth > 0
    axes.plot(*places[~pressed].T, ".", ms=1.2, color=CLOUD, label="planned curve, not pressed")
    dots = axes.scatter(
        *places[pressed].T, c=MM * depth[pressed], s=14, cmap="autumn_r", vmin=0, zorder=3
    )
    figure.colorbar(dots, ax=axes, label="deepest penetration [mm]", shrink=0.8)
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), fontsize="small", markerscale=6)
    # A length across the slice, at the bottom on the left.
    scale_mm = MM * float(np.linalg.norm(replayed.fixture.registration.T_robot_image[:, 0]))
    length = nice_length(0.2 * width * scale_mm)
    start = 0.03 * width
    low = 0.96 * height
    axes.plot([start, start + length / scale_mm], [low, low], color="white", lw=2.5)
    axes.text(start, low - 0.015 * height, f"{length:g} mm", color="white", fontsize="small")
    axes.set_axis_off()
    return figure
