"""`vfplan verify`: does a trusted key vouch for this bundle?"""

from __future__ import annotations

from vfplan.cli.options import FIXTURE, signature, trust
from vfplan.cli.run import Report, command


@command("verify")
@FIXTURE
@signature("--keys", required=True)
def command(fixture, **given) -> Report:
    """Check that FIXTURE.h5 is sound and signed by a trusted key; exit 4 if it is not."""
    from vfplan.bundle import read_bundle

    seal = read_bundle(fixture, trust=trust(given))[1]
    return Report({**seal.describe(), "ok": True}, f"sound, signed by key {seal.key_id.hex()}")
