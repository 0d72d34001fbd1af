"""`vfplan sign`: approve a bundle."""

from __future__ import annotations

from vfplan.cli.next_commands import public_key_of, verify_command
from vfplan.cli.options import FIXTURE, option, options_in_order, output_option
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, command
from vfplan.cli.values import FILE


@command("sign")
@FIXTURE
@options_in_order(
    option("--key", type=FILE, required=True, metavar="KEY",
           help="Sign with this private key, from `vfplan keygen`."),
    option("--case", default="", metavar="CASE", help="Sign it for this case only."),
    option("--robot-serial", default="", metavar="SERIAL", help="Sign it for this robot only."),
    option("--registered-at", "registered_utc", metavar="UTC",
           help="Count the age of the bundle from this time, when the patient was registered, e.g. "
           "2026-01-31T12:00:00Z.  [default: now]"),
    option("--despite-findings", is_flag=True,
           help="Sign it even with open findings or without a review. The seal says so."),
    output_option("Write the signed bundle to this file."),
)  # fmt: skip
def vfplan_sign(fixture, output, key, **arguments) -> CommandResult:
    """Check FIXTURE.h5 and write it again with a signature.

    The signature covers every byte of the bundle, the time, and the case and the robot if they are
    given. The command refuses a bundle that nobody reviewed, or with findings that nobody answered
    (exit 1).
    """
    from vfplan.bundle import sign

    with outputs(output) as (path,):
        seal = sign(fixture, path, key, **arguments)
    data = {"output": str(output), **seal.describe()}
    return CommandResult(
        data,
        f"wrote {output}",
        verdict=f"signed with key {seal.key_id.hex()}",
        next_step=verify_command(
            output, public_key_of(key), case=seal.case, robot_serial=seal.robot_serial
        ),
    )
