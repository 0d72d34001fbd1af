"""What a bench says in a sentence a stage: the chosen setting, its error, its time, and the peers'.

The chosen setting is the one that `vfplan plan` takes without options, or that `--tolerance` leads
to. Ratios to a peer are medians over the scenes that both ran on.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vfplan.bench.record import Record
from vfplan.display import duration, length, three_digits

PEERS = {
    "extract": ("hue + thinning", "mask (the paper's)"),
    "sample": ("the paper's density",),
    "register": ("bare least squares",),
    "proxy": ("paper", "nanoflann_peer", "nearest-point penalty"),
    "plan": ("the paper's: every mask pixel",),
}
"""What a user could take instead, by stage: methods that are not this project's own."""


def is_tick_stage(stage: str) -> bool:
    """Whether the times of a stage are those of a tick of the controller, and not of a call."""
    return stage in ("sample", "proxy")


def error_text(result: Record, key: str = "error_rms") -> str:
    """An error with its unit."""
    return length(result[key]) if result["unit"] == "m" else f"{three_digits(result[key])} px"


def time_text(us: float) -> str:
    """A time given in microseconds, in the unit that suits it."""
    return duration(1e-6 * us)


def summaries(document: dict[str, Any]) -> dict[str, str]:
    """A sentence for each stage of a bench's document that has a chosen setting."""
    # Stage proxy comes last: it is what the controller does a thousand times a second.
    stages = [stage for stage in document["stages"] if stage != "proxy"]
    if "proxy" in document["stages"]:
        stages.append("proxy")
    sentences = {}
    for stage in stages:
        results = [r for r in document["results"] if r["stage"] == stage]
        chosen = {result["scene"]: result for result in results if result.get("chosen")}
        if chosen:
            sentences[stage] = stage_sentence(stage, chosen, results)
    return sentences


def stage_sentence(stage: str, chosen: dict[str, Record], results: list[Record]) -> str:
    """The chosen setting of each scene, its error and its time, against each peer."""
    worst = max(chosen.values(), key=lambda r: r["error_rms"])
    slowest = max(chosen.values(), key=lambda r: r["time_us_median"])
    median_us = float(np.median([r["time_us_median"] for r in chosen.values()]))
    part = "call"
    tail = ""
    if is_tick_stage(stage):
        part = "tick"
        tail_us = max(r["time_us_p999"] for r in chosen.values())
        tail = f" (p99.9 {time_text(tail_us)})"
    sentence = (
        f"{stage}: the chosen setting errs by {error_text(worst)} RMS at most ({worst['scene']}) "
        f"and takes {time_text(median_us)} a {part} at the median of {len(chosen)} scenes, "
        f"{time_text(slowest['time_us_median'])} at most{tail}"
    )
    peers = list(PEERS[stage])
    for result in results:
        if result.get("peer") and result["method"] not in peers:
            peers.append(result["method"])
    comparisons = []
    for peer in peers:
        comparison = compare_with_peer(peer, chosen, results)
        if comparison:
            comparisons.append(comparison)
    if comparisons:
        sentence += f". Against it: {'; '.join(comparisons)}"
    return sentence + "."


def compare_with_peer(method: str, chosen: dict[str, Record], results: list[Record]) -> str:
    """How a peer's best setting compares, scene by scene; empty if it did not run."""
    best: dict[str, Record] = {}
    for result in results:
        scene = result["scene"]
        if result["method"] != method or scene not in chosen:
            continue
        if scene not in best or result["error_rms"] < best[scene]["error_rms"]:
            best[scene] = result
    if not best:
        return ""
    times = []
    for scene, result in best.items():
        times.append(result["time_us_median"] / chosen[scene]["time_us_median"])
    worst = max(best.values(), key=lambda r: r["error_rms"])
    ratio = float(np.median(times))
    speed = f"{three_digits(ratio)} times slower"
    if ratio < 1:
        speed = f"{three_digits(1 / ratio)} times faster"
    return f"{method} is {speed} and errs by {error_text(worst)} RMS at most"
