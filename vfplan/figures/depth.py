"""How deep the hand went along the planned curve: as a plot, and on the slice it was drawn on."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vfplan.errors import InputError
from vfplan.figures.style import subplots
from vfplan.fixture import Fixture
from vfplan.images.read import PlannedImage
from vfplan.palette import CLOUD, PROXY
from vfplan.replaying import Replay
from vfplan.replaying.episodes import CurveRuler
from vfplan.replaying.quantities import CONTACT_M

Array = NDArray[np.float64]
MM = 1e3
_SLIDE = 50  # planned points: the proxy that passes more in a tick left the curve between


def depth_along(replayed: Replay) -> tuple[CurveRuler, Array]:
    """The curve's ruler and (N,) the deepest penetration held at each planned point [m].

    A tick counts for the planned point nearest to its proxy, and a slide from one tick to the next
    for the points between; 0 where the hand never pressed.

    Raises InputError: the fixture was not drawn as a curve
    """
    ruler = CurveRuler.of(replayed.fixture)
    if ruler is None:
        raise InputError("a cloud that was not drawn as a curve has no depth along it")
    ticks = replayed.ticks
    held = ticks.penetration > CONTACT_M
    deep, point = ticks.penetration[held], ruler.nearest(ticks.proxy[held])
    depth = np.zeros(len(ruler.points))
    np.maximum.at(depth, point, deep)
    next_tick = np.diff(np.flatnonzero(held)) == 1
    same_stroke = ruler.stroke[point[1:]] == ruler.stroke[point[:-1]]
    slid = np.abs(np.diff(point))
    for k in np.flatnonzero(next_tick & same_stroke & (slid > 1) & (slid <= _SLIDE)):
        low, high = sorted((point[k], point[k + 1]))
        depth[low:high] = np.maximum(depth[low:high], min(deep[k], deep[k + 1]))
    return ruler, depth


def image_places(fixture: Fixture) -> Array:
    """(N, 2) where the planned points lie on the slice, (u, v) [px].

    The least-squares inverse of the registration's 2-D -> 3-D map; exact for points it made.

    Raises InputError: the fixture was not registered from an image
    """
    record = fixture.registration
    if record is None or record.T_robot_image.shape != (3, 3):
        raise InputError("the fixture holds no registration from an image's pixels")
    T_robot_image = record.T_robot_image
    rest = fixture.points - T_robot_image[:, 2]
    return np.linalg.lstsq(T_robot_image[:, :2], rest.T, rcond=None)[0].T


def depth_plot(replayed: Replay) -> Figure:
    """Deepest penetration along the planned curve."""
    ruler, depth = depth_along(replayed)
    figure, axes = subplots(7.0, 2.6)
    for stroke in np.unique(ruler.stroke):
        part = ruler.stroke == stroke
        where, deep = MM * ruler.arclength[part], MM * depth[part]
        axes.fill_between(where, deep, color=PROXY, alpha=0.25, lw=0)
        axes.plot(where, deep, lw=0.9, color=PROXY, label=f"stroke {stroke}")
    axes.set(xlabel="along the planned curve [mm]", ylabel="deepest penetration [mm]")
    axes.set_ylim(bottom=0)
    axes.margins(x=0)
    if len(np.unique(ruler.stroke)) > 1:
        axes.legend(fontsize=8)
    return figure


def slice_depth(replayed: Replay, image: PlannedImage) -> Figure:
    """The slice with the planned curve on it, coloured by the deepest penetration.

    Raises InputError: another image than the one the fixture was planned on
    """
    planned = replayed.fixture.provenance.inputs.get("image")
    if planned is not None and planned != image.sha256:
        raise InputError(
            f"the image's SHA-256 is {image.sha256[:12]}..., the fixture was planned on "
            f"{planned[:12]}...; the same image wanted"
        )
    _, depth = depth_along(replayed)
    places = image_places(replayed.fixture)
    height, width = image.rgb.shape[:2]
    figure, axes = subplots(7.0, max(3.0, 7.0 * height / width - 0.4))
    grey = np.asarray(image.rgb, float).mean(axis=2)
    axes.imshow(grey, cmap="gray", vmax=1.25 * max(1.0, grey.max()), interpolation="nearest")
    pressed = depth > 0
    axes.plot(*places[~pressed].T, ".", ms=1.2, color=CLOUD)
    shown = axes.scatter(
        *places[pressed].T, c=MM * depth[pressed], s=14, cmap="autumn_r", vmin=0, zorder=3
    )
    figure.colorbar(shown, ax=axes, label="deepest penetration [mm]", shrink=0.8)
    axes.set_axis_off()
    return figure
