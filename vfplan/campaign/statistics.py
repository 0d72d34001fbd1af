"""Probabilities, quantiles and margins from trials, each with its 95 % interval."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CONFIDENCE = 0.95


def clopper_pearson(hits: int, trials: int) -> tuple[float, float]:
    """The exact interval of a probability of which `hits` of `trials` were seen.

    C. J. Clopper, E. S. Pearson, Biometrika 26, 1934, 404-413.
    """
    from scipy.special import betaincinv

    tail = (1 - CONFIDENCE) / 2
    low = 0.0 if hits == 0 else float(betaincinv(hits, trials - hits + 1, tail))
    high = 1.0 if hits == trials else float(betaincinv(hits + 1, trials - hits, 1 - tail))
    return low, high


def quantile(sorted_values: Array, q: float) -> dict[str, float | None]:
    """A quantile with its interval from order statistics; an end that no trial bounds is `None`.

    H. A. David, H. N. Nagaraja, Order Statistics, 3rd edition, Wiley 2003, 7.1.
    """
    from scipy.stats import binom

    n = len(sorted_values)
    tail = (1 - CONFIDENCE) / 2
    low, high = int(binom.ppf(tail, n, q)) - 1, int(binom.ppf(1 - tail, n, q))
    at = min(n - 1, max(0, int(np.ceil(q * n)) - 1))
    return {
        "value": float(sorted_values[at]),
        "low": float(sorted_values[low]) if low >= 0 else None,
        "high": float(sorted_values[high]) if high < n else None,
    }


def entering(depth: Array, beyond_m: list[float]) -> list[dict[str, float]]:
    """How probable it is to come further than each of `beyond_m` beyond the true curve."""
    found = []
    for beyond in beyond_m:
        hits = int((depth > beyond).sum())
        low, high = clopper_pearson(hits, len(depth))
        p = hits / len(depth)
        found.append({"beyond_mm": 1e3 * beyond, "p": p, "low": low, "high": high})
    return found


def margins(depth: Array, wanted: list[float], share: float) -> list[dict[str, float | None]]:
    """The margin [mm] that makes entering less probable than each of `wanted`.

    A margin moves the rendered surface outwards, and the tool by `share` = K / (K + k_h) of that:
    the margin for p is the (1 - p) quantile of the depth over this share, not less than 0.
    """
    ordered = np.sort(depth)
    found = []
    for p in wanted:
        at = quantile(ordered, 1 - p)
        mm = {k: None if v is None else 1e3 * max(0.0, v) / share for k, v in at.items()}
        found.append({"p": p, "margin_mm": mm.pop("value"), **mm})
    return found


def summary(
    asked: dict[str, Any], table: dict[str, Array], beyond_m: list[float], wanted: list[float]
) -> dict[str, Any]:
    """What `vfplan campaign --json` says of the trials of `read_campaign`."""
    depth = table["depth_m"]
    data: dict[str, Any] = {"trials": len(depth), "settings": asked["settings"]}
    ordered = np.sort(depth)
    data["p_enter"] = entering(depth, beyond_m)
    data["margin_for"] = margins(depth, wanted, asked["share"])
    data["depth_quantiles_mm"] = {
        f"{q:g}": {k: None if v is None else 1e3 * v for k, v in quantile(ordered, q).items()}
        for q in (0.5, 0.9, 0.95, 0.99)
    }
    data["force_max_n"] = float(table["force_n"].max())
    data["force_step_max_n"] = float(table["force_step_n"].max())
    return data
