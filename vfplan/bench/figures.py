"""Work-precision diagrams of a bench: error down, time across, drawn from its JSON alone.

One figure a stage, one panel a scene, one curve a method, one colour a rule. A marker stands at the
median time, its whisker ends at p99.9. The grey staircase is the Pareto front; the white
star is the chosen setting; dotted lines are the tolerance and the budget of a tick.
"""

from __future__ import annotations

from itertools import cycle
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from vfplan.bench.record import LOOKS, SMALLEST_ERROR_M, Record, Records, clouds, grouped
from vfplan.display import Report
from vfplan.figures.style import new_figure, save_png, style, subplots
from vfplan.palette import ERROR, FORCE, RULE, TUBE, WALL

# Number of panels in a row.
COLUMNS = 4

# The smallest error drawn in pixels.
SMALLEST_PX = 1e-4

# The smallest error drawn in micrometres. Below it is rounding.
SMALLEST_UM = 1e6 * SMALLEST_ERROR_M

FRONT_COLOUR = "#c8c8c8"

# The colour of a rule. Its variants, as "robust, 4 iterations", differ by their markers alone.
RULES = {**RULE, "nearest-point penalty": WALL, "nanoflann_peer": ERROR}
# The markers of a rule's variants.
MARKERS = "os^vDPX<>ph"

Look = dict[str, str]

# The star of a chosen setting.
CHOSEN: dict[str, Any] = {"color": "black", "marker": "*", "ms": 12, "mfc": "white", "zorder": 6}


def draw_stage(document: Report, stage: str, path: Path) -> None:
    """The diagram of one stage of a bench document, as a PNG."""
    results = grouped(document["results"], "stage")[stage]
    scenes = grouped(results, "scene")
    looks = looks_of(results)
    columns = min(COLUMNS, len(scenes))
    rows = -(-len(scenes) // columns)
    figure = new_figure(max(5.0, 2.6 * columns + 0.4), 2.5 * rows + 1.1)
    with style():
        panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat

    # A panel a scene; the last row may have fewer.
    slowest = max(place_of(result, stage)[0] for result in results)
    for axes, (scene, scene_results) in zip(panels, scenes.items(), strict=False):
        draw_panel(axes, scene_results, looks, stage, slowest)
        draw_bounds(axes, document, stage)
        axes.set_title(scene, fontsize=8.5)
        axes.set_xlabel(f"median time [{LOOKS[stage].time_unit}]", fontsize=8.5)
        axes.tick_params(labelbottom=True)
        axes.tick_params(which="minor", labelbottom=True, labelsize=6.5)
    for axes in panels[len(scenes) :]:
        axes.remove()
    figure.supylabel(f"RMS error [{'px' if results[0]['unit'] == 'px' else 'µm'}]", fontsize=8.5)

    # A line of the legend for each look, whichever panels have it.
    handles = {}
    for axes in figure.axes:
        drawn, labels = axes.get_legend_handles_labels()
        handles |= dict(zip(labels, drawn, strict=True))
    figure.suptitle(LOOKS[stage].title, x=0.01, ha="left", fontsize=10)
    figure.legend(
        handles.values(), handles, loc="outside lower center", ncols=min(4, 2 + columns),
        fontsize=7.5,
    )  # fmt: skip
    save_png(figure, path)


def draw_summary(document: Report, path: Path) -> None:
    """The chosen setting and each peer as one cloud over all scenes of stage proxy, as a PNG."""
    results = grouped(document["results"], "stage")["proxy"]
    figure, axes = subplots(7.4, 4.6)
    axes.set(xscale="log", yscale="log", xlabel="median time of a tick [µs]",
             ylabel="RMS error of the proxy [µm]")  # fmt: skip
    methods = clouds("proxy", results)
    looks = looks_of([result for result in results if result["method"] in methods])
    for method, records in methods.items():
        look = {"ms": 5, "zorder": 4} | looks.get(method, CHOSEN)
        draw_marks(axes, records, "proxy", ls="", elinewidth=0.5, label=method, **look)
    draw_bounds(axes, document, "proxy")
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=8)
    save_png(figure, path)


def looks_of(results: Records) -> dict[str, Look]:
    """A colour and a marker for each method; a variant of a rule has the rule's colour."""
    spare = cycle((TUBE, FORCE, ERROR, WALL))
    colours = dict(RULES)
    looks = {}
    for method in dict.fromkeys(r["method"] for r in results if not r["chosen"]):
        rule = method.split(", ")[0]
        if rule not in colours:
            colours[rule] = next(spare)
        looks[method] = {"color": colours[rule], "marker": MARKERS[len(looks) % len(MARKERS)]}
    return looks


def draw_panel(
    axes: Axes, results: Records, looks: dict[str, Look], stage: str, slowest: float
) -> None:
    """Draw the results of one scene; `slowest` is where the front's staircase ends."""
    axes.set(xscale="log", yscale="log")

    # A method's settings from the cheapest to the dearest.
    tried = sorted((r for r in results if not r["chosen"]), key=itemgetter("time_us_median"))
    for method, settings in grouped(tried, "method").items():
        draw_marks(axes, settings, stage, capsize=1.5, ms=4, lw=1.0, elinewidth=0.7, zorder=4,
                   label=method, **looks[method])  # fmt: skip

    # The staircase under which nothing was measured.
    front = sorted(place_of(result, stage) for result in results if result["pareto"])
    x, _, error, _ = np.array(front).T
    axes.step(np.r_[x, slowest], np.r_[error, error[-1]], where="post", color=FRONT_COLOUR, lw=4,
              zorder=1, solid_capstyle="butt", label="Pareto front")  # fmt: skip

    # The chosen settings: RMS at the star, the maximum at the end of the line above it.
    for result in results:
        if result["chosen"]:
            x, _, error, largest = place_of(result, stage)
            axes.errorbar(x, error, [[0.0], [largest - error]], capsize=3, ls="", elinewidth=0.8,
                          label="chosen", **CHOSEN)  # fmt: skip


def draw_marks(axes: Axes, records: Records, stage: str, **look: Any) -> None:
    """A mark at the time and error of each record; its whisker ends at p99.9."""
    x, tail, error, _ = np.array([place_of(record, stage) for record in records]).T
    axes.errorbar(x, error, xerr=[0 * x, tail - x], **look)


def draw_bounds(axes: Axes, document: Report, stage: str) -> None:
    """The tolerance where it bounds the errors of a stage, and the time of a tick."""
    if stage in ("sample", "proxy", "plan"):
        tolerance_um = document["tolerance_m"] * 1e6
        axes.axhline(tolerance_um, color="black", ls=":", lw=1.0,
                     label=f"tolerance {tolerance_um:g} µm")  # fmt: skip
    if LOOKS[stage].part == "tick":
        budget_us = document["budget_us"]
        axes.axvline(budget_us, color=WALL, ls=":", lw=1.0, label=f"budget {budget_us:g} µs")


def place_of(result: Record, stage: str) -> tuple[float, float, float, float]:
    """Median time, its p99.9, RMS error and largest error in the units of the diagram."""
    factor = {"ms": 1e-3, "µs": 1.0}[LOOKS[stage].time_unit]
    scale, smallest = {"m": (1e6, SMALLEST_UM), "px": (1.0, SMALLEST_PX)}[result["unit"]]
    errors = [max(scale * result[name], smallest) for name in ("error_rms", "error_max")]
    return factor * result["time_us_median"], factor * result["time_us_p999"], *errors
