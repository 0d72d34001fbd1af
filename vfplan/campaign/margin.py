"""What `plan --margin p=P --campaign DIR` takes from a campaign."""

from __future__ import annotations

from pathlib import Path

from vfplan.campaign.statistics import margins
from vfplan.campaign.store import asked_in, markers_sha256, read_campaign
from vfplan.errors import CheckFailed
from vfplan.fixture import Fixture


def require_same_plan(folder: Path, fixture: Fixture) -> None:
    """Refuse a margin of a campaign on other markers, another model or another K.

    Raises
    ------
    InputError, CheckFailed
        No campaign, or one of another plan.
    """
    if asked_in(folder)["markers_sha256"] != markers_sha256(fixture):
        raise CheckFailed(
            "is a campaign of another plan: its markers, model or stiffness differ from these",
            where=str(folder),
        )


def margin_for(folder: Path, p: float) -> float:
    """The margin [m] that makes entering less probable than `p`, to its interval's upper end.

    Raises
    ------
    InputError
        No campaign, or a damaged one.
    CheckFailed
        Too few trials to bound the margin from above.
    """
    asked, table = read_campaign(folder)
    high = margins(table["depth_m"], [p], asked["share"])[0]["high"]
    if high is None:
        least = round(3.7 / p)
        raise CheckFailed(
            f"holds {len(table['depth_m'])} trials, which do not bound the margin for p = {p:g} "
            f"from above; about {least} are wanted",
            where=str(folder),
        )
    return 1e-3 * high
