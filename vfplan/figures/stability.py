"""Stability in a picture: work against the passivity bound."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from vfplan.figures.style import subplots
from vfplan.palette import CONTACT, RULE
from vfplan.stability import Row


def passivity_plot(rows: list[Row]) -> Figure:
    """Net work less the bound of each random cycle, from the rows of part "passivity"."""
    rows = [row for row in rows if row.case.startswith("passivity/")]
    scenes = list(dict.fromkeys(row.values["scene"] for row in rows))
    figure, axes = subplots(7.0, 3.6)
    for beside, (rule, colour) in zip((-0.27, 0.0, 0.27), RULE.items(), strict=True):
        for row in (row for row in rows if row.values["rule"] == rule):
            excess = np.array(row.values["excess"])
            x = scenes.index(row.values["scene"]) + beside + np.linspace(-0.1, 0.1, len(excess))
            axes.plot(x, excess, ".", color=colour, markersize=4)
        axes.plot([], [], "o", color=colour, label=rule)
    axes.axhline(0.0, color=CONTACT, lw=1.0, label="bound: above it the fixture is active")
    axes.set_yscale("symlog", linthresh=1e-3)
    axes.set_xticks(range(len(scenes)), scenes, rotation=20)
    axes.grid(False, axis="x")
    axes.set_ylabel("(net work on the hand − bound) / stored")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.12), ncols=4)
    return figure
