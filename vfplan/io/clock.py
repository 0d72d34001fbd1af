"""The time that a bundle's provenance states."""

from __future__ import annotations

import os
from datetime import UTC, datetime

from vfplan.errors import InputError


def now_utc() -> str:
    """Now, or what SOURCE_DATE_EPOCH says (reproducible-builds.org), as ISO 8601 in whole seconds.

    Raises `InputError` where SOURCE_DATE_EPOCH is no time.
    """
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    if epoch is None:
        moment = datetime.now(UTC)
    elif epoch.isascii() and epoch.isdigit() and len(epoch) < 12:
        moment = datetime.fromtimestamp(int(epoch), UTC)
    else:
        raise InputError(
            f"the environment's SOURCE_DATE_EPOCH is {epoch!r}; whole seconds since 1970 are wanted"
        )
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")
