"""`vfplan conformance`: write the files with which a reader of bundles is tested."""

from __future__ import annotations

import shlex
from pathlib import Path

import click
from vfplan.cli.run import CommandResult, command


@command("conformance")
@click.option(
    "--write",
    "folder",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Write the kit into this folder. Files of an older kit are replaced.",
)
def vfplan_conformance(folder) -> CommandResult:
    """Write the conformance kit: sound bundles, broken bundles, and rendered paths.

    `python -m vfplan.conformance --kit DIR CMD` runs a reader on each of its files.
    """
    from vfplan.conformance.kit import write_kit

    count = write_kit(folder)
    return CommandResult(
        {"folder": str(folder), "files": count},
        f"wrote {count} files into {folder}",
        verdict="the kit is complete",
        next_step="run your reader CMD on each file: python -m vfplan.conformance --kit "
        f"{shlex.quote(str(folder))} CMD",
    )
