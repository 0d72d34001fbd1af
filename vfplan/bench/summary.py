"""What a bench says in a sentence a stage: the chosen setting, its error, its time, and the peers'.

The chosen setting is the one that `vfplan plan` takes without options, or that `--tolerance` leads
to. Ratios to a peer are medians over the scenes that both ran on.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vfplan.bench.record import Record
from vfplan.display import duration, length, three_digits

# What a user could take instead, by stage: methods that are not this project's own.
PEERS = {
    "extract": ("hue + thinning", "mask (the paper's)"),
    "sample": ("the paper's density",),
    "register": ("bare least squares",),
    "proxy": ("paper", "nanoflann_peer", "nearest-point penalty"),
    "plan": ("the paper's: every mask pixel",),
}


def is_tick_stage(stage: str) -> bool:
    """Whether the times of a stage are those of a tick of the controller, and not of a call."""
    return stage in ("sample", "proxy")


def error_text(result: Record, key: str = "error_rms") -> str:
    """An error with its unit."""
    if result["unit"] == "m":
        return length(result[key])
    return f"{three_digits(result[key])} px"


def time_text(us: float) -> str:
    """A time given in microseconds, in the unit that suits it."""
    return duration(1e-6 * us)


def summaries(document: dict[str, Any]) -> dict[str, str]:
    """A sentence for each stage of a bench's document that has a chosen setting."""
    found = {}
    # Stage proxy comes last: it is what the controller does a thousand times a second.
    for stage in sorted(document["stages"], key=lambda stage: stage == "proxy"):
        results = [r for r in document["results"] if r["stage"] == stage]
        if any(r.get("chosen") for r in results):
            found[stage] = _summary(stage, results)
    return found


def _summary(stage: str, results: list[Record]) -> str:
    chosen = {r["scene"]: r for r in results if r.get("chosen")}
    worst = max(chosen.values(), key=lambda r: r["error_rms"])
    slowest = max(chosen.values(), key=lambda r: r["time_us_median"])
    median_us = float(np.median([r["time_us_median"] for r in chosen.values()]))
    what = "tick" if stage in ("sample", "proxy") else "call"
    sentence = (
        f"{stage}: the chosen setting errs by {error_text(worst)} RMS at most ({worst['scene']}) "
        f"and takes {time_text(median_us)} a {what} at the median of {len(chosen)} scenes, "
        f"{time_text(slowest['time_us_median'])} at most"
    )
    if what == "tick":
        tail = max(r["time_us_p999"] for r in chosen.values())
        sentence += f" (p99.9 {time_text(tail)})"
    others = list(PEERS[stage])
    others += sorted({r["method"] for r in results if r.get("peer")} - set(others))
    against = [_against(name, chosen, results) for name in others]
    told = "; ".join(text for text in against if text)
    if told:
        sentence += f". Against it: {told}"
    return sentence + "."


def _against(method: str, chosen: dict[str, Record], results: list[Record]) -> str:
    """How a peer's best setting compares, scene by scene; empty if it did not run."""
    times, errors = [], []
    for scene, own in chosen.items():
        theirs = [r for r in results if r["method"] == method and r["scene"] == scene]
        if theirs:
            best = min(theirs, key=lambda r: r["error_rms"])
            times.append(best["time_us_median"] / own["time_us_median"])
            errors.append(best)
    if not times:
        return ""
    worst = max(errors, key=lambda r: r["error_rms"])
    ratio = float(np.median(times))
    if ratio >= 1:
        speed = f"{three_digits(ratio)} times slower"
    else:
        speed = f"{three_digits(1 / ratio)} times faster"
    return f"{method} is {speed} and errs by {error_text(worst)} RMS at most"
