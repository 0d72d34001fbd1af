"""The help of a command: what most calls need on one screen, everything behind `--help-all`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

SHOW_ALL = "vfplan.cli.show_all"
"""Under this key in click's context: whether the help lists every option."""


class PagedCommand(click.Command):
    """A click command whose `--help` lists the options of the first screen.

    first_screen: their names as they are typed, as "--rule"; none: all options are listed
    """

    def __init__(self, *args: Any, first_screen: Sequence[str] = (), **more: Any) -> None:
        super().__init__(*args, **more)
        self.first_screen = tuple(first_screen)
        if self.first_screen:
            self.params.append(_help_all_option())
        known = {name for param in self.params for name in param.opts}
        unknown = set(self.first_screen) - known
        assert not unknown, f"{self.name} has no option {unknown}"

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the options of the first screen, or every one."""
        listed = []
        left_out = 0
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is None or isinstance(param, click.Argument):
                continue
            if ctx.meta.get(SHOW_ALL) or self._is_on_first_screen(param):
                listed.append(record)
            else:
                left_out += 1
        if listed:
            with formatter.section("Options"):
                formatter.write_dl(listed)
        if left_out:
            formatter.write_paragraph()
            formatter.write_text(f"{left_out} more options: {ctx.command_path} --help-all")

    def _is_on_first_screen(self, param: click.Parameter) -> bool:
        if not self.first_screen or "--help" in param.opts or "--help-all" in param.opts:
            return True
        return any(name in self.first_screen for name in param.opts)


def _help_all_option() -> click.Option:
    return click.Option(
        ["--help-all"],
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=_print_whole_help,
        help="Show every option.",
    )


def _print_whole_help(ctx: click.Context, option: click.Parameter, wanted: bool) -> None:
    if wanted:
        ctx.meta[SHOW_ALL] = True
        click.echo(ctx.get_help(), color=ctx.color)
        ctx.exit()
