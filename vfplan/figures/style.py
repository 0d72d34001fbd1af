"""One look for every picture: one palette, sizes that read at page width, PNG output."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar
from numpy.typing import NDArray

from vfplan.display import nice_length
from vfplan.io.writing import write_whole
from vfplan.palette import CYCLE, FORCE, RULE, WALL
from vfplan.stability.contacts import CaseResult

# Dots an inch of every picture.
DPI = 150

# Height [pt] of text that reads at the width of a page.
TEXT_PT = 9.0

# Width [px of the picture] of the smallest slice: the 6 inches of a page.
WIDTH_PX = 6 * DPI

# Height [in] of the margin beside a slice that holds one row of a legend.
MARGIN_IN = 0.45

# The white edge of lines and letters that lie on a slice, which may be dark.
HALO = (withStroke(linewidth=2.5, foreground="white"),)

# All other settings are Matplotlib's defaults, whatever a program that uses vfplan has set.
SETTINGS = {k: v for k, v in mpl.rcParamsDefault.items() if not k.startswith("backend")}
SETTINGS |= {
    "font.size": TEXT_PT, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
    "axes.prop_cycle": mpl.cycler(color=CYCLE), "grid.color": "#ebebeb", "legend.frameon": False,
}  # fmt: skip


def new_figure(width_in: float, height_in: float) -> Figure:
    """A figure with its own canvas: no pyplot, no global state, no screen."""
    with style():
        return Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")


def subplots(width_in: float, height_in: float, *grid: int, **how: Any) -> tuple[Figure, Any]:
    """A new figure, and its axes in the common look, as `Figure.subplots` gives them."""
    figure = new_figure(width_in, height_in)
    with style():
        return figure, figure.subplots(*grid, **how)


def style():
    """The `with` block in which axes are made, so that they carry the common look."""
    return mpl.rc_context(SETTINGS)


@contextmanager
def on_slice(
    path: Path, size_px: tuple[float, float], inch: float, below_in: float, margin_in: float = 0.0,
    **legend: Any,
) -> Iterator[tuple[Figure, Any]]:  # fmt: skip
    """Write what the block draws: a figure, and axes in a slice's pixels, each so many inches.

    Parameters
    ----------
    path
        The picture to write.
    size_px
        Width and height of the slice.
    inch
        Size of a pixel.
    below_in, margin_in
        Height below the slice for the legend, and width on its right for more.
    legend
        Where and how the legend stands; each label is in it once.
    """
    width, height = size_px
    figure = new_figure(width * inch + margin_in, height * inch + below_in)
    figure.set_layout_engine("none")
    with style():
        whole = figure.get_size_inches()
        axes = figure.add_axes((0, below_in / whole[1], *(np.multiply(size_px, inch) / whole)))
        axes.set_axis_off()
        axes.set(aspect="equal", xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
        yield figure, axes
        handles, labels = axes.get_legend_handles_labels()
        once = dict(zip(labels, handles, strict=True))
        figure.legend(once.values(), once.keys(), **{"ncols": min(8, len(once)), **legend})
    save_png(figure, path)


def draw_scale(axes: Any, mm_per_px: float, factor: float | None = None) -> None:
    """A bar of a round length at the bottom on the left of a slice.

    factor: how much larger than life residuals are drawn on it
    """
    length_mm = nice_length(0.15 * axes.get_xlim()[1] * mm_per_px)
    text = f"{length_mm:g} mm"
    if factor is not None:
        text += f" in the slice, {length_mm / factor:g} mm of a residual"
    size = length_mm / mm_per_px, text, "lower left"
    look = {"size_vertical": 0.02 * length_mm / mm_per_px, "color": FORCE, "label_top": True}
    axes.add_artist(AnchoredSizeBar(axes.transData, *size, pad=0.3, sep=3, **look))


def pixels_on(plane: NDArray, places: NDArray) -> NDArray:
    """(M, 2) pixels of places (M, k), projected onto a slice; plane (k, 3) maps (u, v, 1) there."""
    return (places - plane[:, 2]) @ np.linalg.pinv(plane[:, :2]).T


def png_bytes(figure: Figure) -> bytes:
    """The figure as PNG; the same figure gives the same bytes (no date, no software version)."""
    data = io.BytesIO()
    with style():
        figure.savefig(data, format="png", metadata={"Software": None})
    return data.getvalue()


def save_png(figure: Figure, path: Path) -> None:
    """Write the figure, whole or not at all; raises `OutputError`."""
    write_whole(path, [png_bytes(figure)], overwrite=True)


RULES = tuple(RULE)
# Width of a rule's dots with the gap beside them, as a share of the scene's column.
RULE_WIDTH = 1 / (len(RULES) + 1)

# Excess up to which the axis is linear. Beyond it, it is logarithmic on both sides.
LINEAR_UP_TO = 1e-3


def passivity_plot(rows: list[CaseResult]) -> Figure:
    """Net work less the bound of each random cycle, from the results of part "passivity".

    One dot a cycle, above 0 where the fixture gave the hand more than sampling explains.
    """
    cases = [row for row in rows if row.case.startswith("passivity/")]
    # In the order in which they come first.
    scenes = list(dict.fromkeys(row.values["scene"] for row in cases))
    labels = {row.values["rule"]: f"rule {row.values['rule']}" for row in cases}
    figure, axes = subplots(7.0, 3.8)
    for row in cases:
        scene, rule, excess = (row.values[name] for name in ("scene", "rule", "excess"))
        # The rules stand side by side, the middle one in the middle of the column.
        middle = scenes.index(scene) + (RULES.index(rule) - len(RULES) // 2) * RULE_WIDTH
        x = middle + np.linspace(-0.4, 0.4, len(excess)) * RULE_WIDTH
        axes.plot(x, excess, ".", color=RULE[rule], markersize=5, label=labels.pop(rule, None))
    axes.set_yscale("symlog", linthresh=LINEAR_UP_TO)
    axes.axhline(0.0, color=WALL, linewidth=1.2)
    axes.text(0.99, 0.97, "active: the fixture gives energy", color=WALL,
              ha="right", va="top", transform=axes.transAxes)  # fmt: skip
    axes.set_xticks(range(len(scenes)), scenes)
    axes.set_ylabel("(net work on the hand − bound) / stored energy")
    figure.legend(loc="outside upper center", ncols=3, markerscale=2)
    return figure
