"""What the folder, the files and the terminal around a command may do to it: nothing."""

from __future__ import annotations

import io
import logging
import os
import signal
import subprocess
import sys
from unittest.mock import Mock

import bundles
import pytest
from click.testing import CliRunner
from conftest import AWAKE, ELBOW, names_in
from vfplan.cli.run import CommandResult, command, printable, progress

import vfplan
from vfplan import view3d
from vfplan.bundle.seal import keygen, sign

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]

# Everything that a program of this kind might import, each a trap.
TRAPS = ["sitecustomize", "multiprocessing", "concurrent", "timeit", "runpy", "pyvista", "vtk",
         "vtkmodules", "cv2", "numpy", "h5py", "scipy", "skimage", "matplotlib", "pydicom",
         "rosbags",
         "cryptography", "click", "PIL", "json", "re", "random", "pickle", "socket", "struct",
         "subprocess", "threading", "zlib", "yaml", "plyfile", "mujoco", "dask",
         "vfplan"]  # fmt: skip


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """A folder of traps, and inputs for every command."""
    folder = tmp_path_factory.mktemp("hostile")
    for name in TRAPS:
        (folder / f"{name}.py").write_text("open('SPRUNG', 'a').write(__name__ + '\\n')\n")
    (folder / "matplotlibrc").write_text("font.size: 40\nsavefig.dpi: 3\n")
    vfplan.write_fixture(bundles.small(), folder / "f.h5")
    for sample in ELBOW:
        (folder / sample.name).write_bytes(sample.read_bytes())
    (folder / "s.csv").write_text("t,x,y,z\n0,0,0,0.03\n0.001,0,0,0.03\n0.002,0,0,0.03\n")
    (folder / "p.csv").write_text("x,y,z\n0,0,0\n1,0,0\n")
    return folder


PICTURES = "--mask-out m.png --overlay-out o.png --picture-out r.png"
MARKERS = "elbow_markers_image.csv elbow_markers_robot.csv"
PLAN = f"plan elbow.png {MARKERS} --pixel-spacing 0.5 {PICTURES}"
WORDS = ["--version", f"{PLAN} -o p.h5", "replay f.h5 s.csv -o r.h5 --csv r.csv --report page",
         "validate f.h5", "info f.h5", "keygen -o k", "diff f.h5 f.h5",
         "sign f.h5 --key k --despite-findings -o signed.h5", "verify signed.h5 --keys k.pub",
         "view f.h5 r.h5", "import p.csv --units mm -o i.h5", "export f.h5 -o e.ply",
         "stability f.h5 --part closed-loop --jobs 2 -o s"]  # fmt: skip
LONG_WORDS = ["extract elbow.png --pixel-spacing 0.5 -o c.h5", "demo -o demo",
              f"register c.h5 {MARKERS} -o g.h5",
              "replay f.h5 s.csv -o r.h5", "view f.h5 r.h5 --screenshot v.png",
              "bench sample --quick -o b"]  # fmt: skip


@pytest.mark.parametrize("calls", [
    pytest.param(WORDS, marks=pytest.mark.slow, id="most"),
    pytest.param(LONG_WORDS, marks=pytest.mark.full, id="long"),
])  # fmt: skip
def test_no_file_of_the_current_folder_is_run_or_heeded(vfplan_cli, hostile, calls):
    env = {"DISPLAY": ":9999"}  # where no screen is: `view` tries, in a process of its own
    for words in calls:
        run = vfplan_cli(*words.split(), cwd=hostile, env=env)
        wanted = (2,) if words == "view f.h5 r.h5" else (0, 1)
        if "--screenshot" in words:
            wanted = (0, 2)
        assert run.code in wanted, (words, run.stderr)
        assert "Bad" not in run.stderr, words
        assert "unforeseen" not in run.stderr, words
        assert not (hostile / "SPRUNG").exists(), (words, (hostile / "SPRUNG").read_text())


@pytest.mark.full
def test_pictures_do_not_depend_on_settings_that_lie_about(tmp_path, hostile, vfplan_cli):
    for cwd, out in ((hostile, "a"), (tmp_path, "b")):
        assert vfplan_cli("replay", hostile / "f.h5", hostile / "s.csv", "--report",
                         tmp_path / out, cwd=cwd).sound  # fmt: skip
    first, second = ((tmp_path / name / "index.html").read_text() for name in "ab")
    pictures = [[part[:4000] for part in text.split("data:image/png;base64,")[1:]]
                for text in (first, second)]  # fmt: skip
    assert pictures[0] == pictures[1]
    assert len(pictures[0]) >= 2


# --- What a terminal is told -------------------------------------------------------------------


def test_signs_that_steer_a_terminal_are_spelled_out():
    assert printable("a\x1b[2Jb\x9bc\r\x07") == "a\\x1b[2Jb\\x9bc\\r\\x07"
    assert printable("left\u202eright\u2066\ud800") == "left\\u202eright\\u2066\\ud800"
    assert printable("µm, é, \u4e2d\u6587\n -> \U0001f600") == "µm, é, \u4e2d\u6587\n -> \U0001f600"


@command("named")
def named() -> CommandResult:
    """Tell of a name that somebody made up."""
    logging.getLogger("vfplan").warning("read \x1b[31mred")
    return CommandResult(
        {}, "wrote \x1b]0;owned\x07", warnings=["\x1b[1A up"], failed="\u202eton", verdict="",
        next_step="",
    )  # fmt: skip


@pytest.mark.parametrize("quiet", [[], ["-q"]])
def test_no_name_from_a_file_reaches_the_terminal_raw(quiet):
    """And -q hides neither a warning nor a failure."""
    run = CliRunner().invoke(named, quiet)
    assert (run.exit_code, run.stdout) == (1, "" if quiet else "wrote \\x1b]0;owned\\x07\n")
    told = ["read \\x1b[31mred", "warning: \\x1b[1A up", "failed: \\u202eton"]
    assert run.stderr.splitlines() == [f"vfplan: {line}" for line in told]


def test_q_hides_progress(monkeypatch):
    told = io.StringIO()
    told.isatty = lambda: True

    @command("bar")
    def bar() -> CommandResult:
        """Take long."""
        with progress("working", 10) as done:
            done(10)
        return CommandResult({}, verdict="", next_step="")

    for words, silent in (([], False), (["-q"], True)):
        told.truncate(0)
        monkeypatch.setattr(sys, "stderr", told)
        with pytest.raises(SystemExit):
            bar.main(words)
        assert ("working" not in told.getvalue()) is silent


# --- Children that fail, and windows that are told to close ------------------------------------


def begun(folder, *words):
    """A Python program that is begun, with pipes to it."""
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    return subprocess.Popen([sys.executable, *words], text=True, cwd=folder, **pipes)


WINDOW = """
from unittest.mock import Mock
from vfplan import view3d
from vfplan.cli.run import CommandResult, command

window = Mock()
window.iren.process_events = lambda: print("open", flush=True)
window.close = lambda: print("closed", flush=True)

@command("look")
def look():
    view3d.handle_events(window)
    return CommandResult({}, verdict="", next_step="")

look([])
"""


@pytest.mark.parametrize("number", SIGNALS)
def test_an_open_window_heeds_signals(number, tmp_path):
    child = begun(tmp_path, "-c", AWAKE + WINDOW)
    assert child.stdout.readline() == "open\n"
    child.send_signal(number)
    out, err = child.communicate(timeout=60)
    assert (child.returncode, out.splitlines()[-1]) == (128 + number, "closed")
    assert f"stopped by {number.name}" in err


def test_a_window_that_is_closed_ends_the_view():
    window = Mock()
    observed = window.iren.add_observer
    window.iren.process_events = lambda: observed.call_args.args[1](None, None)
    view3d.handle_events(window)
    assert observed.call_args.args[0] == "ExitEvent"
    window.close.assert_called_once_with()


WAITING = """
import sys, threading
from vfplan.cli.run import CommandResult, command

def tell():
    print("waiting", flush=True)
    sys.stdin.readline()
    signal.pthread_kill(threading.get_ident(), int(sys.argv[1]))  # not to the thread that waits

@command("wait")
def wait():
    threading.Thread(target=tell, daemon=True).start()
    threading.Event().wait()
    return CommandResult({}, verdict="", next_step="")

wait([])
"""


@pytest.mark.parametrize("number", SIGNALS)
def test_a_wait_without_an_end_is_left_at_the_first_signal(number, tmp_path):
    """The system gives it to another thread: no wait is interrupted, as by one that comes early."""
    child = begun(tmp_path, "-c", AWAKE + WAITING, str(int(number)))
    assert child.stdout.readline() == "waiting\n"
    _, err = child.communicate("go\n", timeout=60)
    assert child.returncode == 128 + number
    assert f"stopped by {number.name}" in err


BUSY = """
import sys, time
from vfplan.cli.run import CommandResult, command
from vfplan.io.sandbox import worker_processes

def main():
    @command("long")
    def long():
        with worker_processes(2) as pool:
            for done in [pool.submit(time.sleep, 3600) for _ in range(4)]:
                print("busy", flush=True)
                while not done.running():
                    time.sleep(0.01)
                print("running", flush=True)
                done.result()
        return CommandResult({}, verdict="", next_step="")
    long([])

if __name__ == "__main__":
    main()
"""


@pytest.mark.parametrize("number", SIGNALS)
def test_long_work_in_processes_ends_with_the_program(number, tmp_path):
    """Not after the hour that its workers would take; and none of them is left."""
    (tmp_path / "busy.py").write_text(AWAKE + BUSY)
    child = begun(tmp_path, "busy.py")
    assert child.stdout.readline() == "busy\n"
    assert child.stdout.readline() == "running\n"
    child.send_signal(number)
    child.communicate(timeout=300)  # the workers hold the pipes: they are gone too
    assert child.returncode == 128 + number


def test_a_key_of_somebody_else_is_not_signed_with(tmp_path, monkeypatch):
    key = tmp_path / "k"
    keygen(key)
    vfplan.write_fixture(bundles.small(), tmp_path / "f.h5")
    user = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: user + 1)
    with pytest.raises(vfplan.errors.InputError, match=f"another user \\(id {user}\\)"):
        sign(tmp_path / "f.h5", tmp_path / "s.h5", key)
    assert names_in(tmp_path) == ["f.h5", "k", "k.pub"]
