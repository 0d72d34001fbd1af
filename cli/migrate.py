"""`vfplan migrate`: bring an old bundle up to date."""

from __future__ import annotations

import click
from vfplan.cli.next_commands import review_command
from vfplan.cli.options import FILE, output_option
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, command


@command("migrate")
@click.argument("old", type=FILE, metavar="OLD.h5")
@output_option("Write the new bundle to this file.")
def vfplan_migrate(old, output) -> CommandResult:
    """Write the content of OLD.h5, a bundle of version 0.1, 1.0 or 1.1, as one of version 2.0.

    OLD.h5 stays as it is. The new bundle is neither signed nor reviewed. Its provenance names the
    migration.
    """
    from vfplan.bundle.migration import migrate

    with outputs(output) as (path,):
        content = migrate(old, path)
    line = content["/provenance/history"][-1]
    version = content["/@version"]
    image = "IMAGE" if any(path.startswith("/image@") for path in content) else None
    return CommandResult(
        {"output": str(output), "version": version, "history": line},
        f"{line}\nwrote {output}",
        verdict=f"migrated to version {version}; not reviewed and not signed",
        next_step=review_command(output, image, has_page="/curve/stroke" in content),
    )
