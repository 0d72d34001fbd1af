"""Write docs/cli.md from the commands and their options:  python docs/make_cli.py

Options that several commands share stand once, in a section of their own.
"""

from __future__ import annotations

import inspect
from pathlib import Path

import click
from vfplan.cli import options
from vfplan.cli.main import COMMANDS, GROUPS, cli

HEAD = """# Command reference

`make docs` writes this page from the commands. Do not edit it by hand. `vfplan COMMAND --help`
shows the usual options, and `--help-all` every option.

## What every command shares

- The text ends with a *verdict* and a *next* step. `-v` adds the report. `-q` prints warnings
  and failures only.
- `--json` prints one JSON document on stdout and nothing else there. After a failure it is
  `{"error": {"kind", "message", "where", "code", "numbers"}}`.
- `plan`, `extract`, `register`, `rectify` and `review` take options from a file by
  `--settings FILE.json`, or from its text in place of FILE.json: the fields of `ExtractSettings`
  and `FixtureSettings`, in their units. A typed option wins.
- An error is one line on stderr. It says what is wrong and what to do. `-vv` adds the traceback.
- Outputs appear whole or not at all. They replace a file only with `--overwrite`.
- If a command is killed (SIGKILL, a power cut), it can leave hidden files whose names begin with
  `.vfplan-`. Remove them by hand.

| exit code | meaning |
|---|---|
| 0 | The command did its work. |
| 1 | A check failed, or the verdict is `not-tested` although limits were given. |
| 2 | The command line is wrong, or an output cannot be written. |
| 3 | The input cannot be used. |
| 4 | The bundle cannot be trusted. |
| 128 + number | SIGINT, SIGTERM or SIGHUP ended the command. |
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
