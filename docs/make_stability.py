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
from vfplan.palette import CONTACT, RULE
from vfplan.robot import Robot
from vfplan.stability.contacts import patch
from vfplan.stability.largest import engine_for, largest_stiffness

DOCS = Path(__file__).resolve().parent
PAGE = DOCS / "stability.md"


def number(value: float | None) -> str:
    """Three digits; a dash where there is none."""
    return "–" if value is None else f"{value:.3g}"


def loops(cases: list[dict]) -> list[str]:
    """The closed loop: one line a scene."""
    lines = [
        "| scene | rule | largest stable K [N/m] | of the exact bound | overshoot |"
        " at rest after [s] | limit cycle [µm] | work on the hand [µJ] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for c in cases:
        if c["case"].startswith("closed-loop/"):
            lines.append(
                f"| {c['scene']} | {c['rule']} | {c['measured']:.0f} | {c['ratio']:.4f} |"
                f" {c['overshoot']:.2f} | {number(c['rest_s'])} | {c['limit_cycle_m'] * 1e6:.2f} |"
                f" {c['energy_j'] * 1e6:.1f} |"
            )
    return lines


def passivity(cases: list[dict]) -> list[str]:
    """Passivity and receding: one line a scene and rule."""
    recede = {c["case"].partition("/")[2]: c for c in cases if c["case"].startswith("recede/")}
    lines = [
        "| scene | rule | active cycles | largest (work − bound) / stored |"
        " receded in a tick [bands] |",
        "|---|---|---|---|---|",
    ]
    for c in cases:
        if c["case"].startswith("passivity/"):
            r = recede[c["case"].partition("/")[2]]
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
        expected, _, found = c["detail"].removeprefix("expected ").partition("; ")
        found = found if len(found) < 90 else found[:87] + "..."
        lines.append(f"| {name.replace('/', ': ', 1)} | {expected} | {found} | {c['outcome']} |")
    return lines


def main(folder: Path) -> None:
    """Rewrite the page between its markers."""
    cases = json.loads((folder / "stability.json").read_text("utf-8"))["cases"]
    page = PAGE.read_text("utf-8")
    for name, made in (("loops", loops), ("passivity", passivity), ("extremes", extremes)):
        block = f"<!-- {name} -->\n" + "\n".join(made(cases)) + f"\n<!-- end {name} -->"
        old = re.compile(f"<!-- {name} -->.*?<!-- end {name} -->", re.DOTALL)
        page = old.sub(lambda _, block=block: block, page)
    PAGE.write_text(page, "utf-8")
    shutil.copyfile(folder / "passivity.png", DOCS / "pictures" / "passivity.png")
    save_png(stability_map(), DOCS / "pictures" / "stability_map.png")


# Damping [N·s/m] and rate [Hz] of the places measured, and each delay in ticks with its mark.
PLACES = ((2.0, 500.0), (5.0, 1000.0), (10.0, 2000.0), (40.0, 2000.0), (50.0, 8000.0))
MARKS = {0: "o", 1: "s", 3: "^"}


def stability_map() -> Figure:
    """K over b/T: the theory's lines, and what is measured on a flat wall."""
    figure, axes = subplots(7.0, 4.4)
    over = np.geomspace(500, 1e6, 50)  # b/T [N/m]
    for delay, shade in zip(MARKS, ("#222222", "#777777", "#aaaaaa"), strict=True):
        label = f"b / (T/2 + {delay} T)" if delay else "b / (T/2)"
        axes.plot(over, over / (0.5 + delay), color=shade, lw=1.2, label=label)
    for rule, size, filled in (("paper", 8, "none"), ("robust", 4, RULE["robust"])):
        for delay, mark in MARKS.items():
            robots = [Robot("chart", 1.0, damping, rate, delay) for damping, rate in PLACES]
            borne = [largest_stiffness(patch(), r, engine_for(patch(), rule)) for r in robots]
            look = {"color": RULE[rule], "markersize": size, "markerfacecolor": filled}
            label = f"{rule}, {delay} ticks of delay"
            bT = [damping * rate for damping, rate in PLACES]
            axes.plot(bT, [b.measured for b in borne], mark, label=label, **look)
    axes.fill_between(over, over / 0.5, 4e6, color=CONTACT, alpha=0.07, lw=0)
    axes.text(1.2e3, 2e5, "unstable whatever the delay", color=CONTACT)
    axes.set(xscale="log", yscale="log", xlim=(500, 1e6), ylim=(100, 2e6))
    axes.set(xlabel="b / T, damping over the tick [N/m]", ylabel="largest stable K [N/m]")
    axes.legend(loc="lower right", ncols=3, fontsize=7)
    return figure


if __name__ == "__main__":
    main(Path(sys.argv[1]))
