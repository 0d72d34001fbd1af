"""How sure is a plan: many trials of it, each with other errors, and what they say together.

A leaf room: no other package imports it, but for `--margin p=P`. Its command is `vfplan campaign`.

settings    what a campaign varies
trial       one trial: markers, registration, fixture, hand, and how far the tool came
statistics  probabilities, quantiles and margins with their intervals
margin      what `--margin p=P` takes from a campaign
store       a folder of blocks, written whole, that a later run goes on with
run         blocks on this machine's cores or on a Dask cluster
"""

from __future__ import annotations

import importlib
from typing import Any

_DEFINED = {
    "CampaignSettings": "settings",
    "Trials": "trial",
    "margin_for": "margin",
    "read_campaign": "store",
    "require_same_plan": "margin",
    "run_campaign": "run",
}
__all__ = [
    "CampaignSettings", "Trials", "margin_for", "read_campaign", "require_same_plan",
    "run_campaign",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: `vfplan campaign --help` needs none of them."""
    if name not in _DEFINED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_DEFINED[name]}"), name)
