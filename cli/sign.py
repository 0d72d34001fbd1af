"""`vfplan sign`: approve a bundle."""

from __future__ import annotations

from vfplan.cli.options import FIXTURE, option, output, taking
from vfplan.cli.outputs import outputs
from vfplan.cli.run import Report, command
from vfplan.cli.values import FILE


@command("sign")
@FIXTURE
@taking(
    option("--key", type=FILE, required=True, help="The private key, from `vfplan keygen`."),
    option("--case", default="", help="Case token that the signature is to cover."),
    option("--robot-serial", default="", help="The one robot this bundle is for."),
    option("--registered-at", "registered_utc", metavar="UTC",
           help="When the patient was registered, e.g. 2026-01-31T12:00:00Z: the bundle's age "
           "counts from then.  [default: now]"),
    option("--despite-findings", is_flag=True,
           help="Sign it although findings are open or nobody reviewed it; the seal says so."),
    output("The signed bundle."),
)  # fmt: skip
def command(fixture, output, key, **given) -> Report:
    """Check FIXTURE.h5 and write it again under a seal signed with --key.

    The signature covers every byte of the bundle, its time, and case and robot where given, so that
    yesterday's valid bundle is not today's. A bundle with findings that nobody
    answered, or that nobody reviewed, is not signed (exit 1).
    """
    from vfplan.bundle import sign

    with outputs(output) as (path,):
        seal = sign(fixture, path, key, **given)
    data = {"output": str(output), **seal.describe()}
    return Report(data, f"signed {output}, key {seal.key_id.hex()}")
