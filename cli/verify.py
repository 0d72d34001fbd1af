"""`vfplan verify`: does a trusted key vouch for this bundle?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from vfplan.cli.options import FIXTURE, signature
from vfplan.cli.run import Report, command

if TYPE_CHECKING:
    from vfplan.bundle import Trust


@command("verify")
@FIXTURE
@signature("--keys", required=True)
def command(fixture: Path, trust: Trust) -> Report:
    """Check that FIXTURE.h5 is sound and signed by a trusted key; exit 4 if it is not."""
    from vfplan.bundle import read_bundle

    seal = read_bundle(fixture, trust=trust)[1]
    return Report({**seal.describe(), "ok": True}, f"sound, signed by key {seal.key_id.hex()}")
