"""The paper's Figs. 2, 4, 5 and 6, laid out as there, with this run's numbers beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from vfplan.figures.replay import EPISODE, MM, plane_basis
from vfplan.figures.style import new_figure, save_png, style

# Our colours, under the names that the paper uses.
from vfplan.palette import CLOUD, FORCE
from vfplan.palette import ERROR as PROXY
from vfplan.palette import TUBE as HIP
from vfplan.palette import WALL as CONTACT
from vfplan.replaying.metrics import CONTACT_M
from vfplan.replaying.replay import Replay
from vfplan.session.result import TickBlock

MARK_HZ = 10.0
"""Marks a second in the experiments."""
SIMULATION_MARK_HZ = 3.0
"""Marks a second in the simulations, whose pointer is slow."""
MIN_MARKS = 14
"""Marks on the shortest path of a simulation, at least."""
TRIAL_COLOUR = "#a9dcb4"
LABELS = {
    "point": "(a) single point",
    "segment": "(b) segment",
    "teapot": "(c) teapot",
    "omega": "(d) hand-drawn Ω",
}


def contact_marks(ticks: TickBlock, rate_hz: float) -> NDArray[np.intp]:
    """Indices of ticks in contact, at most `rate_hz` of them a second: the first of each slot."""
    slot = np.floor((ticks.time - ticks.time[0]) * rate_hz).astype(np.int64)
    in_contact = np.flatnonzero(ticks.penetration > CONTACT_M)
    _, first = np.unique(slot[in_contact], return_index=True)
    return in_contact[first]


def draw_simulations(panels: dict[str, tuple[str, Replay, dict[str, Any]]], path: Path) -> None:
    """Fig. 2: one panel a scene with its numbers.

    panels: the scene, its replay and its numbers, by the name of the panel
    """
    rows = 1
    columns = 1
    if len(panels) > 1:
        rows = 2
        columns = 2
    figure = new_figure(4.6 * columns + 0.4, 4.2 * rows)
    with style():
        grid = figure.subplots(rows, columns, squeeze=False)
    for axes, (scene, replayed, numbers) in zip(grid.flat, panels.values(), strict=True):
        mark_hz = max(SIMULATION_MARK_HZ, MIN_MARKS / replayed.metrics["duration_s"])
        draw_in_plane(axes, replayed, mark_hz)
        axes.set_title(LABELS[scene], loc="left", fontsize=9)
        axes.set_xlabel("x [mm]\n" + "\n".join(lines_of(numbers)), fontsize=8)
        axes.set_ylabel("y [mm]", fontsize=8)
    grid[0, 0].legend(loc="best", fontsize=7, markerscale=2)
    save_png(figure, path)


def draw_in_plane(axes: Axes, replayed: Replay, mark_hz: float) -> None:
    """Blue crosses, green HIP, red contact circles about the proxy, magenta normals, black u."""
    ticks = replayed.ticks
    fixture = replayed.fixture
    basis = plane_basis(fixture.ignore_axis)
    marks = contact_marks(ticks, mark_hz)
    radius = MM * fixture.contact_radius
    cloud = MM * fixture.points @ basis
    hip = MM * ticks.hip @ basis
    proxy = (MM * ticks.proxy @ basis)[marks]
    normal = (ticks.normal @ basis)[marks]
    axes.plot(*cloud.T, "x", ms=2.0, mew=0.5, color=CLOUD, label="cloud", zorder=2)
    axes.plot(*hip.T, ".", ms=2.0, color=HIP, label="HIP", zorder=3)
    axes.plot(*proxy.T, ".", ms=2.0, color=CONTACT, label="proxy, $r_c$", zorder=4)
    circles = [Circle(tuple(centre), radius) for centre in proxy]
    axes.add_collection(
        PatchCollection(circles, facecolor="none", edgecolor=CONTACT, lw=0.5, alpha=0.8)
    )
    arrow = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.003}
    axes.quiver(*proxy.T, *(radius * normal).T, color=PROXY, zorder=5, **arrow)
    axes.quiver(*proxy.T, *(hip[marks] - proxy).T, color="black", zorder=5, **arrow)
    axes.set_aspect("equal", adjustable="datalim")


def draw_experiment(replayed: Replay, numbers: dict[str, Any], path: Path) -> None:
    """Figs. 4 and 6: (a) force over time, one trial green; (b) its trajectory; the numbers."""
    is_planar = replayed.fixture.ignore_axis is not None
    projection = "3d"
    if is_planar:
        projection = None
    figure = new_figure(10.5, 4.6)
    with style():
        left, middle, right = figure.add_gridspec(1, 3, width_ratios=(4, 4, 2.1))
        force = figure.add_subplot(left)
        trajectory = figure.add_subplot(middle, projection=projection)
        text = figure.add_subplot(right)

    ticks = replayed.ticks
    trial = max(replayed.metrics["episodes"], key=lambda episode: episode["penetration_max_m"])
    for episode in replayed.metrics["episodes"]:
        force.axvspan(episode["start_s"], episode["end_s"], color=EPISODE, lw=0, zorder=0)
    force.axvspan(trial["start_s"], trial["end_s"], color=TRIAL_COLOUR, lw=0, zorder=0)
    for axis, name in enumerate("xyz"):
        force.plot(ticks.time, ticks.force[:, axis], lw=0.8, label=f"$F_{name}$")
    force.plot(ticks.time, np.linalg.norm(ticks.force, axis=1), color=FORCE, lw=1, label="$|F|$")
    force.set_xlabel("time [s]")
    force.set_ylabel("force on the hand [N]")
    # The margin leaves room for the legend above the peaks.
    force.margins(y=0.14)
    force.legend(ncols=4, fontsize=7, loc="upper right")
    force.set_title("(a) VF force; one trial in dark green", loc="left", fontsize=9)
    first, last = np.searchsorted(ticks.time, (trial["start_s"] - 0.15, trial["end_s"] + 0.15))
    if is_planar:
        draw_trial_in_plane(trajectory, replayed, first, last)
    else:
        draw_trial_in_space(trajectory, replayed, first, last)
    trajectory.set_title("(b) that trial, marks at 10 Hz", loc="left", fontsize=9)

    text.set_axis_off()
    text.text(0, 1, "\n".join(lines_of(numbers)), va="top", fontsize=8.5, linespacing=1.5)
    save_png(figure, path)


def marks_between(replayed: Replay, first: int, last: int) -> Any:
    """The ticks from `first` to before `last` at which the contact is drawn."""
    marks = contact_marks(replayed.ticks, MARK_HZ)
    return marks[(marks >= first) & (marks < last)]


def draw_trial_in_plane(axes: Axes, replayed: Replay, first: int, last: int) -> None:
    """The trajectory of the ticks from `first` to before `last`, in the plane of the slice."""
    ticks = replayed.ticks
    fixture = replayed.fixture
    basis = plane_basis(fixture.ignore_axis)
    marks = marks_between(replayed, first, last)
    radius = MM * fixture.contact_radius
    cloud = MM * fixture.points @ basis
    hip = MM * ticks.hip[first:last] @ basis
    proxy = MM * ticks.proxy[marks] @ basis
    normal = radius * ticks.normal[marks] @ basis
    axes.plot(*cloud.T, "x", ms=3, mew=0.6, color=CLOUD, label="cloud")
    axes.plot(*hip.T, ".", ms=2, color=HIP, label="HIP")
    axes.plot(*proxy.T, ".", ms=4, color=PROXY, label="proxy")
    circles = [Circle(tuple(centre), radius) for centre in proxy]
    axes.add_collection(PatchCollection(circles, facecolor="none", edgecolor=CONTACT, lw=0.7))
    arrow = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.004}
    axes.quiver(*proxy.T, *normal.T, color=PROXY, **arrow)

    # The limits are a suggestion, because an equal aspect may widen either.
    low = hip.min(axis=0) - 1.5 * radius
    high = hip.max(axis=0) + 1.5 * radius
    axes.set_xlim(low[0], high[0], auto=True)
    axes.set_ylim(low[1], high[1], auto=True)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("in plane, 1 [mm]")
    axes.set_ylabel("in plane, 2 [mm]")
    axes.legend(fontsize=7, loc="best", markerscale=1.5)


def draw_trial_in_space(axes: Any, replayed: Replay, first: int, last: int) -> None:
    """The trajectory of the ticks from `first` to before `last`, seen along the square's plane.

    x goes across, y up, and z into the page.
    """
    ticks = replayed.ticks
    fixture = replayed.fixture
    marks = marks_between(replayed, first, last)
    radius = MM * fixture.contact_radius
    hip = MM * ticks.hip[first:last]
    proxy = MM * ticks.proxy[marks]
    low = hip.min(axis=0) - 1.6 * radius
    high = hip.max(axis=0) + 1.6 * radius
    cloud = MM * fixture.points
    cloud = cloud[((cloud > low) & (cloud < high)).all(axis=1)]
    every = max(1, len(cloud) // 3000)
    drawn_axes = [0, 2, 1]
    cloud = cloud[::every, :][:, drawn_axes]
    axes.plot(*cloud.T, ".", ms=0.8, color=CLOUD, alpha=0.5, label="cloud")
    axes.plot(*hip[:, drawn_axes].T, ".", ms=1.5, color=HIP, label="HIP")
    axes.plot(*proxy[:, drawn_axes].T, ".", ms=4, color=PROXY, label="proxy")
    angle = np.linspace(0, 2 * np.pi, 41)[:, None]
    for centre, normal in zip(proxy, ticks.normal[marks], strict=True):
        across = np.cross(normal, [0.0, 0.0, 1.0])
        ring = centre + radius * (np.cos(angle) * normal + np.sin(angle) * across)
        axes.plot(*ring[:, drawn_axes].T, color=CONTACT, lw=0.6)
        arrow = np.stack([centre, centre + radius * normal])
        axes.plot(*arrow[:, drawn_axes].T, color=PROXY, lw=1.0)
    axes.view_init(elev=14, azim=-70)
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(4))
        axis.set_tick_params(labelsize=7)
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("z [mm]")
    axes.set_zlabel("y [mm]")
    axes.legend(fontsize=7, loc="upper left")


def draw_plan(image: Path, path: Path) -> dict[str, Any]:
    """Fig. 5: (a) the planned slice, (b) its binary image; the numbers of both."""
    from vfplan.curve.extraction import extract_curve
    from vfplan.images.read import read_image

    planned = read_image(image)
    extraction = extract_curve(planned, method="mask")
    numbers = {
        "width_px": planned.width_px,
        "height_px": planned.height_px,
        "mask_pixels": int(extraction.mask.sum()),
        "in_the_paper": {"width_px": 871, "height_px": 786, "points": 2204},
    }
    figure = new_figure(9.0, 4.4)
    with style():
        left, right = figure.subplots(1, 2)
    left.imshow(planned.rgb)
    right.imshow(extraction.mask, cmap="gray", interpolation="nearest")
    left.set_title(
        f"(a) planned slice, {planned.width_px} x {planned.height_px} px", loc="left", fontsize=9
    )
    right.set_title(f"(b) binary image, {numbers['mask_pixels']} pixels", loc="left", fontsize=9)
    for axes in (left, right):
        axes.set_axis_off()
    save_png(figure, path)
    return numbers


def lines_of(numbers: dict[str, Any]) -> list[str]:
    """The numbers of a figure as short lines."""
    in_the_paper = numbers.get("in_the_paper", {})
    points = f"N = {numbers['points']:,}".replace(",", " ")
    if "points" in in_the_paper:
        points += f"  (paper: {in_the_paper['points']:,})".replace(",", " ")
    lines = [points]
    if "density_per_mm" in numbers:
        density = numbers["density_per_mm"]
        density_in_the_paper = in_the_paper.get("density_per_mm")
        lines.append(f"{density:.3g} points/mm  (paper: {density_in_the_paper:g})")
    for rule in ("paper", "robust"):
        run = numbers[rule]
        contacts = f"{run['contacts']} contacts"
        if run["contacts"] == 1:
            contacts = "1 contact"
        lines.append(
            f"rule {rule}: {contacts}, $F_{run['strongest_axis']}$ "
            f"{run['force_least_n']:.1f} to {run['force_most_n']:+.1f} N"
        )
        lines.append(
            f"   clearance {run['clearance_min_um']:+.1f} µm, "
            f"{run['entrenched_ticks']} of {run['ticks']} ticks inside"
        )
    return lines
