"""The help of a command: one screen for most calls, every option behind `--help-all`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

SHOW_ALL = "vfplan.cli.show_all"
"""Under this key in click's context: whether the help lists every option."""


class PagedCommand(click.Command):
    """A click command whose `--help` lists the options of the first screen.

    Parameters
    ----------
    first_screen
        Their names as they are typed, as "--rule". Without names all options are listed.
    """

    def __init__(self, *args: Any, first_screen: Sequence[str] = (), **more: Any) -> None:
        super().__init__(*args, **more)
        self.first_screen = tuple(first_screen)
        self.params.append(
            click.Option(
                ["--help-all"],
                is_flag=True,
                is_eager=True,
                expose_value=False,
                callback=print_whole_help,
                help="Show every option.",
                hidden=not self.first_screen,
            )
        )
        known = set()
        for param in self.params:
            known.update(param.opts)
        unknown = set(self.first_screen) - known
        assert not unknown, f"{self.name} has no option {unknown}"

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the options of the first screen, or every one."""
        always = {"--help", "--help-all"}
        listed = []
        hidden_count = 0
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is None or isinstance(param, click.Argument):
                continue
            names = set(param.opts)
            if (
                ctx.meta.get(SHOW_ALL)
                or not self.first_screen
                or names & always
                or names & set(self.first_screen)
            ):
                listed.append(record)
            else:
                hidden_count += 1
        if listed:
            with formatter.section("Options"):
                formatter.write_dl(listed)
        if hidden_count:
            formatter.write_paragraph()
            formatter.write_text(f"{hidden_count} more options: {ctx.command_path} --help-all")


def print_whole_help(ctx: click.Context, option: click.Parameter, is_wanted: bool) -> None:
    """Print the help with every option, and end the command."""
    if is_wanted:
        ctx.meta[SHOW_ALL] = True
        click.echo(ctx.get_help(), color=ctx.color)
        ctx.exit()
