"""`vfplan conformance`: write the files with which a reader of bundles is tested."""

from __future__ import annotations

from pathlib import Path

import click
from vfplan.cli.run import Report, command


@command("conformance")
@click.option(
    "--write",
    "folder",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="The folder for the kit; files of the kit that are there are written anew.",
)
def command(folder) -> Report:
    """Write the conformance kit: sound and broken bundles, and paths that were rendered.

    `python -m vfplan.conformance --kit DIR CMD` runs a reader on each of its files.
    """
    from vfplan.conformance.kit import write_kit

    count = write_kit(folder)
    return Report({"folder": str(folder), "files": count}, f"wrote {count} files into {folder}")
