"""Work-precision diagrams of a bench: error down, time across, drawn from its JSON alone.

One figure a stage, one panel a scene, one curve a method, one colour a rule. A marker stands at the
median time, its whisker ends at p99.9. The grey staircase is the Pareto front; the star is the
chosen setting; dotted lines are the tolerance and the budget of a tick.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from vfplan.figures.style import new_figure, save_png, style
from vfplan.palette import BRIDGED, CONTACT, FORCE, HIP, PROXY, RULE

COLUMNS = 4
TITLES = {
    "extract": "extract: the drawn line, one call a slice",
    "sample": "sample: surface of the cloud, one tick of the engine on it",
    "register": "register: target registration error, one fit",
    "proxy": "proxy: against the exact proxy, one tick",
    "plan": "plan: slice and markers to fixture, one call",
}
TICK_STAGES = ("sample", "proxy")  # their time is that of a tick: the 1 ms budget applies
SCALE = {"px": (1.0, "px"), "m": (1e6, "µm")}
FLOOR = {"px": 1e-4, "m": 1e-3}
"""The smallest error drawn [px, µm]: a nanometre. Below it is rounding."""
RULES = {
    "robust": RULE["robust"],
    "paper": RULE["paper"],
    "exact": RULE["exact"],
    "nearest-point penalty": CONTACT,
    "nanoflann_peer": PROXY,
    "ridge": RULE["robust"],
    "by curvature": RULE["robust"],
    "affine": RULE["robust"],
    "hue + thinning": CONTACT,
    "bare least squares": CONTACT,
    "the paper's density": RULE["paper"],
    "the paper's: every mask pixel": RULE["paper"],
    "mask (the paper's)": RULE["paper"],
}
"""The colour of a rule. Its variants, as "robust, 4 iterations", differ by their markers alone."""
_MARKERS = "os^vDPX<>ph"


def draw_stage(document: dict[str, Any], stage: str, path: Path) -> None:
    """The diagram of one stage of a bench document, as a PNG."""
    save_png(diagram(document, stage), path)


def diagram(document: dict[str, Any], stage: str) -> Figure:
    """The figure of `draw_stage`."""
    results = [r for r in document["results"] if r["stage"] == stage]
    scenes = list(dict.fromkeys(r["scene"] for r in results))
    looks = dict(_looks(list(dict.fromkeys(r["method"] for r in results if not r.get("chosen")))))
    columns = min(COLUMNS, len(scenes))
    rows = -(-len(scenes) // columns)
    figure = new_figure(max(5.0, 2.6 * columns + 0.4), 2.5 * rows + 1.1)
    with style():
        panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes, scene in zip(panels.flat, scenes, strict=False):
        _panel(axes, [r for r in results if r["scene"] == scene], looks, document, stage)
        axes.set_title(scene, fontsize=8.5)
    for axes in list(panels.flat)[len(scenes) :]:
        axes.remove()
    for k in range(columns):
        lowest = panels[(len(scenes) - 1 - k) // columns, k]
        lowest.set_xlabel(f"median time [{_clock(stage)[1]}]", fontsize=8.5)
        lowest.tick_params(labelbottom=True)
    for axes in panels[:, 0]:
        axes.set_ylabel(f"RMS error [{SCALE[results[0]['unit']][1]}]", fontsize=8.5)
    _limits(panels[0, 0], results, document, stage)
    figure.suptitle(TITLES.get(stage, stage), x=0.01, ha="left", fontsize=10)
    figure.legend(
        handles=_legend(looks, document, stage, results),
        loc="outside lower center",
        ncols=min(4, 2 + columns),
        fontsize=7.5,
    )
    return figure


def _looks(methods: list[str]) -> Iterator[tuple[str, tuple[str, str]]]:
    """A colour and a marker for each method."""
    spare = cycle((HIP, PROXY, FORCE))
    colours: dict[str, str] = {}
    variants: dict[str, int] = {}
    for method in methods:
        rule = method if method in RULES else method.split(",")[0].split(" in ")[0]
        if rule not in colours:
            colours[rule] = RULES.get(rule) or next(spare)
        number = variants.get(rule, 0)
        variants[rule] = number + 1
        yield method, (colours[rule], _MARKERS[number % len(_MARKERS)])


def _panel(
    axes: Axes, results: list[dict[str, Any]], looks: dict, document: dict[str, Any], stage: str
) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(NullFormatter())
    _front(axes, results, stage)
    for method, (colour, marker) in looks.items():
        own = [r for r in results if r["method"] == method and not r.get("chosen")]
        _curve(axes, own, colour, marker, stage)
    for r in results:
        if r.get("chosen"):
            _star(axes, r, stage)
    if results[0]["unit"] == "m" and stage != "register":
        axes.axhline(document["tolerance_m"] * 1e6, color="black", ls=":", lw=1.0)
    if stage in TICK_STAGES:
        axes.axvline(document["budget_us"] * _clock(stage)[0], color=CONTACT, ls=":", lw=1.0)


def _clock(stage: str) -> tuple[float, str]:
    """Factor from microseconds, and the unit's name."""
    return (1e-3, "ms") if stage in ("extract", "plan") else (1.0, "µs")


def _place(result: dict[str, Any], stage: str, error: str = "error_rms") -> tuple[float, float]:
    unit = result["unit"]
    across = result["time_us_median"] * _clock(stage)[0]
    return across, max(result[error] * SCALE[unit][0], FLOOR[unit])


def _star(axes: Axes, result: dict[str, Any], stage: str) -> None:
    """The chosen settings: RMS at the star, the maximum at the end of the line above it."""
    (x, y), (_, top) = _place(result, stage), _place(result, stage, "error_max")
    axes.plot([x, x], [y, top], "-", color="black", lw=0.8, zorder=5)
    axes.plot([x], [top], "_", color="black", ms=6, zorder=5)
    axes.plot([x], [y], "*", ms=12, mfc=BRIDGED, mec="black", mew=0.8, zorder=6)


def _curve(axes: Axes, results: list[dict[str, Any]], colour: str, marker: str, stage: str) -> None:
    """A method's settings from the cheapest to the dearest, each with its p99.9 as a whisker."""
    if not results:
        return
    results = sorted(results, key=lambda r: r["time_us_median"])
    x, y = np.array([_place(r, stage) for r in results]).T
    factor = _clock(stage)[0]
    tail = factor * np.array([r.get("time_us_p999", r["time_us_median"]) for r in results]) - x
    axes.errorbar(
        x, y, xerr=[np.zeros_like(tail), np.maximum(tail, 0)], capsize=1.5, color=colour,
        marker=marker, ms=4, lw=1.0, elinewidth=0.7, zorder=4,
    )  # fmt: skip


def _front(axes: Axes, results: list[dict[str, Any]], stage: str) -> None:
    """The staircase under which nothing was measured."""
    corners = sorted(_place(r, stage) for r in results if r["pareto"])
    if not corners:
        return
    x, y = np.array(corners).T
    axes.step(
        np.r_[x, x[-1] * 1e6], np.r_[y, y[-1]], where="post", color="#c8c8c8", lw=4, zorder=1,
        solid_capstyle="butt",
    )  # fmt: skip


def _limits(axes: Axes, results: list[dict[str, Any]], document: dict, stage: str) -> None:
    """All panels share one window: every result, the tolerance and the budget, with a margin."""
    x, y = np.array([_place(r, stage) for r in results]).T
    top = max(_place(r, stage, "error_max" if r.get("chosen") else "error_rms")[1] for r in results)
    tails = [r.get("time_us_p999", r["time_us_median"]) * _clock(stage)[0] for r in results]
    ends = [x.min(), max(x.max(), *tails)]
    if stage in TICK_STAGES:
        ends.append(document["budget_us"])
    levels = [y.min(), top]
    if results[0]["unit"] == "m" and stage != "register":
        levels.append(document["tolerance_m"] * 1e6)
    for set_limits, values in ((axes.set_xlim, ends), (axes.set_ylim, levels)):
        low, high = np.log10(min(values)), np.log10(max(values))
        spare = max(0.08 * (high - low), 0.5 * (1 - (high - low)), 0.05)
        set_limits(10 ** (low - spare), 10 ** (high + spare))


def _legend(
    looks: dict, document: dict[str, Any], stage: str, results: list[dict[str, Any]]
) -> list[Line2D]:
    handles = [
        Line2D([], [], color=colour, marker=marker, ms=4, lw=1.0, label=method)
        for method, (colour, marker) in looks.items()
    ]
    handles.append(Line2D([], [], color="#c8c8c8", lw=4, label="Pareto front"))
    if any(r.get("chosen") for r in results):
        star = {"ls": "", "marker": "*", "ms": 11, "mfc": BRIDGED, "mec": "black"}
        handles.append(Line2D([], [], label="chosen", **star))
    if results[0]["unit"] == "m" and stage != "register":
        label = f"tolerance {document['tolerance_m'] * 1e6:g} µm"
        handles.append(Line2D([], [], color="black", ls=":", label=label))
    if stage in TICK_STAGES:
        label = f"budget {document['budget_us']:g} µs"
        handles.append(Line2D([], [], color=CONTACT, ls=":", label=label))
    return handles
