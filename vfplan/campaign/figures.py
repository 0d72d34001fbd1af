"""Where along the curve a tool goes beyond it, and how far."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from vfplan.figures.style import new_figure, save_png, style
from vfplan.fixture import Fixture
from vfplan.palette import CLOUD, CONTACT, FORCE
from vfplan.replaying.episodes import CurveRuler

Array = NDArray[np.float64]

BINS = 40
"""Number of bins along the curve."""


def draw_campaign(fixture: Fixture, table: dict[str, Array], beyond_m: float, path: Path) -> None:
    """Write three views: probability along the curve, on the curve, and of the depth.

    Parameters
    ----------
    fixture
        With a curve, in `robot_base`.
    table
        The trials, of `read_campaign`.
    beyond_m
        The depth beyond the true curve [m] whose probability is drawn.
    """
    ruler = CurveRuler.of(fixture)
    depth = table["depth_m"]
    point = table["point"].astype(int)
    entered = depth > beyond_m
    share = np.bincount(point[entered], minlength=len(fixture.points)) / len(depth)
    figure = new_figure(9.0, 7.0)
    with style():
        axes = figure.subplot_mosaic([["on", "on"], ["along", "depth"]])
        draw_on_curve(axes["on"], fixture, share)

        # Probability along the curve.
        if ruler is not None:
            share_per_bin, edges = np.histogram(1e3 * ruler.arclength, BINS, weights=share)
            axes["along"].stairs(share_per_bin, edges, fill=True, color=CONTACT, alpha=0.7)
            axes["along"].set_axisbelow(True)
            axes["along"].set(xlabel="along the curve [mm]")
        axes["along"].set(
            ylabel="probability",
            title=f"where the tool is over {1e3 * beyond_m:g} mm beyond",
        )

        # Probability of more than a depth, of the trials that touched the fixture.
        ordered = np.sort(1e3 * depth[point >= 0])
        above = 1 - np.arange(len(ordered)) / len(depth)
        axes["depth"].step(ordered, above, color=FORCE, lw=1.2)
        axes["depth"].set(
            xlabel="depth beyond the true curve [mm]", ylabel="probability of more", yscale="log"
        )
    save_png(figure, path)


def draw_on_curve(axes: Axes, fixture: Fixture, share: Array) -> None:
    """Draw the curve in its plane, with a disc at each point where the tool entered."""
    centred = fixture.points - fixture.points.mean(axis=0)
    flat = 1e3 * centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T
    axes.plot(*flat.T, ".", ms=1.5, color=CLOUD, alpha=0.5)
    hit = share > 0
    sizes = 12 + 300 * share[hit] / max(share.max(), 1e-12)
    axes.scatter(*flat[hit].T, s=sizes, color=CONTACT, alpha=0.6, lw=0)
    axes.set(aspect="equal", xlabel="mm", ylabel="mm", title="on the curve, in its plane")
