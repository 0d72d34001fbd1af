"""The results of a bench as a table: a header and a key, and units that a person reads."""

from __future__ import annotations

from typing import Any

from vfplan.bench.summary import error_text, is_tick_stage, time_text
from vfplan.display import length

KEY = (
    "* on the front: nothing on this scene is both faster and nearer to the truth",
    "> the setting that is chosen: a plan's own, or what --tolerance leads to",
)
SHORT_KEY = "Of each method the setting with the least error is listed; -v lists all of them."


def table_lines(
    document: dict[str, Any], stages: list[str], *, every_setting: bool = False
) -> list[str]:
    """A table of each scene, cheapest first, under one header a stage, and the key.

    Parameters
    ----------
    every_setting
        List every setting of a method, and not only the one that errs least.
    """
    lines = []
    for stage in stages:
        results = [r for r in document["results"] if r["stage"] == stage]
        part = "tick" if is_tick_stage(stage) else "call"
        header = table_row(
            "", f"median a {part}", "p99.9", "error RMS", "at most", "method", "settings"
        )
        lines.append(f"{stage}: " + header.strip())
        scenes: dict[str, list[dict[str, Any]]] = {}
        for result in results:
            scenes.setdefault(result["scene"], []).append(result)
        for scene, scene_results in scenes.items():
            lines.append(f"  {scene}")
            if not every_setting:
                scene_results = best_of_each_method(scene_results)
            for result in sorted(scene_results, key=lambda r: r["time_us_median"]):
                lines.append(result_row(result))
    for refusal in document.get("refused", ()):
        if refusal["stage"] in stages:
            settings = settings_text(refusal["settings"])
            lines.append(
                f"refused: {refusal['scene']}: {refusal['method']} {settings}: {refusal['message']}"
            )
    lines += ["", *KEY]
    if not every_setting:
        lines.append(SHORT_KEY)
    return lines


def best_of_each_method(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Of each method the setting that errs least, and every chosen setting."""
    best: dict[str, dict[str, Any]] = {}
    for result in results:
        name = result["method"]
        if name not in best or result["error_rms"] < best[name]["error_rms"]:
            best[name] = result
    return [r for r in results if r.get("chosen") or best[r["method"]] is r]


def result_row(result: dict[str, Any]) -> str:
    """A result as a row of the table."""
    marks = ""
    if result["pareto"]:
        marks += "*"
    else:
        marks += " "
    if result.get("chosen"):
        marks += ">"
    return table_row(
        marks,
        time_text(result["time_us_median"]),
        time_text(result["time_us_p999"]),
        error_text(result),
        error_text(result, "error_max"),
        result["method"],
        settings_text(result["settings"]),
    )


def table_row(
    marks: str, median: str, tail: str, rms: str, largest: str, method: str, settings: str
) -> str:
    """A row: four columns of numbers, then the method and its settings."""
    numbers = f"{median:>14}{tail:>14}{rms:>14}{largest:>14}"
    return f"  {marks:<2}{numbers}  {method:<30}{settings}".rstrip()


def settings_text(settings: dict[str, Any]) -> str:
    """Settings as a person reads them, with their units."""
    parts = []
    for name, value in settings.items():
        if name.endswith("_per_m"):
            parts.append(f"{name.removesuffix('_per_m')} {value / 1e3:.4g}/mm")
        elif name.endswith("_m"):
            parts.append(f"{name.removesuffix('_m')} {length(value)}")
        elif isinstance(value, float):
            parts.append(f"{name}={value:.4g}")
        else:
            parts.append(f"{name}={value}")
    return ", ".join(parts)
