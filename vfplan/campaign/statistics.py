"""Probabilities, quantiles and margins from trials, each with its 95 % interval."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfplan.registration.error import PROBABILITY

Array = NDArray[np.float64]


def clopper_pearson(hits: int, trials: int) -> tuple[float, float]:
    """The exact interval of the probability of an event that `hits` of `trials` had.

    C. J. Clopper, E. S. Pearson, Biometrika 26, 1934, 404-413.
    """
    from scipy.special import betaincinv

    tail = (1 - PROBABILITY) / 2
    low = float(betaincinv(hits, trials - hits + 1, tail)) if hits > 0 else 0.0
    high = float(betaincinv(hits + 1, trials - hits, 1 - tail)) if hits < trials else 1.0
    return low, high


def quantile(sorted_values: Array, q: float) -> dict[str, float | None]:
    """A quantile with its interval from order statistics; an end that no trial bounds is `None`.

    H. A. David, H. N. Nagaraja, Order Statistics, 3rd edition, Wiley 2003, 7.1.
    """
    from scipy.stats import binom

    count = len(sorted_values)
    tail = (1 - PROBABILITY) / 2
    index = min(count - 1, max(0, int(np.ceil(q * count)) - 1))
    low_index = int(binom.ppf(tail, count, q)) - 1
    high_index = int(binom.ppf(1 - tail, count, q))
    low = float(sorted_values[low_index]) if low_index >= 0 else None
    high = float(sorted_values[high_index]) if high_index < count else None
    return {"value": float(sorted_values[index]), "low": low, "high": high}


def entering(depth: Array, beyond_m: list[float]) -> list[dict[str, float]]:
    """How probable it is to go further than each of `beyond_m` beyond the true curve."""
    entries = []
    for beyond in beyond_m:
        hits = int((depth > beyond).sum())
        low, high = clopper_pearson(hits, len(depth))
        entries.append(
            {"beyond_mm": 1e3 * beyond, "p": hits / len(depth), "low": low, "high": high}
        )
    return entries


def margins(
    depth: Array, probabilities: list[float], share: float
) -> list[dict[str, float | None]]:
    """The margin [mm] that makes entering less probable than each of the probabilities.

    A margin moves the rendered surface outwards, and the tool by `share` = K / (K + k_h) of that.
    So the margin for p is the (1 - p) quantile of the depth over this share, not less than 0.
    """
    ordered = np.sort(depth)
    entries: list[dict[str, float | None]] = []
    for probability in probabilities:
        entry: dict[str, float | None] = {"p": probability}
        for name, depth_m in quantile(ordered, 1 - probability).items():
            key = "margin_mm" if name == "value" else name
            entry[key] = None
            if depth_m is not None:
                entry[key] = 1e3 * max(0.0, depth_m) / share
        entries.append(entry)
    return entries


def summary(
    question: dict[str, Any],
    table: dict[str, Array],
    beyond_m: list[float],
    probabilities: list[float],
) -> dict[str, Any]:
    """What `vfplan campaign --json` says of the question and the trials of `read_campaign`."""
    depth = table["depth_m"]
    ordered = np.sort(depth)
    quantiles_mm = {}
    for q in (0.5, 0.9, 0.95, 0.99):
        entry: dict[str, float | None] = {}
        for name, depth_m in quantile(ordered, q).items():
            entry[name] = None
            if depth_m is not None:
                entry[name] = 1e3 * depth_m
        quantiles_mm[f"{q:g}"] = entry
    return {
        "trials": len(depth),
        "trials_in_contact": int((table["point"] >= 0).sum()),
        "settings": question["settings"],
        "p_enter": entering(depth, beyond_m),
        "margin_for": margins(depth, probabilities, question["share"]),
        "depth_quantiles_mm": quantiles_mm,
        "force_max_n": float(table["force_n"].max()),
        "force_step_max_n": float(table["force_step_n"].max()),
    }
