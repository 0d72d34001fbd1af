"""`vfplan sign`: approve a bundle."""

from __future__ import annotations

from pathlib import Path

import click
from vfplan.cli.options import output
from vfplan.cli.outputs import outputs, refuse_existing
from vfplan.cli.run import Report
from vfplan.cli.run import command as vfplan_command
from vfplan.cli.values import FILE


@vfplan_command("sign", short_help="Approve a bundle with a private key.")
@click.argument("fixture", type=FILE, metavar="FIXTURE.h5")
@click.option("--key", type=FILE, required=True, help="The private key, from `vfplan keygen`.")
@click.option("--case", default="", help="Case token that the signature is to cover.")
@click.option("--robot-serial", default="", help="The one robot this bundle is for.")
@click.option(
    "--registered-at",
    metavar="UTC",
    help="When the patient was registered, e.g. 2026-01-31T12:00:00Z.",
)
@output("The signed bundle.")
def command(
    fixture: Path,
    key: Path,
    case: str,
    robot_serial: str,
    registered_at: str | None,
    output: Path,
    overwrite: bool,
) -> Report:
    """Check FIXTURE.h5 and write it again under a seal signed with --key.

    The signature covers every byte of the bundle, and case, robot and time of registration where
    given, so that yesterday's valid bundle is not today's.
    """
    refuse_existing(output, overwrite=overwrite)
    from vfplan.bundle import sign

    with outputs(output) as (path,):
        seal = sign(
            fixture,
            path,
            key,
            case=case,
            robot_serial=robot_serial,
            registered_utc=registered_at,
        )
    return Report(
        {"output": str(output), **seal.describe()}, f"signed {output}, key {seal.key_id.hex()}"
    )
