"""Fill the tables and pictures of docs/stability.md from the folder of a full study; draw the map.

vfplan stability --full -o DIR; python docs/make_stability.py DIR
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from vfplan.figures.style import save_png, subplots
from vfplan.palette import FORCE, RULE, WALL
from vfplan.robot import Robot
from vfplan.stability.closed_loop import engine_for, largest_stiffness
from vfplan.stability.contacts import patch

DOCS = Path(__file__).resolve().parent
PAGE = DOCS / "stability.md"


def number(value: float | None) -> str:
    """Three digits; a dash where there is none."""
    if value is None:
        return "–"
    return f"{value:.3g}"


def loops(cases: list[dict]) -> list[str]:
    """The closed loop: one line a scene."""
    lines = [
        "| scene | rule | largest stable K [N/m] | of the exact bound | overshoot |"
        " at rest after [s] | limit cycle [µm] | work on the hand [µJ] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for c in cases:
        if c["case"].startswith("closed-loop/") and "scene" in c:
            lines.append(
                f"| {c['scene']} | {c['rule']} | {c['measured']:.0f} | {c['ratio']:.4f} |"
                f" {c['overshoot']:.2f} | {number(c['rest_s'])} | {c['limit_cycle_m'] * 1e6:.2f} |"
                f" {c['energy_j'] * 1e6:.1f} |"
            )
    return lines


def passivity(cases: list[dict]) -> list[str]:
    """Passivity and receding: one line a scene and rule."""
    receding = {}
    for c in cases:
        kind, _, name = c["case"].partition("/")
        if kind == "recede":
            receding[name] = c
    lines = [
        "| scene | rule | active cycles | largest (work − bound) / stored |"
        " receded in a tick [bands] |",
        "|---|---|---|---|---|",
    ]
    for c in cases:
        if c["case"].startswith("passivity/"):
            r = receding[c["case"].partition("/")[2]]
            lines.append(
                f"| {c['scene']} | {c['rule']} | {c['active_cycles']} of {c['cycles']} |"
                f" {c['measured']:+.2g} | {r['measured'] / r['limit']:.2f} |"
            )
    return lines


def extremes(cases: list[dict]) -> list[str]:
    """Extreme cases: expected and found."""
    lines = ["| case | expected | found | outcome |", "|---|---|---|---|"]
    for c in cases:
        kind, _, name = c["case"].partition("/")
        if kind != "extreme":
            continue
        expected, _, measured = c["detail"].removeprefix("expected ").partition("; ")
        if len(measured) >= 90:
            measured = measured[:87] + "..."
        lines.append(f"| {name.replace('/', ': ', 1)} | {expected} | {measured} | {c['outcome']} |")
    return lines


def main(folder: Path) -> None:
    """Rewrite the page between its markers."""
    cases = json.loads((folder / "stability.json").read_text("utf-8"))["cases"]
    page = PAGE.read_text("utf-8")
    page = with_table(page, "loops", loops(cases))
    page = with_table(page, "passivity", passivity(cases))
    page = with_table(page, "extremes", extremes(cases))
    PAGE.write_text(page, "utf-8")
    shutil.copyfile(folder / "passivity.png", DOCS / "pictures" / "passivity.png")
    save_png(stability_map(), DOCS / "pictures" / "stability_map.png")


def with_table(page: str, name: str, lines: list[str]) -> str:
    """The page with a table in its place."""
    block = f"<!-- {name} -->\n" + "\n".join(lines) + f"\n<!-- end {name} -->"
    place = re.compile(f"<!-- {name} -->.*?<!-- end {name} -->", re.DOTALL)
    return place.sub(lambda _: block, page)


ROBOTS = ((2.0, 500.0), (5.0, 1000.0), (10.0, 2000.0), (40.0, 2000.0), (50.0, 8000.0))
"""Damping [N·s/m] and control rate [Hz] of the robots on the map."""

DELAYS = {0: "no delay", 1: "1 tick", 3: "3 ticks"}
"""The delays of the map in ticks, and what the picture calls them."""


MAX_DAMPING_OVER_TICK = 1e6
"""Right border of the map [N/m], above the stiffest of the robots."""


def stability_map() -> Figure:
    """Largest stable K over b/T on a flat wall: the linear bound, and what was measured."""
    figure, axes = subplots(7.0, 4.2)
    damping_over_tick = np.geomspace(500, MAX_DAMPING_OVER_TICK, 50)
    for delay, name in DELAYS.items():
        bound = damping_over_tick / (0.5 + delay)
        axes.plot(damping_over_tick, bound, color=FORCE, linewidth=1.0)
        at_border = MAX_DAMPING_OVER_TICK / (0.5 + delay)
        axes.annotate(name, (MAX_DAMPING_OVER_TICK, at_border), (5, 0), va="center",
                      textcoords="offset points", annotation_clip=False)  # fmt: skip
    axes.plot([], [], color=FORCE, linewidth=1.0, label="linear bound b / (T/2 + delay)")
    for rule in ("paper", "robust"):
        x = []
        measured = []
        for delay in DELAYS:
            for damping, rate in ROBOTS:
                robot = Robot("map", 1.0, damping, rate, delay)
                x.append(damping * rate)
                measured.append(largest_stiffness(patch(), robot, engine_for(patch(), rule))[0])
        if rule == "paper":
            axes.plot(x, measured, "o", color=RULE[rule], markersize=9, markerfacecolor="none",
                      label="measured, rule paper")  # fmt: skip
        else:
            axes.plot(x, measured, "o", color=RULE[rule], markersize=4,
                      label="measured, rule robust")  # fmt: skip
    axes.fill_between(
        damping_over_tick, damping_over_tick / 0.5, 4e6, color=WALL, alpha=0.07, linewidth=0
    )
    axes.text(1.2e3, 3e5, "unstable, whatever the delay", color=WALL)
    axes.set(xscale="log", yscale="log", xlim=(500, MAX_DAMPING_OVER_TICK), ylim=(100, 2e6))
    axes.set(xlabel="damping b over the tick T [N/m]", ylabel="largest stable K [N/m]")
    axes.legend(loc="lower right")
    return figure


if __name__ == "__main__":
    main(Path(sys.argv[1]))
