"""What every command shares: errors that nobody foresaw, and a word when work takes long."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner
from conftest import AWAKE, names_in, output
from vfplan.cli.run import CommandResult, announce_if_slow, command


@command("boom")
def boom() -> CommandResult:
    """Fail in a way that nobody foresaw."""
    raise KeyError("no such thing")


def test_unforeseen_error_is_one_line_and_exit_3():
    run = CliRunner().invoke(boom, ["--json"])
    assert (run.exit_code, json.loads(run.stdout)["error"]["kind"]) == (3, "KeyError")
    assert "unforeseen KeyError: 'no such thing'" in run.stderr
    assert "Traceback" not in run.stderr
    assert "Traceback" in CliRunner().invoke(boom, ["-vv"]).stderr


@pytest.mark.parametrize("env", [None, {}], ids=["usual", "no_locale"])
@pytest.mark.parametrize("words", [[], ["--json"]], ids=["text", "json"])
def test_a_report_that_cannot_be_written_is_one_line(words, env, tmp_path):
    """A full disk under stdout: exit 2, and the files are there, whole."""
    import bundles

    import vfplan

    program = Path(sys.executable).with_name("vfplan")
    vfplan.write_fixture(bundles.whole(), tmp_path / "a.h5")
    (tmp_path / "old.ply").write_bytes(b"old")
    for name, more in (("new.ply", []), ("old.ply", ["--overwrite"])):
        with open("/dev/full", "w") as full:
            done = subprocess.run(
                [program, "export", tmp_path / "a.h5", "-o", tmp_path / name, *more, *words],
                stdout=full, stderr=subprocess.PIPE, text=True, check=False, env=env,
            )  # fmt: skip
        assert done.returncode == 2, done.stderr
        assert done.stderr.count("\n") == 1
        assert "No space left" in done.stderr
    assert names_in(tmp_path) == ["a.h5", "new.ply", "old.ply"]
    assert (tmp_path / "old.ply").read_bytes() == (tmp_path / "new.ply").read_bytes()


STOPPED = """
import os, signal, sys
from pathlib import Path
from vfplan.cli.outputs import outputs
from vfplan.cli.run import CommandResult, command

class Loud:
    def __del__(self):
        os.kill(os.getpid(), int(sys.argv[2]))
        sum(range(1000))

@command("long")
def long():
    with outputs(Path(sys.argv[1])) as (path,):
        path.write_text("half")
        if sys.argv[3] == "dropped":
            Loud()
        else:
            os.kill(os.getpid(), int(sys.argv[2]))
    return CommandResult({}, verdict="", next_step="")

long(["--json"])
"""


@pytest.mark.parametrize("how", ["raised", "dropped"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_command_told_to_stop_leaves_nothing_behind(number, how, tmp_path):
    """Also where the signal comes inside a destructor, out of which Python raises nothing."""
    words = [sys.executable, "-c", AWAKE + STOPPED, tmp_path / "out.h5", str(int(number)), how]
    done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert (done.returncode, json.loads(done.stdout)["error"]["kind"]) == (128 + number, "Stopped")
    assert f"stopped by {number.name}" in done.stderr.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


def test_an_ignored_signal_stays_ignored(tmp_path):
    script = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)" + STOPPED
    words = [sys.executable, "-c", script, tmp_path / "out.h5", str(int(signal.SIGHUP)), "raised"]
    output(*words, cwd=tmp_path)
    assert names_in(tmp_path) == ["out.h5"]


def test_an_error_on_a_full_disk_keeps_its_exit_code():
    program = Path(sys.executable).with_name("vfplan")
    with open("/dev/full", "w") as full:
        done = subprocess.run([program, "info", "none.h5", "--json"], stdout=full, stderr=full)
    assert done.returncode == 3


@pytest.mark.parametrize("terminal", [True, False])
def test_long_work_says_so_on_a_terminal_only(monkeypatch, capsys, terminal):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    with announce_if_slow("working", after_s=0.01):
        time.sleep(0.3)
    assert ("working" in capsys.readouterr().err) is terminal
