"""What a burr has taken away, seen from the tool's side, and how the force went."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vfplan.burr.burr import Burred
from vfplan.engine.parameters import Vector
from vfplan.figures.replay import plane_basis
from vfplan.figures.style import new_figure, style
from vfplan.replaying.quantities import row_norms

MM = 1e3


def burr_figure(burred: Burred) -> Figure:
    """What was taken away, from above and in a section, and the force over time."""
    figure = new_figure(7.5, 6.0)
    with style():
        grid = figure.add_gridspec(2, 2, height_ratios=(3, 2))
        below = figure.add_subplot(grid[1, :])
        axis = burred.replayed.fixture.ignore_axis
        parts = grid[0, :] if axis is not None else (grid[0, 0], grid[0, 1])
        panels = [figure.add_subplot(part) for part in np.atleast_1d(parts)]
    if axis is None:
        _in_space(figure, panels, burred)
    else:
        _points(panels[0], burred, plane_basis(axis), burred.before.mean(axis=0))
        panels[0].set(title="in its plane", xlabel="[mm]", ylabel="[mm]", aspect="equal")
    ticks = burred.replayed.ticks
    below.plot(ticks.time, row_norms(ticks.force), lw=0.8)
    times = ticks.time[np.minimum(burred.tick, len(ticks.time) - 1)]
    taken = np.cumsum([len(event.remove) for event in burred.events])
    with style():
        count = below.twinx()
    count.plot(times, taken, lw=0.8, color="C1")
    count.set_ylabel("points taken")
    below.set(xlabel="time [s]", ylabel="force [N]")
    return figure


def _in_space(figure: Figure, panels: list[Axes], burred: Burred) -> None:
    above, across = panels
    moved = burred.before - burred.after
    depth = row_norms(moved)
    up = moved.sum(axis=0)
    up = up / np.linalg.norm(up) if up.any() else np.array([0.0, 0.0, 1.0])
    sides = np.linalg.svd(up[None])[2][1:]
    middle = burred.after[depth > 0].mean(axis=0) if depth.any() else burred.after.mean(axis=0)
    flat = MM * (burred.after - middle) @ sides.T
    reach = 1.6 * max(4.0, np.abs(flat[depth > 0]).max(initial=0.0))
    shown = np.abs(flat).max(axis=1) < reach
    dots = above.scatter(*flat[shown].T, c=MM * depth[shown], s=4, cmap="viridis")
    figure.colorbar(dots, ax=above, label="taken away [mm]")
    above.set(title="seen from the tool", xlabel="[mm]", ylabel="[mm]", aspect="equal")
    strip = shown & (np.abs(flat[:, 1]) < 0.1 * reach)
    _points(across, burred, np.stack((sides[0], up)).T, middle, strip)
    across.set(title="a section", xlabel="[mm]", ylabel="up [mm]")


def _points(
    axes: Axes, burred: Burred, basis: Vector, middle: Vector, shown: Any = slice(None)
) -> None:
    for rows, name in ((burred.before, "before"), (burred.after, "after")):
        axes.plot(*(MM * (rows - middle) @ basis)[shown].T, ".", ms=3, label=name)
    axes.legend(loc="best")
