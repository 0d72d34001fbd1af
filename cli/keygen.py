"""`vfplan keygen`: a key pair for approving bundles."""

from __future__ import annotations

from vfplan.cli.options import output
from vfplan.cli.outputs import overwriting
from vfplan.cli.run import Report, command
from vfplan.cli.values import Written


@command("keygen")
@output("The private key, for its owner only; the public key gets the suffix .pub.", kind=Written())
def command(output) -> Report:
    """Make an Ed25519 key pair: a private key to sign with, a public key for robots to trust."""
    from vfplan.bundle import keygen

    public, key_id = keygen(output, overwrite=overwriting())
    data = {"private_key": str(output), "public_key": str(public), "key_id": key_id}
    return Report(data, f"key {key_id}: {output} (keep it secret) and {public} (hand it out)")
