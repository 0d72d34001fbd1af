"""What a burr removed, seen from the tool's side, and how the force went."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vfplan.burr.burr import Burred
from vfplan.display import MM
from vfplan.engine.parameters import Vector
from vfplan.figures.replay import plane_basis
from vfplan.figures.style import new_figure, style
from vfplan.replaying.quantities import row_norms


def burr_figure(burred: Burred) -> Figure:
    """What was removed, from above and in a section, and the force over time."""
    figure = new_figure(7.5, 6.0)
    axis = burred.replayed.fixture.ignore_axis
    with style():
        grid = figure.add_gridspec(2, 2, height_ratios=(3, 2))
        below = figure.add_subplot(grid[1, :])
        if axis is not None:
            plane = figure.add_subplot(grid[0, :])
        else:
            above = figure.add_subplot(grid[0, 0])
            section = figure.add_subplot(grid[0, 1])
    if axis is not None:
        everything = np.ones(len(burred.before), bool)
        middle = burred.before.mean(axis=0)
        draw_points(plane, burred, plane_basis(axis), middle, everything)
        plane.set(title="in its plane", xlabel="[mm]", ylabel="[mm]", aspect="equal")
    else:
        draw_in_space(figure, above, section, burred)

    ticks = burred.replayed.ticks
    below.plot(ticks.time, row_norms(ticks.force), lw=0.8)
    times = ticks.time[np.minimum(burred.tick, len(ticks.time) - 1)]
    removed = np.cumsum([len(event.remove) for event in burred.events])
    with style():
        counts = below.twinx()
    counts.plot(times, removed, lw=0.8, color="C1")
    counts.set_ylabel("points removed")
    below.set(xlabel="time [s]", ylabel="force [N]")
    return figure


def draw_in_space(figure: Figure, above: Axes, section: Axes, burred: Burred) -> None:
    """Draw the points around the pit, seen from the tool and in a section through it."""
    moved = burred.before - burred.after
    depth = row_norms(moved)
    is_lowered = depth > 0
    up = moved.sum(axis=0)
    middle = burred.after.mean(axis=0)
    if is_lowered.any():
        up = up / np.linalg.norm(up)
        middle = burred.after[is_lowered].mean(axis=0)
    else:
        up = np.array([0.0, 0.0, 1.0])
    sides = np.linalg.svd(up[None])[2][1:]
    flat = MM * (burred.after - middle) @ sides.T

    half_width = 1.6 * max(4.0, np.abs(flat[is_lowered]).max(initial=0.0))
    in_view = np.abs(flat).max(axis=1) < half_width
    dots = above.scatter(*flat[in_view].T, c=MM * depth[in_view], s=4, cmap="viridis")
    figure.colorbar(dots, ax=above, label="removed [mm]")
    above.set(title="seen from the tool", xlabel="[mm]", ylabel="[mm]", aspect="equal")
    in_section = in_view & (np.abs(flat[:, 1]) < 0.1 * half_width)
    draw_points(section, burred, np.stack((sides[0], up)).T, middle, in_section)
    section.set(title="a section", xlabel="[mm]", ylabel="up [mm]")


def draw_points(
    axes: Axes, burred: Burred, basis: Vector, middle: Vector, in_view: NDArray[np.bool_]
) -> None:
    """Draw points in a plane, before and after."""
    for rows, name in ((burred.before, "before"), (burred.after, "after")):
        flat = MM * (rows - middle) @ basis
        axes.plot(*flat[in_view].T, ".", ms=3, label=name)
    axes.legend(loc="best")
