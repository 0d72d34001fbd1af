"""`vfplan info`: a page for a person, JSON for a program, one line for a bad file."""

import errno
import json
import os
from dataclasses import replace
from unittest.mock import Mock

import bundles
import pytest
from click.testing import CliRunner
from vfplan.cli.main import cli

import vfplan


@pytest.fixture
def path(tmp_path):
    return bundles.stored(tmp_path / "a.h5", bundles.whole())


def test_a_file_that_may_not_be_read_is_code_3(path, monkeypatch):
    """As the system answers whoever is not its owner; the tests may run as root."""
    monkeypatch.setattr(os, "access", lambda *_: False)
    refusal = PermissionError(errno.EACCES, "Permission denied")
    monkeypatch.setattr(os, "open", Mock(side_effect=refusal))
    done = CliRunner().invoke(cli, ["info", str(path), "--json"])
    assert (done.exit_code, json.loads(done.stdout)["error"]["code"]) == (3, "file-unreadable")


def test_the_next_step_of_an_approved_bundle_signs_it_for_its_case(vfplan_cli, tmp_path):
    fixture = replace(bundles.whole(), findings=(), reviewed=None, case="K9")
    vfplan.write_fixture(fixture, tmp_path / "b.h5")
    words = ("accept", tmp_path / "b.h5", "--by", "A", "--answer-all", "--digest")
    sheet = vfplan_cli("review", tmp_path / "b.h5", "--sheet-out", tmp_path / "s.png")
    digest = sheet.stdout.split("digest ")[1].split()[0]
    approved = tmp_path / "approved.h5"
    assert vfplan_cli(*words, digest, "-o", approved).sound
    for command in (("info",), ("stability", "--part=closed-loop", "--robot=franka")):
        assert "--key planner.key --case K9 -o" in vfplan_cli(*command, approved).stdout


@pytest.mark.parametrize("image", [{}, {"image": None}])
def test_the_next_step_shows_the_slice_that_a_bundle_came_from(vfplan_cli, image, tmp_path):
    vfplan.write_fixture(replace(bundles.whole(), reviewed=None, **image), tmp_path / "b.h5")
    run = vfplan_cli("info", tmp_path / "b.h5")
    assert (f"--slice {tmp_path}" in run.stdout) == (not image)
    assert "-approved.h5" in run.stdout


def test_the_page_is_a_summary_and_all_has_every_value(vfplan_cli, path):
    short, whole = vfplan_cli("info", path), vfplan_cli("info", path, "-v")
    assert len(short.stdout.splitlines()) <= 10
    assert "not signed" in short.stdout
    assert "K 1000" in short.stdout
    run = vfplan_cli("info", path, "--json")
    assert (run.code, run.stderr) == (0, "")
    assert run.json["/points"]["shape"] == [70, 3]
    work = run.json["tick_work"]
    assert f"rule {work['rule']}, a tick takes at most {work['us']:.0f} us" in short.stdout
    assert all(f"  {name}" in whole.stdout for name in run.json if name[0] == "/")
