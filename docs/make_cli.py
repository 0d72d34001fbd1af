"""Write docs/cli.md from the commands and their options:  python docs/make_cli.py

Options that several commands share stand once, in a section of their own.
"""

from __future__ import annotations

import inspect
from pathlib import Path

import click
from vfplan.cli import COMMANDS, GROUPS, cli, options

HEAD = """# Command reference

`make docs` writes this page from the commands themselves; do not edit it by hand. `vfplan COMMAND
--help` shows what most calls need, `--help-all` every option.

## What every command shares

- The text on the screen ends with a *verdict* and a *next* step. `-v` adds the statistics, `-q`
  leaves warnings and failures only.
- `--json` prints one JSON document on stdout and nothing else there. After a failure it is
  `{"error": {"kind", "message", "where", "code", "numbers"}}`.
- An error is one line on stderr: what is wrong with the value, and what to do. `-vv` adds the
  traceback.
- Exit codes: 0 done; 1 a check failed, also "not tested"; 2 usage; 3 bad input; 4 a bundle that
  cannot be trusted; 128 + number after SIGINT, SIGTERM or SIGHUP.
- Outputs appear whole or not at all, and replace a file only with `--overwrite`. A command that is
  killed outright (SIGKILL, a power cut) can leave hidden files whose names begin with `.vfplan-`.
  They may be deleted when no command is at work in that folder.
"""

EVERYWHERE = {"--json", "-q", "-v", "-h", "--help-all", "--settings", "--overwrite"}
"""Options of every command, which the head of the page explains."""

SHARED = {
    "Options of the curve": options.EXTRACT_OPTIONS,
    "Options of the fixture": options.FIXTURE_OPTIONS,
    "Options of the signature": options.signature_options(),
}
"""Title of a section, and the options in it."""


def shared_options() -> dict[str, list[click.Option]]:
    """The options of each shared section."""
    sections = {}
    for title, decorate in SHARED.items():

        def holder() -> None:
            """Carries the options."""

        decorated = decorate(holder)
        sections[title] = list(reversed(decorated.__click_params__))
    return sections


def option_row(param: click.Option, context: click.Context) -> str:
    """A row of a table of options: how it is typed, and what it does."""
    typed, text = param.get_help_record(context)
    typed = typed.replace("|", "\\|")
    text = " ".join(text.split()).replace("|", "\\|")
    return f"| `{typed}` | {text} |"


def option_table(params: list[click.Option], context: click.Context) -> list[str]:
    """A table of options."""
    rows = []
    for param in params:
        rows.append(option_row(param, context))
    return ["| option | |", "|---|---|", *rows, ""]


def anchor(title: str) -> str:
    """The link to a section of this page."""
    return f"[{title.lower()}](#{title.lower().replace(' ', '-')})"


def command_section(name: str, group: click.Context, shared: dict[str, list[click.Option]]) -> str:
    """What a command does, how it is called, and its own options."""
    command = cli.get_command(group, name)
    context = click.Context(command, info_name=name, parent=group)
    usage = " ".join(command.collect_usage_pieces(context))
    lines = [f"### vfplan {name}", "", COMMANDS[name], "", "```text"]
    lines += [f"vfplan {name} {usage}", "```", ""]
    lines += [inspect.cleandoc(command.help).replace("\b\n", "```text\n"), ""]
    if "```text" in lines[-2]:
        lines.insert(-1, "```")

    # Options that stand in a shared section are named by a link.
    own = []
    links = []
    typed = {param.opts[0] for param in command.params}
    typed_elsewhere: set[str] = set()
    for title, params in shared.items():
        section = {param.opts[0] for param in params}
        if section <= typed:
            links.append(anchor(title))
            typed_elsewhere |= section
    for param in command.params:
        if not isinstance(param, click.Option) or param.hidden:
            continue
        if param.opts[0] in typed_elsewhere or EVERYWHERE & set(param.opts):
            continue
        own.append(param)
    if own:
        lines += option_table(own, context)
    if links:
        lines += [f"And the {', the '.join(links)}.", ""]
    if any("--settings" in param.opts for param in command.params):
        lines += [
            "`--settings FILE.json` takes options from a file: the fields of `ExtractSettings` and "
            "`FixtureSettings`, in their units. A typed option wins.",
            "",
        ]
    return "\n".join(lines)


def reference() -> str:
    """The whole page."""
    group = click.Context(cli, info_name="vfplan")
    shared = shared_options()
    parts = [HEAD]
    for title, names in GROUPS.items():
        parts.append(f"## {title}\n")
        for name in names:
            parts.append(command_section(name, group, shared))
    parts.append("## Shared options\n")
    for title, params in shared.items():
        parts.append(f"### {title}\n")
        parts.append("\n".join(option_table(params, group)))
    return "\n".join(parts).rstrip() + "\n"


if __name__ == "__main__":
    Path(__file__).with_name("cli.md").write_text(reference())
