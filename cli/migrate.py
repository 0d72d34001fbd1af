"""`vfplan migrate`: bring an old bundle up to date."""

from __future__ import annotations

import click
from vfplan.cli.options import output
from vfplan.cli.outputs import outputs
from vfplan.cli.run import Report, command
from vfplan.cli.values import FILE


@command("migrate")
@click.argument("old", type=FILE, metavar="OLD.h5")
@output("The new bundle.")
def command(old, output) -> Report:
    """Write the content of OLD.h5, a bundle of version 0.1, 1.0 or 1.1, as one of version 2.0.

    OLD.h5 stays as it is. The new bundle's provenance tells of the migration; it is unsigned.
    """
    from vfplan.bundle import migrate

    with outputs(output) as (path,):
        content = migrate(old, path)
    line = content["/provenance/history"][-1]
    data = {"output": str(output), "version": content["/@version"], "history": line}
    return Report(data, f"{line}\nwrote {output}")
