"""What a burr has taken away, seen from the tool's side, and how the force went."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from vfplan.figures.style import new_figure, style
from vfplan.replaying.burring import Burred
from vfplan.replaying.quantities import row_norms

MM = 1e3


def burr_figure(burred: Burred) -> Figure:
    """What was taken away, from above and in a section, and the force over time."""
    figure = new_figure(7.5, 6.0)
    with style():
        grid = figure.add_gridspec(2, 2, height_ratios=(3, 2))
        above, across = (figure.add_subplot(grid[0, k]) for k in range(2))
        below = figure.add_subplot(grid[1, :])
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
    for rows, name in ((burred.before, "before"), (burred.after, "after")):
        side = MM * (rows - middle) @ np.stack((sides[0], up)).T
        across.plot(*side[strip].T, ".", ms=3, label=name)
    across.set(title="a section", xlabel="[mm]", ylabel="up [mm]")
    across.legend(loc="lower right")
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
