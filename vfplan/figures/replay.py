"""A replay in pictures: over time (the paper's Figs. 4a, 6a), in space (4b, 6b), along a curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from matplotlib.figure import Figure

from vfplan.display import MAX_DRAWN, MM, count
from vfplan.errors import InputError
from vfplan.figures.slice import name_ends
from vfplan.figures.style import HALO, draw_scale, pixels_on, subplots
from vfplan.geometry.lines import Array, normals
from vfplan.images.read import PlannedImage, plane_of_slice
from vfplan.palette import CLOUD, EPISODE, FORCE, PROXY, TIP, TUBE, WALL
from vfplan.replaying.findings import beyond, guides_alone, limits_n
from vfplan.replaying.metrics import CONTACT_M, CurveRuler, episode_count, row_norms
from vfplan.replaying.replay import Replay

# A path that is this many times as large as the fixture is cut: the fixture would be a dot.
MAX_TIMES_FIXTURE = 5


def timeline(replayed: Replay) -> Figure:
    """Force with its limits, penetration and overlap over time, contact episodes shaded."""
    ticks = replayed.ticks
    figure, (top, bottom) = subplots(7.0, 4.2, 2, 1, sharex=True, height_ratios=(3, 2))
    peak = row_norms(ticks.force).max()
    for name, force in zip("xyz", ticks.force.T, strict=True):
        if np.abs(force).max() > 1e-3 * peak:
            top.plot(ticks.time, force, lw=0.8, label=f"$F_{name}$")
    top.plot(ticks.time, row_norms(ticks.force), color=FORCE, lw=1.2, label="$|F|$")
    top.set_ylabel("force on the tip [N]")
    for limit in limits_n(replayed.metrics):
        top.axhline(limit, color=FORCE, ls="--", lw=0.9, label=f"limit {limit:g} N")
    bottom.plot(ticks.time, MM * ticks.penetration, color=PROXY, lw=1.1, label="penetration")
    drawn, beyond_m = beyond(replayed.metrics, ticks.overlap)
    if beyond_m.any():
        bottom.plot(ticks.time, MM * beyond_m, color=TIP, lw=1.1, label=f"beyond {drawn}")
    bottom.set(xlabel="time [s]", ylabel="tool tip [mm]")
    for axes in figure.axes:
        axes.margins(x=0)
        for episode in replayed.metrics["episodes"]:
            axes.axvspan(episode["start_s"], episode["end_s"], color=EPISODE, lw=0, zorder=0)
        axes.legend(ncols=4, loc="lower right", bbox_to_anchor=(1, 0.98), fontsize="small")
    episodes = count(episode_count(replayed.metrics), "contact episode")
    rule = "guide" if guides_alone(replayed.metrics) else f"rule {replayed.record['rule']}"
    top.set_title(f"{episodes}, {rule}", loc="left")
    return figure


def scene(replayed: Replay) -> Figure:
    """Points, wall or tube, and the paths of tip and proxy, where they touched too.

    A planar fixture is drawn in its plane, any other in perspective.
    """
    ticks, fixture = replayed.ticks, replayed.fixture
    axis, radius = fixture.ignore_axis, MM * fixture.contact_radius
    basis = plane_basis(axis)
    cloud, hip, proxy = (MM * places @ basis for places in (fixture.points, ticks.hip, ticks.proxy))
    if axis is None:
        figure, axes = subplots(7.0, 6.0, subplot_kw={"projection": "3d"})
        cloud = cloud[:: max(1, len(cloud) // MAX_DRAWN)]
    else:
        tube_mm = 0.0 if fixture.guidance is None else MM * fixture.guidance.radius
        around = max(3 * radius, 2 * tube_mm)
        low, high = cloud.min(axis=0) - around, cloud.max(axis=0) + around
        path = np.vstack([hip, proxy, low, high])
        ends = path.min(axis=0) - radius, path.max(axis=0) + radius
        if (ends[1] - ends[0]).max() <= MAX_TIMES_FIXTURE * (high - low).max():
            low, high = ends
        outside = ((hip < low) | (hip > high)).any(axis=1).mean()
        height_in = 5.9 * (high[1] - low[1]) / (high[0] - low[0])
        figure, axes = subplots(7.0, float(np.clip(height_in, 1.8, 8.0)) + 0.9)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        if outside > 0:
            words = f"{100 * outside:.2g} % of the tip's path lies outside this picture"
            axes.set_title(words, loc="right", y=0, fontsize="small")
        if fixture.guidance is not None:
            tube = [
                tube_outline(MM * line @ basis, tube_mm, fixture.guidance.ends == "stop")
                for line in fixture.guiding_lines
            ]
            drawn = PolyCollection(tube, fc=(TUBE, 0.15), ec=TUBE, lw=1.2, zorder=1, label="tube")
            axes.add_collection(drawn)
        if fixture.region is not None:
            # Of the balls about all points only the border of them together is seen.
            wall_mm = 2 * (radius + MM * fixture.point_radius)
            balls = {"units": "xy", "offsets": MM * fixture.region.points @ basis, "zorder": 1.6,
                     "transOffset": axes.transData}  # fmt: skip
            for look in ({"ec": WALL, "lw": 2.4}, {"fc": "white", "lw": 0}):
                axes.add_collection(EllipseCollection(wall_mm, wall_mm, 0, **balls, **look))
            axes.plot([], [], color=WALL, lw=1.2, label="wall")
    words = f"line or points ({len(fixture.points)})"
    axes.plot(*cloud.T, ".", ms=1.5, color=CLOUD, label=words, zorder=2)
    axes.plot(*hip.T, lw=1.8, color=TIP, label="path of the tool tip", zorder=3)
    axes.plot(*proxy.T, lw=0.9, color=PROXY, label="proxy", zorder=4)
    touching = proxy[ticks.penetration > CONTACT_M]
    axes.plot(*touching.T, ".", ms=3, color=PROXY, label="proxy, in contact", zorder=4)
    names = zip("xyz", axis_names(basis), strict=False)
    axes.set(aspect="equal", **{f"{letter}label": f"{name} [mm]" for letter, name in names})
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4, fontsize="small", markerscale=2.5)
    return figure


def tube_outline(line: Array, radius: float, is_capped: bool) -> Array:
    """(N, 2) around the tube of a radius along a line (M, 2); a cap is half a circle."""
    # In complex numbers: those times `turn` go clockwise, from the left of the line to its right.
    line, left = line @ [1, 1j], radius * normals(line, closed=False) @ [1, 1j]
    turn = np.exp(-1j * np.linspace(0, np.pi, 33 if is_capped else 2))
    around = np.concatenate(
        [line + left, line[-1] + left[-1] * turn, (line - left)[::-1], line[0] - left[0] * turn]
    )
    return np.column_stack([around.real, around.imag])


def plane_basis(axis: Array | None) -> Array:
    """(3, 2) orthonormal right-handed basis of the plane across `axis`, near x, y or z.

    The first vector is the frame's x axis brought into the plane (y where x is the ignored one).
    Without an axis: (3, 3) the frame's own.
    """
    if axis is None:
        return np.eye(3)
    start = np.eye(3)[0 if abs(axis[0]) < 0.9 else 1]
    first = start - (start @ axis) * axis
    first /= np.linalg.norm(first)
    # Looking against the axis' largest component keeps the picture unmirrored.
    towards = -axis if axis[np.argmax(np.abs(axis))] <= 0 else axis
    return np.stack([first, np.cross(towards, first)], axis=1)


def axis_names(basis: Array) -> list[str]:
    """What a picture's axes are called: the frame's own, with a sign; "≈x" of one beside x."""
    along = np.abs(basis).argmax(axis=0)
    return [
        ("" if np.isclose(abs(column[axis]), 1) else "≈")
        + ("−" if column[axis] < 0 else "")
        + "xyz"[axis]
        for axis, column in zip(along, basis.T, strict=True)
    ]


def guide_plot(replayed: Replay) -> Figure:
    """Largest lateral error and force over arc length."""
    guide = replayed.metrics["guide"]
    profile = guide["profile"]
    arc = MM * np.array(profile["arc_m"])
    lateral = MM * np.array(profile["lateral_m"], dtype=float)
    force = np.where(np.isnan(lateral), np.nan, profile["force_n"])
    figure, (top, bottom) = subplots(7.0, 3.4, 2, 1, sharex=True, height_ratios=(2, 1))
    top.axhspan(0, MM * guide["radius_m"], color=TUBE, alpha=0.3, lw=0, label="tube")
    top.plot(arc, lateral, color=TIP, lw=1.1, label="tip, largest")
    bottom.plot(arc, force, color=FORCE, lw=1.1)
    top.set_ylabel("from the guide's\nline [mm]")
    top.set_ylim(bottom=0)
    top.legend(ncols=2, loc="lower right", bbox_to_anchor=(1, 0.98), fontsize="small")
    top.set_title(f"in contact (outside the tube) for {guide['outside_s']:.3f} s", loc="left")
    bottom.set(xlabel="way along the guide's line [mm]", ylabel="force [N]")
    bottom.set_xlim(0, MM * sum(guide["lengths_m"]))
    return figure


def depth_along(replayed: Replay) -> Array:
    """(N,) the deepest penetration at each planned point of the curve [m].

    A tick counts for the planned point nearest to its proxy. The depth is 0 where the hand never
    pressed. The fixture was drawn as a curve.
    """
    ruler = CurveRuler(replayed.fixture)
    ticks = replayed.ticks
    in_contact = ticks.penetration > CONTACT_M
    depth = np.zeros(len(ruler.points))
    np.maximum.at(depth, ruler.nearest(ticks.proxy[in_contact]), ticks.penetration[in_contact])
    return depth


def slice_depth(replayed: Replay, image: PlannedImage, outlines: Sequence[Any] = ()) -> Figure:
    """The slice in grey with the tip's path and the planned curve, coloured by its penetration.

    image: the one that the fixture was planned on
    outlines: of wall and tube, as `vfplan.review.rendered.outlines_of` gives them
    Raises InputError: it is unknown how it lies
    """
    fixture = replayed.fixture
    plane = plane_of_slice(fixture, image)
    if plane is None:
        message = "The fixture holds no registration from an image's pixels. Leave --image out."
        raise InputError(message, code="no-image-registration")
    depth = depth_along(replayed)
    places = pixels_on(plane, fixture.points)
    height, width = image.rgb.shape[:2]
    figure, axes = subplots(7.0, max(3.0, 7.0 * height / width - 0.4))
    grey = np.asarray(image.rgb, float).mean(axis=2)
    axes.imshow(grey, cmap="gray", vmax=1.25 * max(1.0, grey.max()), interpolation="nearest")
    pressed = depth > 0
    axes.plot(*places[~pressed].T, ".", ms=1.2, color=CLOUD, label="line, not pressed")
    dots = axes.scatter(
        *places[pressed].T, c=MM * depth[pressed], s=14, cmap="viridis", vmin=0, zorder=3
    )
    if pressed.any():
        figure.colorbar(
            dots, ax=axes, label="line, pressed: largest penetration there [mm]", shrink=0.8
        )
    for kind, word, colour in (("wall", "wall", WALL), ("guide", "tube", TUBE)):
        lines = [line for outline in outlines if outline.kind == kind for line in outline.lines]
        if lines:
            axes.add_collection(LineCollection(lines, colors=colour, lw=1.4, label=word))
    tip = pixels_on(plane, replayed.ticks.hip)
    axes.plot(*tip.T, color=TIP, lw=0.8, path_effects=HALO, label="path of the tool tip", zorder=2)
    name_ends(axes, [replace(s, points=pixels_on(plane, s.points)) for s in fixture.strokes])
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    draw_scale(axes, MM * np.linalg.norm(plane[:, 0]))
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4, fontsize="small", markerscale=6)
    axes.set_axis_off()
    return figure
