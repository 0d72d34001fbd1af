"""Stability in a picture: work against the passivity bound."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from vfplan.figures.style import subplots
from vfplan.palette import CONTACT, RULE
from vfplan.stability import CaseResult


def passivity_plot(rows: list[CaseResult]) -> Figure:
    """Net work less the bound of each random cycle, from the rows of part "passivity"."""
    scenes: list[str] = []
    figure, axes = subplots(7.0, 3.6)
    shifts = dict(zip(RULE, (-0.27, 0.0, 0.27), strict=True))
    for row in rows:
        if not row.case.startswith("passivity/"):
            continue
        scene, rule = row.values["scene"], row.values["rule"]
        if scene not in scenes:
            scenes.append(scene)
        excess = np.array(row.values["excess"])
        x = scenes.index(scene) + shifts[rule] + np.linspace(-0.1, 0.1, len(excess))
        axes.plot(x, excess, ".", color=RULE[rule], markersize=4)
    for rule, colour in RULE.items():
        axes.plot([], [], "o", color=colour, label=rule)
    axes.axhline(0.0, color=CONTACT, lw=1.0, label="bound: above it the fixture is active")
    axes.set_yscale("symlog", linthresh=1e-3)
    axes.set_xticks(range(len(scenes)), scenes, rotation=20)
    axes.grid(False, axis="x")
    axes.set_ylabel("(net work on the hand − bound) / stored")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.12), ncols=4)
    return figure
