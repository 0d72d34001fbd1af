"""A write that fails, wherever: one line and exit 2, nothing printed before, nothing changed."""

from __future__ import annotations

import errno
import json
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import bundles
import numpy as np
import pytest
from conftest import ELBOW as SAMPLES
from conftest import file_with, names_in, need_program, output
from replays import write_session

import vfplan
from vfplan.bundle.seal import keygen
from vfplan.io.writing import write_whole
from vfplan.session.session import Session

pytestmark = pytest.mark.slow

TESTS = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def shim(tmp_path_factory):
    target = tmp_path_factory.mktemp("shim") / "fault_shim.so"
    source = TESTS / "native" / "fault_shim.c"
    output(need_program("gcc", "g++"), "-shared", "-fPIC", "-o", target, source, "-ldl")
    return target


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The inputs of every case, and old outputs for those that overwrite."""
    folder = tmp_path_factory.mktemp("faults")
    vfplan.write_fixture(bundles.small(), folder / "f.h5")
    hip = np.linspace([0, 0, 0.02], [0, 0, -0.02], 60)
    write_session(folder / "s.csv", Session(np.arange(60) * 1e-3, hip))
    np.savetxt(folder / "p.csv", np.eye(3), delimiter=",", header="x,y,z", comments="")
    for name in ("old", "old.pub", "old.h5", "old.csv"):
        (folder / name).write_bytes(b"old")
    for sample in SAMPLES:
        (folder / sample.name).write_bytes(sample.read_bytes())
    keygen(folder / "key.pem")
    return folder


ELBOW = ["elbow.png", "--pixel-spacing", "0.5"]
PLAN = ["plan", *ELBOW[:1], "elbow_markers_image.csv", "elbow_markers_robot.csv", *ELBOW[1:]]
CASES = {
    "replay": ["replay", "f.h5", "s.csv", "-o", "r.h5", "--csv", "r.csv"],
    "replay over old files": ["replay", "f.h5", "s.csv", "-o", "old.h5", "--overwrite"],
    "import": ["import", "p.csv", "--units", "m", "-o", "i.h5"],
    "export": ["export", "f.h5", "-o", "x.ply"],
    "sign": ["sign", "f.h5", "--key", "key.pem", "--despite-findings",
             "-o", "old.h5", "--overwrite"],
    "keygen": ["keygen", "-o", "new"],
    "keygen over old keys": ["keygen", "-o", "old", "--overwrite"],
}  # fmt: skip
LONG_CASES = {
    "extract": ["extract", *ELBOW, "-o", "c.h5", "--mask-out", "m.png", "--overlay-out", "o.png"],
    "plan": [*PLAN, "-o", "p.h5", "--picture-out", "r.png"],
    "both rules": ["replay", "f.h5", "s.csv", "-o", "r.h5", "--rule", "both"],
    "report": ["replay", "f.h5", "s.csv", "--report", "page", "-o", "r.h5"],
    "demo": ["demo", "-o", "demo"],
}


def run_cases(shim, folder, cases, number):
    given = [{"name": name, "words": words} for name, words in cases.items()]
    done = subprocess.run(
        [sys.executable, TESTS / "hostile" / "faults.py", folder, str(number)],
        input=json.dumps(given), capture_output=True, text=True, check=False,
        env={**os.environ, "LD_PRELOAD": str(shim), "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def check(rows, words):
    assert {row["case"] for row in rows if row["write"] == -1 and row["code"] == 0}, rows[0]
    for row in rows:
        if row["write"] == -1:  # nothing failed
            assert (row["code"], row["as_before"]) == (0, False), row
            assert row["of"] >= 3
            continue
        assert row["code"] == 2, row
        assert row["stdout"] == "", row
        assert row["stderr"].count("\n") == 1, row
        assert words in row["stderr"], row
        # Where the report cannot be printed, the files that it speaks of are there.
        assert row["as_before"] != ("the report" in row["stderr"]), row


def test_every_write_may_fail_for_want_of_room(shim, folder):
    check(run_cases(shim, folder, CASES, errno.ENOSPC), "No space left on device")


@pytest.mark.full
@pytest.mark.parametrize("number", [errno.EIO, errno.EDQUOT, errno.ENOSPC])
def test_every_write_of_every_command_may_fail(shim, folder, number):
    check(run_cases(shim, folder, CASES | LONG_CASES, number), os.strerror(number))


def limited():
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)


def test_a_file_that_may_not_grow_is_one_line(folder, tmp_path):
    """What a full disk is to a file: every write beyond some point fails, not one of them."""
    program = Path(sys.executable).with_name("vfplan")
    write_session(tmp_path / "s.csv", Session(np.arange(3000) * 1e-3, np.full((3000, 3), 0.03)))
    for option, name in (("-o", "r.h5"), ("--csv", "r.csv")):
        done = subprocess.run(
            [program, "replay", folder / "f.h5", tmp_path / "s.csv", option, tmp_path / name],
            capture_output=True, text=True, check=False, preexec_fn=limited,
        )  # fmt: skip
        assert (done.returncode, done.stdout) == (2, ""), done
        assert "File too large" in done.stderr
        assert done.stderr.count("\n") == 1
        assert names_in(tmp_path) == ["s.csv"]


def test_a_result_is_written_from_python_whole_or_not_at_all(tmp_path):
    """The result's file is not there until it is right, and an error takes it away."""
    replayed = vfplan.replay(bundles.small(), Session(np.arange(20) * 1e-3, np.full((20, 3), 0.03)))
    from vfplan.session.result import ResultWriter, write_result

    path = tmp_path / "r.h5"
    with pytest.raises(KeyError), ResultWriter(path, {}) as writer:  # noqa: PT012
        writer.append(replayed.ticks)
        assert not path.exists()
        raise KeyError
    assert list(tmp_path.iterdir()) == []
    write_result(replayed, path)
    assert names_in(tmp_path) == ["r.h5"]


def test_nothing_is_written_through_a_link_put_there_meanwhile(tmp_path, monkeypatch):
    """Somebody guesses the hidden name and puts a link there: refused, the link's file stays."""
    from vfplan.session.result import CsvWriter

    victim = file_with(tmp_path / "victim", b"theirs")
    monkeypatch.setattr("vfplan.io.writing.hidden_name", lambda *_: tmp_path / "guessed")
    (tmp_path / "guessed").symlink_to(victim)
    for write in (lambda path: write_whole(path, [b"ours"], overwrite=True), CsvWriter):
        with pytest.raises(vfplan.VfplanError, match="File exists"):
            write(tmp_path / "out.csv")
    assert victim.read_bytes() == b"theirs"
