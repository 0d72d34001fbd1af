"""The commands that `next:` names: complete, and understood by the program as they stand."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import bundles
import click
import pytest
from conftest import ELBOW, ROOT
from review_slices import photographed, two_candidates
from vfplan.cli.main import cli
from vfplan.cli.next_commands import (
    file_beside,
    page_command,
    register_command,
    review_command,
    sign_command,
    verify_command,
)

from vfplan.bundle.write import write_fixture

ODD = Path("a folder/it's mine.h5")
DASH = Path("-dash.h5")
SEAL = {"case": "it's", "robot_serial": "a 7"}


def test_a_file_that_begins_like_an_option_gets_its_folder():
    assert review_command(DASH, None) == "vfplan review ./-dash.h5 -o ./-dash-approved.h5"
    assert verify_command(DASH, Path("-k.pub"), {}) == "vfplan verify ./-dash.h5 --keys ./-k.pub"


@pytest.mark.parametrize("printed, known", [
    (register_command(ODD, Path("my slice.png")), {"image": "my slice.png"}),
    (review_command(ODD, Path("my slice.png")), {"slice_path": "my slice.png"}),
    (page_command(ODD, None, Path("b 2.csv"), output=ODD), {"markers": "b 2.csv"}),
    (sign_command(ODD, SEAL).split(" && ")[1], {"key": "planner.key", **SEAL}),
    (verify_command(ODD, "my keys.pub", SEAL), {"keys": "my keys.pub", **SEAL}),
])  # fmt: skip
def test_names_with_blanks_and_apostrophes_are_understood(printed, known):
    _, name, *words = shlex.split(printed)
    command = cli.get_command(click.Context(cli), name)
    parsed, rest, _ = command.make_parser(click.Context(command)).parse_args(words)
    assert not rest
    assert {word: parsed[word] for word in known} == known
    assert str(ODD) in parsed.values()


def test_options_without_a_value_are_repeated_without_one(monkeypatch):
    options = cli.get_command(click.Context(cli), "review").params
    names = [one.opts[0] for one in options if getattr(one, "is_flag", 0) or one.name == "verbose"]
    names = [name for name in names if name not in ("--json", "--help-all")]
    for typed in ([*names, "-v"], ["-v", "--curve", "2", *names, "--margin", "1 mm"]):
        monkeypatch.setattr(sys, "argv", ["vfplan", "review", *typed])
        assert shlex.split(page_command(ODD, output=ODD))[3:-2] == typed


def test_a_bundle_that_is_there_already_is_not_named_again(tmp_path):
    assert file_beside(tmp_path / "f.h5", "signed") == tmp_path / "f-signed.h5"
    (tmp_path / "f-signed.h5").touch()
    assert file_beside(tmp_path / "f.h5", "signed") == tmp_path / "f-signed-2.h5"


def test_a_key_is_made_first_where_there_is_none(vfplan_cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "planner.key").write_text("of another program")
    keygen, sign = sign_command(Path("out/f.h5"), {}).split(" && ")
    assert vfplan_cli(*shlex.split(keygen)[1:]).sound
    assert "--key planner-new.key --case CASE" in sign
    assert sign_command(Path("out/f.h5"), {}) == sign
    # Whose of two keys is to sign, only the person knows.
    assert vfplan_cli("keygen", "-o", "b.key").sound
    assert "sign out/f.h5 --key KEY " in sign_command(Path("out/f.h5"), {})


# What a person knows who pastes a command, in place of the words in capitals.
KNOWN = {
    "MARKERS": "px.csv robot.csv", "IMAGE": "elbow.png", "SESSION": "session.csv", "CASE": "C1",
    "KEY": "k.key", "KEYS.pub": "k.pub", "FIXTURE.h5": "approved.h5", "SIGNED.h5": "s.h5",
}  # fmt: skip
# Calls, one after the other in one folder, and the exit code of each. Each prints a command, which
# is pasted: after "next:", or at the end of a refusal.
CALLS = (
    (0, "extract elbow.png -o c.h5"), (3, "extract two.png -o t.h5"),
    (0, "register c.h5 px.csv robot.csv -o f.h5"), (0, "plan elbow.png px.csv robot.csv -o p.h5"),
    (1, "plan photo-0.png photo-0.csv robot.csv -o q.h5"), (3, "plan elbow.png robot.csv -o z.h5"),
    (0, "rectify photo-0.png photo-0.csv robot.csv -o flat.png"),
    (0, "review elbow.png px.csv robot.csv --sheet-out sheet.png"),
    (0, "review p.h5 --sheet-out sheet-2.png"),
    (0, "review c.h5 px.csv robot.csv --model affine --sheet-out sheet-4.png"),
    (0, "accept p.h5 --by A --digest {} -o approved.h5"),
    (1, "accept p.h5 --by A --digest 0 -o o.h5"), (1, "accept bare.h5 --by A --digest 0 -o o.h5"),
    (3, "sign approved.h5 --key k3.key -o s0.h5"), (1, "sign p.h5 --key k.key -o s0.h5"),
    (0, "keygen -o k2.key"), (0, "review approved.h5 --sheet-out sheet-3.png"),
    (0, "sign approved.h5 --key k.key --case C1 -o b.h5"), (0, "verify b.h5 --keys k.pub"),
    (0, "info p.h5"), (0, "info approved.h5"), (0, "info b.h5"), (0, "validate p.h5"),
    (0, "replay p.h5 session.csv"), (0, "replay p.h5 session.csv --report r"),
    (0, "replay b.h5 session.csv --robot franka"), (0, "stability p.h5 --part closed-loop"),
)  # fmt: skip


@pytest.mark.slow
def test_every_command_that_is_printed_runs_as_pasted(vfplan_cli, tmp_path):
    for name, sample in zip(("elbow.png", "px.csv", "robot.csv"), ELBOW, strict=True):
        (tmp_path / name).write_bytes(sample.read_bytes())
    (tmp_path / "session.csv").write_bytes((ROOT / "samples/elbow_session.csv").read_bytes())
    two_candidates(tmp_path / "two.png")
    write_fixture(bundles.small(), tmp_path / "bare.h5")
    photographed(tmp_path)
    vfplan_cli("keygen", "-o", "k.key", cwd=tmp_path)
    failed = []
    for code, call in CALLS:
        if "{}" in call:
            how = ("--slice", "elbow.png", "--sheet-out", "for-digest.png")
            sheet = vfplan_cli("review", "p.h5", *how, cwd=tmp_path)
            call = call.format(re.search("digest ([0-9a-f]{64})", sheet.stdout)[1])
        done = vfplan_cli(*call.split(), cwd=tmp_path)
        assert done.code == code, (call, done.stderr)
        printed = done.stdout.split("next: ")[-1] if code == 0 else done.error_line
        first, *then = printed.split(" && ")
        for command in (first[first.rindex("vfplan ") :], *then):
            words = shlex.split(command)[1:]
            words = [part for word in words for part in KNOWN.get(word, word).split()]
            pasted, said = pasted_run(words, tmp_path)
            if pasted not in (0, 1):
                failed.append((call, words, said))
    assert failed == []


def pasted_run(words, folder):
    """Exit code and stderr of a command; of a page, once it has told its address, it is left."""
    is_page = words[0] == "review" and "--sheet-out" not in words
    command = [sys.executable, "-P", "-m", "vfplan", *words, *["--no-browser"][: int(is_page)]]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, cwd=folder, **pipes) as process:
        if is_page and process.stdout.readline().startswith("http://127.0.0.1"):
            process.terminate()
            process.communicate(timeout=60)
            return 0, ""
        said = process.communicate(timeout=300)[1]
    return process.returncode, said
