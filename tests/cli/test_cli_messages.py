"""Options that a message names: each exists in a command that can say it, or that it speaks of."""

from __future__ import annotations

import ast
import re

import click
from conftest import ROOT
from vfplan.cli.main import COMMANDS, MODULES, cli

GROUP = click.Context(cli)
# Options of `vfplan` itself and of `python -m vfplan.conformance`.
ELSEWHERE = {"--cmake-dir", "--version", "--kit", "--refused"}


def options_of(name):
    command = cli.get_command(GROUP, name)
    return {word for p in command.get_params(click.Context(command)) for word in p.opts}


OPTIONS = {name: options_of(name) for name in COMMANDS}


def wrong_messages():
    """Each text in the source that names an option which no command that it may speak of has."""
    for path in sorted([*ROOT.glob("vfplan/**/*.py"), *ROOT.glob("cli/*.py")]):
        module = ".".join(("vfplan", *path.relative_to(ROOT).with_suffix("").parts[-2:]))
        own = [n for n in COMMANDS if MODULES.get(n, f"vfplan.cli.{n}") == module]
        for part in ast.parse(path.read_text()).body:
            code = ast.unparse(part)
            named = [n for n in COMMANDS if re.search(rf"vfplan {n}\b|\b{n}_command\b|'{n}'", code)]
            commands = [*own, *named] if own else COMMANDS
            known = ELSEWHERE | {option for name in commands for option in OPTIONS[name]}
            texts = [node.value for node in ast.walk(part) if isinstance(node, ast.Constant)]
            for text in texts:
                words = re.findall(r"(?<![\w-])--[a-z][a-z-]*[a-z]", str(text))
                yield from (f"{path}: {word} in {text!r}" for word in words if word not in known)


def test_an_option_that_a_message_names_exists():
    assert list(wrong_messages()) == []
