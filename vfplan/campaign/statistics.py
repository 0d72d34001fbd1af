"""Probabilities, quantiles and margins from trials, each with its 95 % interval, and their picture.

`plan --margin p=P --campaign DIR` takes its margin from here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from vfplan.campaign.store import markers_sha256, read_campaign, read_question
from vfplan.errors import CheckFailed
from vfplan.figures.style import new_figure, save_png, style
from vfplan.fixture import Fixture
from vfplan.palette import CLOUD, CONTACT, FORCE
from vfplan.registration.registration import PROBABILITY
from vfplan.replaying.metrics import CurveRuler

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
    from scipy.stats import quantile_test

    index = max(0, int(np.ceil(q * len(sorted_values))) - 1)
    ends = quantile_test(sorted_values, p=q).confidence_interval(PROBABILITY)
    low, high = (None if np.isnan(end) else float(end) for end in ends)
    return {"value": float(sorted_values[index]), "low": low, "high": high}


def entering(depth: Array, beyond_m: list[float]) -> list[dict[str, float]]:
    """How probable it is to go further than each of `beyond_m` beyond the true curve."""
    entries = []
    for beyond in beyond_m:
        hits = int((depth > beyond).sum())
        low, high = clopper_pearson(hits, len(depth))
        p = hits / len(depth)
        entries.append({"beyond_mm": 1e3 * beyond, "p": p, "low": low, "high": high})
    return entries


def margins(
    depth: Array, probabilities: list[float], share: float
) -> list[dict[str, float | None]]:
    """The margin [mm] that makes entering less probable than each of the probabilities.

    A margin moves the rendered surface outwards, and the tool by `share` = K / (K + k_h) of that.
    So the margin for p is the (1 - p) quantile of the depth over this share, not less than 0.
    """
    ordered = np.sort(depth)

    def margin_mm(depth_m: float | None) -> float | None:
        if depth_m is None:
            return None
        return 1e3 * max(0.0, depth_m) / share

    entries = []
    for probability in probabilities:
        depths = quantile(ordered, 1 - probability)
        margin, low, high = (margin_mm(depths[name]) for name in ("value", "low", "high"))
        entries.append({"p": probability, "margin_mm": margin, "low": low, "high": high})
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
    quantiles_mm = {
        f"{q:g}": {name: None if m is None else 1e3 * m for name, m in quantile(ordered, q).items()}
        for q in (0.5, 0.9, 0.95, 0.99)
    }
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


# Number of trials times p from which the 95 % interval of a (1 - p) quantile has an upper end.
TRIALS_TIMES_P = 3.7


def require_same_plan(folder: Path, fixture: Fixture) -> None:
    """Refuse a margin of a campaign on other markers, another model or another K.

    Raises
    ------
    InputError, CheckFailed
        No campaign, or one of another plan.
    """
    if read_question(folder)["markers_sha256"] != markers_sha256(fixture):
        raise CheckFailed(
            "is a campaign of another plan: its markers, model or stiffness differ. Run "
            "vfplan campaign on this plan",
            where=str(folder), code="campaign-of-another-plan",
        )  # fmt: skip


def margin_for(folder: Path, p: float) -> float:
    """The margin [m] that makes entering less probable than `p`, to its interval's upper end.

    Raises
    ------
    InputError
        No campaign, or a damaged one.
    CheckFailed
        Too few trials to bound the margin from above.
    """
    question, table = read_campaign(folder)
    trials = len(table["depth_m"])
    high_mm = margins(table["depth_m"], [p], question["share"])[0]["high"]
    if high_mm is None:
        needed = round(TRIALS_TIMES_P / p)
        raise CheckFailed(
            f"holds {trials} trials, which do not bound the margin for p = {p:g} from above. "
            f"Make about {needed}",
            where=str(folder), code="too-few-trials", numbers={"trials": trials, "needed": needed},
        )  # fmt: skip
    return 1e-3 * high_mm


# Number of bins along the curve.
BINS = 40


def draw_campaign(fixture: Fixture, table: dict[str, Array], beyond_m: float, path: Path) -> None:
    """Write three views: probability along the curve, on the curve, and of the depth.

    Parameters
    ----------
    fixture
        With a curve, in `robot_base`.
    table
        The trials, of `read_campaign`.
    beyond_m
        The depth beyond the true curve [m] whose probability is drawn.
    """
    ruler = CurveRuler.of(fixture)
    depth = table["depth_m"]
    point = table["point"].astype(int)
    entered = depth > beyond_m
    share = np.bincount(point[entered], minlength=len(fixture.points)) / len(depth)
    figure = new_figure(9.0, 7.0)
    with style():
        axes = figure.subplot_mosaic([["on", "on"], ["along", "depth"]])
        draw_on_curve(axes["on"], fixture, share)

        # Probability along the curve.
        if ruler is not None:
            share_per_bin, edges = np.histogram(1e3 * ruler.arclength, BINS, weights=share)
            axes["along"].stairs(share_per_bin, edges, fill=True, color=CONTACT, alpha=0.7)
            axes["along"].set_axisbelow(True)
            axes["along"].set(xlabel="along the curve [mm]")
        axes["along"].set(ylabel="probability",
                          title=f"where the tool is over {1e3 * beyond_m:g} mm beyond")  # fmt: skip

        # Probability of more than a depth, of the trials that touched the fixture.
        ordered = np.sort(1e3 * depth[point >= 0])
        above = 1 - np.arange(len(ordered)) / len(depth)
        axes["depth"].step(ordered, above, color=FORCE, lw=1.2)
        axes["depth"].set(
            xlabel="depth beyond the true curve [mm]", ylabel="probability of more", yscale="log"
        )
    save_png(figure, path)


def draw_on_curve(axes: Axes, fixture: Fixture, share: Array) -> None:
    """Draw the curve in its plane, with a disc at each point where the tool entered."""
    centred = fixture.points - fixture.points.mean(axis=0)
    flat = 1e3 * centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T
    axes.plot(*flat.T, ".", ms=1.5, color=CLOUD, alpha=0.5)
    hit = share > 0
    sizes = 12 + 300 * share[hit] / max(share.max(), 1e-12)
    axes.scatter(*flat[hit].T, s=sizes, color=CONTACT, alpha=0.6, lw=0)
    axes.set(aspect="equal", xlabel="mm", ylabel="mm", title="on the curve, in its plane")
