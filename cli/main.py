"""`vfplan`: the group of commands, each loaded from its own file when it is called."""

from __future__ import annotations

import difflib
import importlib
import json
import keyword
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import click

# name -> one line for `vfplan --help`, in the order of the work. The module is vfplan.cli.<name>
# and holds a click command called `command`; loading none of them keeps `--help` fast.
COMMANDS: dict[str, str] = {
    "extract": "A planned slice in, its drawn curve out.",
    "register": "Markers and a curve in, a fixture out.",
    "plan": "A planned slice and its markers in, a fixture out.",
    "replay": "Replay a session against a fixture.",
    "rehearse": "Rehearse a session on a simulated arm.",
    "burr": "Burr a fixture away: points go under the tool.",
    "validate": "Everything that is wrong with a bundle.",
    "info": "What a bundle holds.",
    "migrate": "Bring an old bundle up to date, in a new file.",
    "keygen": "Make a key pair for signing bundles.",
    "sign": "Approve a bundle with a private key.",
    "verify": "Check a bundle's signature.",
    "diff": "What differs between two bundles.",
    "bench": "Error against run time, for every stage.",
    "campaign": "How sure is a plan: many trials with other errors.",
    "stability": "Is K stable with this robot? Closed loop and extreme cases.",
    "surface": "Outlined slices in, a surface out.",
    "import": "A bundle from any point cloud or mesh.",
    "export": "A bundle's points as PLY, CSV or .mrk.json.",
    "live": "A result or a controller's ticks, live, for Slicer and MCAP.",
    "view": "A fixture and a replay in three dimensions.",
    "demo": "The whole pipeline on the shipped sample.",
}


class LazyGroup(click.Group):
    """A click group that imports a command's module only when that command runs."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all commands, in the order of the work."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Import and return one command; `None` for an unknown name."""
        if name not in COMMANDS:
            near = difflib.get_close_matches(name, COMMANDS, 1)
            hint = f"did you mean {near[0]!r}?" if near else "they are " + ", ".join(COMMANDS)
            raise click.UsageError(f"no command {name!r}; {hint}", ctx)
        # A command named like a Python keyword has an underscore after its module's name.
        module = f"{name}_" if keyword.iskeyword(name) else name
        return importlib.import_module(f"vfplan.cli.{module}").command

    def main(self, args: Sequence[str] | None = None, *rest: Any, **extra: Any) -> NoReturn:
        """Run; a usage error is one line on stderr (and JSON on stdout with `--json`), exit 2."""
        words = list(sys.argv[1:] if args is None else args) or ["--help"]
        extra["standalone_mode"] = False
        try:
            code = super().main(words, *rest, **extra)
        except click.ClickException as error:
            _usage_error(error, "--json" in words)
            code = error.exit_code
        except click.Abort:
            code = 130  # as a shell reports an interrupt
        sys.exit(code if isinstance(code, int) else 0)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


def _print_cmake_dir(ctx: click.Context, option: click.Parameter, wanted: bool) -> None:
    if wanted:
        from vfplan import cmake_dir

        click.echo(cmake_dir())
        ctx.exit()


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="vfplan", prog_name="vfplan")
@click.option(
    "--cmake-dir",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_cmake_dir,
    help="Print the folder for CMake's find_package(vfplan) and exit.",
)
def cli() -> None:
    """Turn a surgeon's drawn curve into a virtual fixture a robot can trust.

    Research software; not a medical device.
    """


def _usage_error(error: click.ClickException, as_json: bool) -> None:
    ctx = getattr(error, "ctx", None)
    message = " ".join(error.format_message().split())
    if as_json:
        body = {"kind": "UsageError", "message": message, "where": ctx and ctx.command_path}
        click.echo(json.dumps({"error": body}, indent=2))
    hint = f" (see '{ctx.command_path} --help')" if ctx else ""
    click.echo(f"vfplan: error: {message}{hint}", err=True)
