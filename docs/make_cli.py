"""Write docs/cli.md from the commands' own --help:  python docs/make_cli.py"""

from __future__ import annotations

from pathlib import Path

import click
from vfplan.cli.main import COMMANDS, cli
from vfplan.cli.paged_help import SHOW_ALL

HEAD = """# Command reference

Written from `--help-all` by `make docs`; do not edit by hand.

Exit codes: 0 done; 1 a check failed; 2 usage; 3 bad input; 4 a bundle that cannot be trusted.
With `--json`, stdout holds one JSON document and nothing else; after a failure it is
`{"error": {"kind", "message", "where"}}`. Every failed command says why in one line on stderr.
A command stopped by SIGINT, SIGTERM or SIGHUP keeps no file; it ends with 128 + its number.

Outputs appear whole or not at all. A command that is killed outright (SIGKILL, a power cut) can
leave hidden files whose names begin with `.vfplan-`: unfinished new files, and second names of
files that were being replaced. They may be deleted when no command is at work in that folder;
nothing reads them.
"""


def reference() -> str:
    """The whole page."""
    parts = [HEAD]
    width = {"max_content_width": 96, "terminal_width": 96}
    names = cli.context_settings["help_option_names"]
    group = click.Context(cli, info_name="vfplan", help_option_names=names, **width)
    parts.append(f"```text\n{cli.get_help(group)}\n```\n")
    for name in COMMANDS:
        command = cli.get_command(group, name)
        ctx = click.Context(command, info_name=name, parent=group, **width)
        ctx.meta[SHOW_ALL] = True
        parts.append(f"## vfplan {name}\n\n```text\n{command.get_help(ctx)}\n```\n")
    return "\n".join(parts)


if __name__ == "__main__":
    Path(__file__).with_name("cli.md").write_text(reference())
