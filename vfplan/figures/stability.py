"""Stability in two pictures: the map of K over b/T, and work against the passivity bound."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from vfplan.figures.style import subplots
from vfplan.palette import CONTACT, RULE
from vfplan.stability import Row

MARKS = {0: "o", 1: "s", 3: "^"}


def stability_map(rows: list[Row]) -> Figure:
    """K over b/T: the theory's curves and the points measured, from the rows of part "map"."""
    places = [row for row in rows if row.case.startswith("map/")]
    figure, axes = subplots(7.0, 4.4)
    over = np.geomspace(500, 1e6, 50)  # b/T [N/m]
    delays = sorted({row.values["delay_ticks"] for row in places})
    for delay, shade in zip(delays, ("#222222", "#777777", "#aaaaaa"), strict=False):
        label = f"b / (T/2 + {delay} T)" if delay else "b / (T/2)"
        axes.plot(over, over / (0.5 + delay), color=shade, lw=1.2, label=label)
    for rule in RULE:
        size = 8 if rule == "paper" else 4
        for delay in delays:
            mine = [
                row.values | {"k": row.measured}
                for row in places
                if (row.values["rule"], row.values["delay_ticks"]) == (rule, delay)
            ]
            axes.plot(
                [v["damping_n_s_per_m"] * v["rate_hz"] for v in mine],
                [v["k"] for v in mine],
                MARKS.get(delay, "d"),
                color=RULE[rule],
                markersize=size,
                markerfacecolor="none" if rule == "paper" else RULE[rule],
                label=f"{rule}, {delay} ticks of delay",
            )
    if delays:
        axes.fill_between(over, over / 0.5, 4e6, color=CONTACT, alpha=0.07, lw=0)
        axes.text(1.2e3, 2e5, "unstable whatever the delay", color=CONTACT)
    axes.set(xscale="log", yscale="log", xlim=(500, 1e6), ylim=(100, 2e6))
    axes.set(xlabel="b / T, damping over the tick [N/m]", ylabel="largest stable K [N/m]")
    axes.legend(loc="lower right", ncols=3, fontsize=7)
    return figure


def passivity_plot(rows: list[Row]) -> Figure:
    """Net work less the bound of each random cycle, from the rows of part "passivity"."""
    rows = [row for row in rows if row.case.startswith("passivity/")]
    scenes = list(dict.fromkeys(row.values["scene"] for row in rows))
    figure, axes = subplots(7.0, 3.6)
    for row in rows:
        rule, column = row.values["rule"], scenes.index(row.values["scene"])
        excess = np.array(row.values["excess"])
        spread = np.linspace(-0.14, 0.14, len(excess))
        x = column + (0.2 if rule == "paper" else -0.2) + spread
        axes.plot(x, excess, ".", color=RULE[rule], markersize=4)
    for rule, colour in RULE.items():
        axes.plot([], [], "o", color=colour, label=rule)
    axes.axhline(0.0, color=CONTACT, lw=1.0, label="bound: above it the fixture is active")
    axes.set_yscale("symlog", linthresh=1e-3)
    axes.set_xticks(range(len(scenes)), scenes, rotation=20)
    axes.grid(False, axis="x")
    axes.set_ylabel("(net work on the hand − bound) / stored")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.12), ncols=3)
    return figure
