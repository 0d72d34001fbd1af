"""The energy balance of the stability study, as a picture."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from vfplan.figures.style import subplots
from vfplan.palette import CONTACT, RULE
from vfplan.stability import CaseResult

RULES = tuple(RULE)
RULE_WIDTH = 1 / (len(RULES) + 1)
"""Width of a rule's dots with the gap beside them, as a share of the scene's column."""

LINEAR_UP_TO = 1e-3
"""Excess up to which the axis is linear. Beyond it, it is logarithmic on both sides."""


def passivity_plot(rows: list[CaseResult]) -> Figure:
    """Net work less the bound of each random cycle, from the results of part "passivity".

    One dot a cycle, above 0 where the fixture gave the hand more than sampling explains.
    """
    cases = [row for row in rows if row.case.startswith("passivity/")]
    scenes: list[str] = []
    drawn_rules: list[str] = []
    largest = 0.1
    figure, axes = subplots(7.0, 3.8)
    for row in cases:
        scene = row.values["scene"]
        rule = row.values["rule"]
        if scene not in scenes:
            scenes.append(scene)
        label = None
        if rule not in drawn_rules:
            drawn_rules.append(rule)
            label = f"rule {rule}"
        excess = np.array(row.values["excess"])
        largest = max(largest, float(excess.max()))
        # The rules stand side by side, the middle one in the middle of the column.
        middle = scenes.index(scene) + (RULES.index(rule) - len(RULES) // 2) * RULE_WIDTH
        x = middle + np.linspace(-0.4, 0.4, len(excess)) * RULE_WIDTH
        axes.plot(x, excess, ".", color=RULE[rule], markersize=5, label=label)

    axes.set_yscale("symlog", linthresh=LINEAR_UP_TO)
    top = 10 * largest
    axes.axhspan(0.0, top, color=CONTACT, alpha=0.07, linewidth=0)
    axes.axhline(0.0, color=CONTACT, linewidth=1.2)
    axes.text(0.99, 0.97, "active: the fixture gives energy", color=CONTACT,
              ha="right", va="top", transform=axes.transAxes)  # fmt: skip
    axes.margins(y=0.08)
    axes.set_ylim(top=top)
    # Each scene has a column of its own.
    for column in range(1, len(scenes)):
        axes.axvline(column - 0.5, color="black", alpha=0.12, linewidth=0.8)
    axes.set_xlim(-0.5, len(scenes) - 0.5)
    axes.set_xticks(range(len(scenes)), scenes)
    axes.tick_params(axis="x", length=0)
    axes.grid(False, axis="x")
    axes.set_ylabel("(net work on the hand − bound) / stored energy")
    figure.legend(loc="outside upper center", ncols=3, markerscale=2, frameon=False)
    return figure
