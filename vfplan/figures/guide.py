"""A guide over a session: how far beside the curve the tip was, over arc length."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from vfplan.figures.style import new_figure, style
from vfplan.palette import BRIDGED, CLOUD, FORCE, HIP
from vfplan.replaying import Replay

MM = 1e3


def guide_plot(replayed: Replay) -> Figure:
    """Largest lateral error and force over arc length."""
    guide = replayed.metrics["guide"]
    profile = guide["profile"]
    arc = MM * np.array(profile["arc_m"])
    lateral = MM * np.array([np.nan if v is None else v for v in profile["lateral_m"]])
    force = np.where(np.isnan(lateral), np.nan, profile["force_n"])
    figure = new_figure(7.0, 3.4)
    with style():
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    top.axhspan(0, MM * guide["radius_m"], color=BRIDGED, alpha=0.3, lw=0, label="tube")
    top.plot(arc, lateral, color=HIP, lw=1.1, label="tip, largest lateral error")
    bottom.plot(arc, force, color=FORCE, lw=1.1)
    for start in MM * np.cumsum(guide["lengths_m"])[:-1]:
        for axes in (top, bottom):
            axes.axvline(start, color=CLOUD, lw=0.6, ls=":")
    top.set_ylabel("beside the curve [mm]")
    top.set_ylim(bottom=0)
    top.legend(ncols=2, loc="lower right", bbox_to_anchor=(1, 0.98), fontsize=8)
    top.set_title(f"outside for {guide['outside_s']:.2f} s", loc="left")
    bottom.set_ylabel("force [N]")
    bottom.set_xlabel("arc length along the guide [mm]")
    bottom.set_xlim(0, MM * sum(guide["lengths_m"]))
    return figure
