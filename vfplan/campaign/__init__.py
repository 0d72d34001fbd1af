"""How sure is a plan: many trials of it, each with other errors, and what they say together.

settings    what a campaign varies
errors      a hand's tremor, and the markers' error where nobody says it
trial       one trial: markers, registration, fixture, hand, and how far the tool came
statistics  probabilities, quantiles and margins with their intervals
rare        where a rare event is most likely, so that trials can be drawn there
margin      what `--margin p=P` takes from a campaign
store       a folder of blocks, written whole, that a later run goes on with
run         blocks on this machine's cores or on a Dask cluster
"""

from __future__ import annotations

from vfplan.campaign.margin import margin_for, require_same_plan
from vfplan.campaign.run import run_campaign
from vfplan.campaign.settings import CampaignSettings
from vfplan.campaign.store import read_campaign
from vfplan.campaign.trial import Trials

__all__ = [
    "CampaignSettings", "Trials", "margin_for", "read_campaign", "require_same_plan",
    "run_campaign",
]  # fmt: skip
