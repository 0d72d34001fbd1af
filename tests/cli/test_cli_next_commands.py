"""The commands that `next:` names: complete, and understood by the program as they stand."""

from __future__ import annotations

import ast
import shlex
from pathlib import Path

import click
import pytest
from conftest import ROOT
from vfplan.cli.main import cli
from vfplan.cli.next_commands import (
    file_beside,
    page_command,
    register_command,
    review_command,
    sign_command,
    verify_command,
)

ODD = Path("a folder/it's mine.h5")
COMMANDS = {
    "register": register_command(ODD),
    "register with a slice": register_command(ODD, Path("my slice.png")),
    "review": review_command(ODD, None),
    "review on its slice": review_command(ODD, Path("my slice.png")),
    "review of a slice": page_command(ODD, None, Path("markers 2.csv"), output=ODD),
    "sign": sign_command(ODD), "sign again": sign_command(ODD, case="it's", robot_serial="a 7"),
    "verify": verify_command(ODD, "my keys.pub", case="it's", robot_serial="a 7"),
}  # fmt: skip


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_that_follows_is_understood(name):
    program, command_name, *words = shlex.split(COMMANDS[name])
    assert program == "vfplan"
    command = cli.get_command(click.Context(cli), command_name)
    parsed, rest, _ = command.make_parser(click.Context(command)).parse_args([*words])
    assert not rest
    assert str(ODD) in parsed.values()
    if command_name != "verify":
        assert parsed["output"].endswith(".h5")
    if command_name == "sign" and "a 7" not in words:
        assert parsed["case"] == "CASE"
    if "a 7" in words:
        assert (parsed["case"], parsed["robot_serial"]) == ("it's", "a 7")


@pytest.mark.parametrize("make", [register_command, sign_command])
def test_what_follows_writes_another_file_beside_the_first(make):
    words = shlex.split(make(Path("folder/elbow.h5")))
    output = Path(words[words.index("-o") + 1])
    assert output.parent == Path("folder")
    assert output.stem.startswith("elbow-")


def result_calls():
    """Each call of `CommandResult` in a command: where, and its keywords."""
    for path in sorted([*(ROOT / "cli").glob("*.py"), *(ROOT / "vfplan").glob("*/command.py")]):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "CommandResult":
                keywords = {keyword.arg for keyword in node.keywords}
                yield pytest.param(keywords, id=f"{path.relative_to(ROOT)}:{node.lineno}")


@pytest.mark.parametrize("keywords", list(result_calls()))
def test_every_command_ends_in_a_verdict_and_a_next_step(keywords):
    assert {"verdict", "next_step"} <= keywords


def test_a_bundle_that_is_there_already_is_not_named_again(tmp_path):
    assert file_beside(tmp_path / "f.h5", "signed") == str(tmp_path / "f-signed.h5")
    (tmp_path / "f-signed.h5").touch()
    assert file_beside(tmp_path / "f.h5", "signed") == str(tmp_path / "f-signed-2.h5")


def test_a_sheet_that_is_there_already_is_not_named_again(tmp_path):
    for name in ("f-sheet.png", "f-sheet-2.png", "f-sheet-3.png"):
        words = shlex.split(review_command(tmp_path / "f.h5", None, has_page=False))
        assert words[words.index("--sheet-out") + 1] == str(tmp_path / name)
        (tmp_path / name).touch()
