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

from vfplan.io.staging import write_whole
from vfplan.palette import CYCLE

DPI = 150
NICE = (1, 2, 5)
_RC = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.prop_cycle": mpl.cycler(color=CYCLE),
    "grid.alpha": 0.25,
    "legend.frameon": False,
}
# All other settings are Matplotlib's own too, whatever a program that uses vfplan has set.
_OWN = {k: v for k, v in mpl.rcParamsDefault.items() if not k.startswith("backend")} | _RC


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
    return mpl.rc_context(_OWN)


@contextmanager
def on_slice(
    path: Path, size_px: tuple[float, float], inch: float, below: float, beside: float = 0.0,
    **legend: Any,
) -> Iterator[tuple[Figure, Any]]:  # fmt: skip
    """Write what the block draws: a figure, and axes in a slice's pixels, each so many inches.

    below, beside: room for the legend and for more [in]
    legend: where and how it stands, each label in it once
    """
    width, height = size_px
    figure = new_figure(width * inch + beside, height * inch + below)
    figure.set_layout_engine("none")
    with style():
        whole = figure.get_size_inches()
        axes = figure.add_axes((0, below / whole[1], *(np.multiply(size_px, inch) / whole)))
        axes.set_axis_off()
        axes.set(aspect="equal", xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
        yield figure, axes
        handles, labels = axes.get_legend_handles_labels()
        once = dict(zip(labels, handles, strict=True))
        figure.legend(once.values(), once.keys(), **{"ncols": min(8, len(once)), **legend})
    save_png(figure, path)


def nice_below(value: float) -> float:
    """1, 2 or 5 times a power of ten, at most `value`: the length of a scale bar."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(power * n for n in NICE if power * n <= value))


def png_bytes(figure: Figure) -> bytes:
    """The figure as PNG; the same figure gives the same bytes (no date, no software version)."""
    held = io.BytesIO()
    figure.savefig(held, format="png", metadata={"Software": None})
    return held.getvalue()


def save_png(figure: Figure, path: Path) -> None:
    """Write the figure, whole or not at all; raises `OutputError`."""
    write_whole(path, [png_bytes(figure)], overwrite=True)
