"""`vfplan`: the group of commands, each loaded from its own file when it is called."""

from __future__ import annotations

import importlib
import json
import os
import signal
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import click

# The groups of `vfplan --help`, and in each the commands with one line of help.
GROUPS = {
    "Plan": {
        "plan": "Make a fixture from a planned slice and its markers.",
        "extract": "Extract the drawn curve from a planned slice.",
        "register": "Make a fixture from a curve and markers.",
        "rectify": "Make a photograph taken at an angle flat.",
        "review": "Look at a plan on a page, mend it and approve it.",
        "accept": "Accept a plan by the digest on its sheet, in a script.",
        "surface": "Make a surface from outlined slices.",
        "import": "Make a bundle from a point cloud or a mesh.",
        "tip": "Find a tool's tip from poses about one point.",
    },
    "Check": {
        "replay": "Replay a session against a fixture.",
        "stability": "Judge whether a stiffness is stable with a robot.",
        "validate": "List everything that is wrong with a bundle.",
        "info": "Show what a bundle holds.",
        "diff": "List what differs between two bundles.",
        "view": "Show a fixture and a replay in three dimensions.",
    },
    "Robot": {
        "keygen": "Make a key pair for signing bundles.",
        "sign": "Sign a bundle with a private key.",
        "verify": "Check the signature of a bundle.",
        "rehearse": "Rehearse a session on a simulated arm.",
        "live": "Show the ticks of a controller live, and record them.",
        "ar": "Show the wall in the picture of a camera.",
    },
    "More": {
        "demo": "Run all steps on the shipped sample.",
        "bench": "Measure error and run time of every step.",
        "campaign": "Simulate how often the tool crosses the line.",
        "burr": "Remove the points of a fixture under the tool.",
        "export": "Write a bundle as a file of other programs.",
        "conformance": "Write files that test a reader of bundles.",
    },
}
COMMANDS = {name: text for group in GROUPS.values() for name, text in group.items()}

# Exit code after Ctrl-C, as a shell reports an interrupt.
INTERRUPTED = 128 + signal.SIGINT

# The module of a command, imported when the command is called, which keeps `--help` fast. There the
# command NAME is the function `vfplan_NAME`. One that is not named here is in vfplan.cli.NAME.
HOMES = {
    "cli.exchange": "import export", "cli.info": "validate diff view",
    "cli.sign": "keygen verify accept", "cli.bench": "conformance demo",
    "cli.prepare": "rectify tip", "surface.command": "surface", "campaign.command": "campaign",
    "arm.command": "rehearse", "live.command": "live", "camera.command": "ar", "burr": "burr",
}  # fmt: skip
MODULES = {name: f"vfplan.{home}" for home, names in HOMES.items() for name in names.split()}


class LazyGroup(click.Group):
    """A click group that imports the module of a command only when that command runs."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all commands, in the order of the help."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Import and return one command.

        Raises
        ------
        click.UsageError
            There is no such command; the message proposes one.
        """
        if name not in COMMANDS:
            import difflib

            hint = f"Choose one of {', '.join(COMMANDS)}"
            for similar in difflib.get_close_matches(name, COMMANDS, 1):
                hint = f"Did you mean {similar!r}?"
            raise click.UsageError(f"there is no command {name!r}. {hint}", ctx)
        module = importlib.import_module(MODULES.get(name, f"vfplan.cli.{name}"))
        return getattr(module, f"vfplan_{name}")

    def main(self, args: Sequence[str] | None = None, *more: Any, **extra: Any) -> NoReturn:
        """Run; a usage error is one line on stderr (and JSON on stdout with `--json`), exit 2."""
        words = list(sys.argv[1:] if args is None else args) or ["--help"]
        if words[0] == "help":
            words = [*words[1:], "--help"]
        if sys.stderr is None:
            # It was closed: what would be said there goes nowhere, and into no file of the command.
            sys.stderr = open(os.devnull, "w")  # noqa: SIM115 - open to the end
        try:
            exit_code = super().main(words, *more, **extra | {"standalone_mode": False})
        except click.ClickException as error:
            print_usage_error(error, "--json" in words)
            exit_code = error.exit_code
        except click.Abort:
            exit_code = INTERRUPTED
        sys.exit(exit_code if isinstance(exit_code, int) else 0)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands by groups, without importing them."""
        for group, commands in GROUPS.items():
            with formatter.section(group):
                formatter.write_dl(list(commands.items()))


def print_usage_error(error: click.ClickException, as_json: bool) -> None:
    """Print a usage error: a line on stderr, and with `--json` a document on stdout."""
    from vfplan.cli.run import printable

    message = " ".join(error.format_message().split())
    where = getattr(getattr(error, "ctx", None), "command_path", None)
    hint = f" (see '{where} --help')" if where else ""
    if as_json:
        body = {"kind": "UsageError", "message": message, "where": where}
        click.echo(json.dumps({"error": body}, indent=2))
    click.echo(printable(f"vfplan: error: {message}{hint}"), err=True)


def print_cmake_dir(ctx: click.Context, option: click.Parameter, is_wanted: bool) -> None:
    """Print the folder for CMake, and end the command."""
    if is_wanted:
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
    callback=print_cmake_dir,
    help="Print the folder for CMake's find_package(vfplan) and exit.",
)
def cli() -> None:
    """Turn a surgeon's drawn curve into a virtual fixture a robot can trust.

    The steps are: plan, review, sign, replay, stability; then load the fixture on the robot.

    vfplan is research software and not a medical device.
    """
