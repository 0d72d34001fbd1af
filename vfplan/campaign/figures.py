"""Where along the curve a tool comes beyond it, and how far."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vfplan.figures.style import new_figure, save_png, style
from vfplan.fixture import Fixture
from vfplan.palette import CLOUD, CONTACT, FORCE
from vfplan.replaying.episodes import CurveRuler

Array = NDArray[np.float64]
BINS = 40


def draw_campaign(fixture: Fixture, table: dict[str, Array], beyond_m: float, path: Path) -> None:
    """Write three views: probability along the curve, on the curve, and of the depth.

    fixture: with a curve, in `robot_base`
    table: the trials, of `read_campaign`
    beyond_m: the depth beyond the true curve [m] whose probability is drawn
    """
    ruler = CurveRuler.of(fixture)
    depth, point = table["depth_m"], table["point"].astype(int)
    entered = depth > beyond_m
    share = np.bincount(point[entered], minlength=len(fixture.points)) / len(depth)
    figure = new_figure(9.0, 7.0)
    with style():
        grid = figure.subplot_mosaic([["on", "on"], ["along", "depth"]])
        _on_the_curve(grid["on"], fixture, share)
        if ruler is not None:
            s = 1e3 * ruler.arclength
            per, edges = np.histogram(s, BINS, weights=share)
            grid["along"].stairs(per, edges, fill=True, color=CONTACT, alpha=0.7)
            grid["along"].set(xlabel="along the curve [mm]")
        grid["along"].set(
            ylabel="probability",
            title=f"where the tool is over {1e3 * beyond_m:g} mm beyond",
        )
        ordered = np.sort(1e3 * depth[depth > -1.0])
        above = 1 - np.arange(len(ordered)) / len(depth)
        grid["depth"].step(ordered, above, color=FORCE, lw=1.2)
        grid["depth"].set(
            xlabel="depth beyond the true curve [mm]", ylabel="probability of more", yscale="log"
        )
    save_png(figure, path)


def _on_the_curve(axes, fixture: Fixture, share: Array) -> None:
    centred = fixture.points - fixture.points.mean(axis=0)
    flat = 1e3 * centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T
    axes.plot(*flat.T, ".", ms=1.5, color=CLOUD, alpha=0.5)
    hit = share > 0
    sizes = 12 + 300 * share[hit] / max(share.max(), 1e-12)
    axes.scatter(*flat[hit].T, s=sizes, color=CONTACT, alpha=0.6, lw=0)
    axes.set(aspect="equal", xlabel="mm", ylabel="mm", title="on the curve, in its plane")
