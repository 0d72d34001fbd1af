"""What `plan --margin p=P --campaign DIR` takes from a campaign."""

from __future__ import annotations

from pathlib import Path

from vfplan.campaign.statistics import margins
from vfplan.campaign.store import markers_sha256, read_campaign, read_question
from vfplan.errors import CheckFailed
from vfplan.fixture import Fixture

TRIALS_TIMES_P = 3.7
"""Number of trials times p from which the 95 % interval of a (1 - p) quantile has an upper end."""


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
