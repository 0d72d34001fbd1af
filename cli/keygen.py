"""`vfplan keygen`: a key pair for approving bundles."""

from __future__ import annotations

import shlex

from vfplan.cli.options import output_option
from vfplan.cli.outputs import is_overwriting
from vfplan.cli.run import CommandResult, command
from vfplan.cli.values import OutputFile


@command("keygen")
@output_option(
    "Write the private key to this file, and the public key beside it with the suffix .pub.",
    kind=OutputFile(),
)
def vfplan_keygen(output) -> CommandResult:
    """Make an Ed25519 key pair: a private key to sign with, and a public key for the robots."""
    from vfplan.bundle import keygen

    public, key_id = keygen(output, overwrite=is_overwriting())
    data = {"private_key": str(output), "public_key": str(public), "key_id": key_id}
    return CommandResult(
        data,
        f"wrote {output} and {public}",
        verdict=f"made key {key_id}",
        next_step=f"keep {output} secret, give {public} to the robots, and sign: vfplan sign "
        f"FIXTURE.h5 --key {shlex.quote(str(output))} -o SIGNED.h5",
    )
