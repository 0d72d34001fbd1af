"""`vfplan`: the group of commands, each loaded from its own file when it is called."""

from __future__ import annotations

import importlib

import click

# name -> one line for `vfplan --help`, in the order of the work. The module is vfplan.cli.<name>
# and holds a click command called `command`; loading none of them keeps `--help` fast.
COMMANDS: dict[str, str] = {}


class LazyGroup(click.Group):
    """A click group that imports a command's module only when that command runs."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all commands, in the order of the work."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Import and return one command; `None` for an unknown name."""
        if name not in COMMANDS:
            return None
        return importlib.import_module(f"vfplan.cli.{name}").command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="vfplan", prog_name="vfplan")
def cli() -> None:
    """Turn a surgeon's drawn curve into a virtual fixture a robot can trust.

    Research software; not a medical device.
    """
