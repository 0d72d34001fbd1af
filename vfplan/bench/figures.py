"""Work-precision diagrams of a bench: error down, time across, drawn from its JSON alone.

One figure a stage, one panel a scene, one curve a method, one colour a rule. A marker stands at the
median time, its whisker ends at p99.9. The grey staircase is the Pareto front; the white
star is the chosen setting; dotted lines are the tolerance and the budget of a tick.
"""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from vfplan.bench.record import LOOKS, SMALLEST_ERROR_M, clouds, grouped
from vfplan.figures.style import new_figure, save_png, style, subplots
from vfplan.palette import CONTACT, FORCE, HIP, PROXY, RULE

# Number of panels in a row.
COLUMNS = 4

# The smallest error drawn in pixels.
SMALLEST_PX = 1e-4

# The smallest error drawn in micrometres. Below it is rounding.
SMALLEST_UM = 1e6 * SMALLEST_ERROR_M

FRONT_COLOUR = "#c8c8c8"

# The colour of a rule. Its variants, as "robust, 4 iterations", differ by their markers alone.
RULES = {
    "robust": RULE["robust"], "paper": RULE["paper"], "exact": RULE["exact"],
    "nearest-point penalty": CONTACT, "nanoflann_peer": PROXY, "ridge": RULE["robust"],
    "by curvature": RULE["robust"], "affine": RULE["robust"], "hue + thinning": CONTACT,
    "bare least squares": CONTACT, "the paper's density": RULE["paper"],
    "the paper's: every mask pixel": RULE["paper"], "mask (the paper's)": RULE["paper"],
}  # fmt: skip
# The markers of a rule's variants.
MARKERS = "os^vDPX<>ph"

Look = tuple[str, str]


def draw_stage(document: dict[str, Any], stage: str, path: Path) -> None:
    """The diagram of one stage of a bench document, as a PNG."""
    results = [result for result in document["results"] if result["stage"] == stage]
    scenes = grouped(results, "scene")
    looks = looks_of(results)
    columns = min(COLUMNS, len(scenes))
    rows = -(-len(scenes) // columns)
    figure = new_figure(max(5.0, 2.6 * columns + 0.4), 2.5 * rows + 1.1)
    with style():
        panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)

    # A panel a scene; the last row may have fewer.
    for axes, (scene, scene_results) in zip(panels.flat, scenes.items(), strict=False):
        draw_panel(axes, scene_results, looks, document, stage)
        axes.set_title(scene, fontsize=8.5)
    for axes in list(panels.flat)[len(scenes) :]:
        axes.remove()
    for k in range(columns):
        lowest = panels[(len(scenes) - 1 - k) // columns, k]
        lowest.set_xlabel(f"median time [{LOOKS[stage].time_unit}]", fontsize=8.5)
        lowest.tick_params(labelbottom=True)
    error_unit = "px" if results[0]["unit"] == "px" else "µm"
    for axes in panels[:, 0]:
        axes.set_ylabel(f"RMS error [{error_unit}]", fontsize=8.5)
    set_limits(panels[0, 0], results, document, stage)
    figure.suptitle(LOOKS[stage].title, x=0.01, ha="left", fontsize=10)
    figure.legend(
        handles=legend_handles(looks, document, stage, results),
        loc="outside lower center",
        ncols=min(4, 2 + columns),
        fontsize=7.5,
    )
    save_png(figure, path)


def draw_summary(document: dict[str, Any], path: Path) -> None:
    """The chosen setting and each peer as one cloud over all scenes of stage proxy, as a PNG."""
    results = [result for result in document["results"] if result["stage"] == "proxy"]
    figure, axes = subplots(7.4, 4.6)
    axes.set(xscale="log", yscale="log", xlabel="median time of a tick [µs]",
             ylabel="RMS error of the proxy [µm]")  # fmt: skip
    spare = cycle(zip((HIP, FORCE, PROXY, CONTACT), "^vXP", strict=True))
    for method, records in clouds("proxy", results).items():
        x, y = np.array([place_of(record, "proxy") for record in records]).T
        tails = np.maximum([tail_us(record) for record in records] - x, 0.0)
        if method == "chosen":
            look = {"color": "black", "marker": "*", "ms": 13, "mfc": "white", "zorder": 6}
        else:
            colour, marker = (RULES[method], "o") if method in RULES else next(spare)
            look = {"color": colour, "marker": marker, "ms": 5, "zorder": 4}
        axes.errorbar(x, y, xerr=[0 * x, tails], ls="", elinewidth=0.5, label=method, **look)
    axes.axhline(document["tolerance_m"] * 1e6, color="black", ls=":", lw=1.0, label="tolerance")
    axes.axvline(document["budget_us"], color=CONTACT, ls=":", lw=1.0, label="1 kHz")
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=8)
    save_png(figure, path)


def looks_of(results: list[dict[str, Any]]) -> dict[str, Look]:
    """A colour and a marker for each method: one colour a rule, one marker a variant."""
    spare_colours = cycle((HIP, PROXY, FORCE))
    colours: dict[str, str] = {}
    variants: dict[str, int] = {}
    looks: dict[str, Look] = {}
    for result in results:
        method = result["method"]
        if result.get("chosen") or method in looks:
            continue
        rule = method.split(",")[0].split(" in ")[0] if method not in RULES else method
        if rule not in colours:
            colours[rule] = RULES.get(rule) or next(spare_colours)
            variants[rule] = 0
        looks[method] = (colours[rule], MARKERS[variants[rule] % len(MARKERS)])
        variants[rule] += 1
    return looks


def draw_panel(
    axes: Axes,
    results: list[dict[str, Any]],
    looks: dict[str, Look],
    document: dict[str, Any],
    stage: str,
) -> None:
    """Draw the results of one scene."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(NullFormatter())

    # The staircase under which nothing was measured.
    corners = sorted(place_of(result, stage) for result in results if result["pareto"])
    if corners:
        x, y = np.array(corners).T
        axes.step(np.r_[x, x[-1] * 1e6], np.r_[y, y[-1]], where="post", color=FRONT_COLOUR, lw=4,
                  zorder=1, solid_capstyle="butt")  # fmt: skip

    # A method's settings from the cheapest to the dearest, each with its p99.9 as a whisker.
    factor = time_factor(stage)
    for method, (colour, marker) in looks.items():
        settings = [r for r in results if r["method"] == method and not r.get("chosen")]
        if not settings:
            continue
        settings.sort(key=lambda result: result["time_us_median"])
        x, y = np.array([place_of(result, stage) for result in settings]).T
        tails = np.array([factor * tail_us(result) for result in settings]) - x
        whiskers = [0 * x, np.maximum(tails, 0.0)]
        axes.errorbar(x, y, xerr=whiskers, capsize=1.5, color=colour, marker=marker, ms=4, lw=1.0,
                      elinewidth=0.7, zorder=4)  # fmt: skip

    # The chosen settings: RMS at the star, the maximum at the end of the line above it.
    for result in results:
        if result.get("chosen"):
            x, y = place_of(result, stage)
            top = place_of(result, stage, "error_max")[1]
            axes.plot([x, x], [y, top], "-", color="black", lw=0.8, zorder=5)
            axes.plot([x], [top], "_", color="black", ms=6, zorder=5)
            axes.plot([x], [y], "*", ms=12, mfc="white", mec="black", mew=0.8, zorder=6)

    if has_tolerance(stage, results):
        axes.axhline(document["tolerance_m"] * 1e6, color="black", ls=":", lw=1.0)
    if LOOKS[stage].part == "tick":
        axes.axvline(document["budget_us"] * factor, color=CONTACT, ls=":", lw=1.0)


def time_factor(stage: str) -> float:
    """Factor from microseconds to the unit of the diagram."""
    if LOOKS[stage].time_unit == "ms":
        return 1e-3
    return 1.0


def place_of(result: dict[str, Any], stage: str, error: str = "error_rms") -> tuple[float, float]:
    """Time and error of a result in the units of the diagram."""
    x = result["time_us_median"] * time_factor(stage)
    if result["unit"] == "m":
        return x, max(result[error] * 1e6, SMALLEST_UM)
    return x, max(result[error], SMALLEST_PX)


def tail_us(result: dict[str, Any]) -> float:
    """The p99.9 of a result's times [µs]; its median where a document has none."""
    return result.get("time_us_p999", result["time_us_median"])


def has_tolerance(stage: str, results: list[dict[str, Any]]) -> bool:
    """Whether the tolerance bounds the errors of a stage."""
    return stage != "register" and results[0]["unit"] == "m"


def set_limits(
    axes: Axes, results: list[dict[str, Any]], document: dict[str, Any], stage: str
) -> None:
    """All panels share one window: every result, the tolerance and the budget, with a margin."""
    factor = time_factor(stage)
    times, errors = [], []
    for result in results:
        x, y = place_of(result, stage)
        times += [x, factor * tail_us(result)]
        errors.append(y)
        if result.get("chosen"):
            errors.append(place_of(result, stage, "error_max")[1])
    if LOOKS[stage].part == "tick":
        times.append(document["budget_us"])
    if has_tolerance(stage, results):
        errors.append(document["tolerance_m"] * 1e6)
    for set_limit, values in ((axes.set_xlim, times), (axes.set_ylim, errors)):
        low, high = np.log10(min(values)), np.log10(max(values))
        padding = max(0.08 * (high - low), 0.5 * (1 - (high - low)), 0.05)
        set_limit(10 ** (low - padding), 10 ** (high + padding))


def legend_handles(
    looks: dict[str, Look],
    document: dict[str, Any],
    stage: str,
    results: list[dict[str, Any]],
) -> list[Line2D]:
    """The entries of the legend."""
    handles = [
        Line2D([], [], color=colour, marker=marker, ms=4, lw=1.0, label=method)
        for method, (colour, marker) in looks.items()
    ]
    handles.append(Line2D([], [], color=FRONT_COLOUR, lw=4, label="Pareto front"))
    if any(result.get("chosen") for result in results):
        handles.append(
            Line2D([], [], ls="", marker="*", ms=11, mfc="white", mec="black", label="chosen")
        )
    if has_tolerance(stage, results):
        label = f"tolerance {document['tolerance_m'] * 1e6:g} µm"
        handles.append(Line2D([], [], color="black", ls=":", label=label))
    if LOOKS[stage].part == "tick":
        label = f"budget {document['budget_us']:g} µs"
        handles.append(Line2D([], [], color=CONTACT, ls=":", label=label))
    return handles
