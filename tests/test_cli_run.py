"""What every command shares: errors that nobody foresaw, and a word when work takes long."""

from __future__ import annotations

import json
import sys
import time

import click
import pytest
from click.testing import CliRunner
from vfplan.cli.run import Report, command, patience


@command("boom")
def boom() -> Report:
    """Fail in a way that nobody foresaw."""
    raise KeyError("no such thing")


@command("misused")
def misused() -> Report:
    """Find a usage error only when it runs."""
    raise click.UsageError("two options exclude each other")


def test_unforeseen_error_is_one_line_and_exit_3():
    run = CliRunner().invoke(boom, ["--json"])
    assert run.exit_code == 3
    assert json.loads(run.stdout)["error"]["kind"] == "KeyError"
    assert "unforeseen KeyError: 'no such thing'" in run.stderr
    assert "Traceback" not in run.stderr
    assert "Traceback" in CliRunner().invoke(boom, ["-vv"]).stderr


def test_usage_error_found_late_is_still_one():
    run = CliRunner().invoke(misused, [])
    assert run.exit_code == 2
    assert "exclude each other" in run.stderr


@pytest.mark.parametrize("terminal", [True, False])
def test_long_work_says_so_on_a_terminal_only(monkeypatch, capsys, terminal):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    with patience("working", after_s=0.01):
        time.sleep(0.3)
    assert ("working" in capsys.readouterr().err) is terminal


def test_short_work_says_nothing(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with patience("working", after_s=60):
        pass
    assert capsys.readouterr().err == ""
