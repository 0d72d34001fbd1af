"""What nobody foresaw once: a clear line with a code, or a command that does what it says."""

from __future__ import annotations

import os
import subprocess
import sys

import bundles
from review_slices import SLICE

import vfplan


def run(*words, **more):
    command = [sys.executable, "-m", *map(os.fsencode, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, **more)


def test_stderr_is_closed(tmp_path):
    words = ("vfplan", "extract", SLICE, "-o", tmp_path / "o.h5")
    assert run(*words, preexec_fn=lambda: os.close(2)).returncode == 0
    assert len(vfplan.read_fixture(tmp_path / "o.h5").points) > 100


def test_a_reader_that_does_not_exist():
    done = run("vfplan.conformance", "nosuchreader")
    assert done.returncode == 2
    assert "nosuchreader cannot be run" in done.stderr.splitlines()[-1]


def test_a_report_of_files_whose_names_are_no_text(tmp_path):
    session = tmp_path / os.fsdecode(b"s\xff.csv")
    session.write_text("t,x,y,z\n0,0,0,0.02\n0.001,0,0,0.019\n0.002,0,0,0.018\n")
    vfplan.write_fixture(bundles.small(), tmp_path / "f.h5")
    done = run("vfplan", "replay", tmp_path / "f.h5", session, "--report", tmp_path / "r")
    assert done.returncode == 0, done.stderr
    assert "\\udcff" in (tmp_path / "r" / "index.html").read_text("utf-8")
