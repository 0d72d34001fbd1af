"""`vfplan review`: its address, its exit codes, and what it writes, without a browser."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys

import bundles
import cv2
import numpy as np
import pytest
from conftest import names_in
from refusals import refuses
from review_slices import MARKERS, SLICE, fork, two_candidates
from slicer_files import marker_files
from tab import Tab
from vector_files import RING_MM, slicer

import vfplan
from vfplan.bundle import review_digest
from vfplan.errors import CurveError

ADDRESS = re.compile(r"http://127\.0\.0\.1:(\d+)/#([\w-]{43})\n")


def heed_interrupts():
    """Let the command be interrupted, also where the tests run in a shell's background."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Review(Tab):
    """The command, and a page's connection to it."""

    def __init__(self, *words):
        command = [sys.executable, "-m", "vfplan", "review", *map(str, words), "--no-browser"]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(
            command, stdout=pipe, stderr=pipe, text=True, preexec_fn=heed_interrupts
        )
        line = self.process.stdout.readline()
        found = ADDRESS.fullmatch(line)
        assert found, (line, self.process.stderr.read())
        self.port, self.token = found.groups()
        super().__init__(self)
        self.__enter__()
        self.heard("quick")

    def step(self, **step):
        self.send(step=step)
        return self.heard("quick")["quick"]

    def approve(self):
        """Look at the line, answer all and approve; what the page then shows."""
        self.step(do="viewed")
        for number, finding in enumerate(self.heard("state")["state"]["findings"]):
            if finding["severity"] == "doubt" and finding["answered_by"] is None:
                self.step(do="answer", finding=number, by="A. Planner")
        super().approve()
        self.approved = self.digest
        return self.heard("approved")["approved"]["text"]

    def end(self):
        self.__exit__(None, None, None)
        out, err = self.process.communicate(timeout=60)
        return self.process.returncode, out, err


@pytest.fixture(scope="module")
def fixture(tmp_path_factory):
    planned = vfplan.plan(SLICE, *MARKERS).fixture
    return bundles.stored(tmp_path_factory.mktemp("planned") / "f.h5", planned)


@pytest.mark.parametrize("words", [(SLICE,), (SLICE, *MARKERS, "--pixel-spacing", 0.5)])
def test_a_slice_is_approved_and_written(words, tmp_path):
    output = tmp_path / "o.h5"
    review = Review(*words, "-o", output, "--by", "A. Planner")
    assert not (tmp_path / "o.h5.draft.json").exists()
    review.step(do="reverse")
    assert (tmp_path / "o.h5.draft.json").exists()
    assert review.approve() == "o.h5 is written."
    code, out, err = review.end()
    assert code == 0, err
    assert "approved by A. Planner" in out
    assert vfplan.read_fixture(output).reviewed.by == "A. Planner"
    assert names_in(tmp_path) == ["o.h5"]


def test_an_approved_bundle_outlives_a_stdout_that_is_gone(tmp_path):
    review = Review(SLICE, "-o", tmp_path / "o.h5")
    review.step(do="reverse")
    review.process.stdout.close()
    assert review.approve() == "o.h5 is written."
    review.process.send_signal(signal.SIGTERM)  # It changes nothing any more.
    review.process.stdout = None
    assert review.end()[0] == 2
    assert vfplan.read_fixture(tmp_path / "o.h5").reviewed.by == "A. Planner"
    assert names_in(tmp_path) == ["o.h5"]


@pytest.mark.parametrize("with_slice", [False, True])
def test_a_fixture_is_approved_by_the_digest_of_its_sheet(
    fixture, with_slice, tmp_path, vfplan_cli
):
    output = tmp_path / "o.h5"
    words = ("--slice", SLICE) if with_slice else ()
    review = Review(fixture, *words, "-o", output)
    review.approve()
    assert review.end()[0] == 0
    run = vfplan_cli("review", output, "--sheet-out", tmp_path / "s.png", "--json", *words)
    assert run.json["digest"] == review.approved
    approved = vfplan.read_fixture(output)
    assert approved.reviewed.digest == review_digest(approved)


@pytest.mark.skipif(sys.platform != "linux", reason="xdg-open is Linux's")
@pytest.mark.parametrize("is_there", [False, True])
def test_without_a_browser_the_address_is_said_and_no_noise(is_there, tmp_path):
    if is_there:
        program = tmp_path / "xdg-open"
        program.write_text(
            '#!/bin/sh\nPATH=/usr/bin:/bin\nstat -c %a "$1" > "$1.seen"\ncat "$1" >> "$1.seen"\n'
            'echo "$@" >> "$1.seen"\necho firefox: not found >&2\necho tried all\nexit 3\n'
        )
        program.chmod(0o755)
    command = [sys.executable, "-m", "vfplan", "review", SLICE, "-o", tmp_path / "o.h5"]
    pipe = subprocess.PIPE
    review = subprocess.Popen(
        command, stdout=pipe, stderr=pipe, text=True, env={**os.environ, "PATH": str(tmp_path)},
        preexec_fn=heed_interrupts,
    )  # fmt: skip
    address = review.stdout.readline().strip()
    warning = review.stderr.readline()
    review.send_signal(signal.SIGINT)
    out, err = review.communicate(timeout=60)
    if is_there:
        # The browser gets a file that its own user alone can read, and no token as an argument.
        mode, leading, arguments = (tmp_path / "o.h5.page.html.seen").read_text().splitlines()
        assert (mode, arguments) == ("600", str(tmp_path / "o.h5.page.html"))
        assert f"url={address}" in leading
    assert not (tmp_path / "o.h5.page.html").exists()
    assert address in warning
    assert "--no-browser" in warning
    for noise in ("firefox", "tried all"):
        assert noise not in warning + out + err


@pytest.mark.parametrize("is_signed", [False, True])
def test_the_next_step_names_the_case(fixture, is_signed, tmp_path, vfplan_cli):
    key = tmp_path / "k.key"
    vfplan_cli("keygen", "-o", key)
    source, output = fixture, tmp_path / "o.h5"
    words = ("--key", key, "--case", "C 1")
    if not is_signed:
        # An earlier signature says which case it was.
        source, words = tmp_path / "s.h5", ()
        options = ("--key", key, "--case", "C 1", "--despite-findings", "-o", source)
        assert vfplan_cli("sign", fixture, *options).sound
    review = Review(source, "--slice", SLICE, *words, "-o", output)
    review.approve()
    code, out, _ = review.end()
    assert code == 0
    following = shlex.split(out.splitlines()[-1].removeprefix("next: "))
    assert following[following.index("--case") + 1] == "C 1"
    following = [str(key) if word == "KEY" else word for word in following]
    assert vfplan_cli(*following[1:]).sound


@pytest.mark.slow
def test_leaving_and_a_signal_write_no_bundle_and_keep_the_draft(tmp_path):
    output = tmp_path / "o.h5"
    for end in ("leave", signal.SIGINT, signal.SIGTERM):
        review = Review(SLICE, "-o", output)
        review.step(do="reverse", stroke=0)
        if end == "leave":
            review.send(leave=True)
        else:
            review.process.send_signal(end)
        code, _, err = review.end()
        assert code == 1, err
        assert "left without approval" in err
    steps = json.loads((tmp_path / "o.h5.draft.json").read_text())["steps"]
    assert [step["do"] for step in steps] == ["reverse"] * 3
    assert not output.exists()


WRONG_CALLS = [
    ((SLICE,), 2), ((SLICE, "-o", "/proc/o.h5"), 2), ((SLICE, "-o", "mine.h5"), 2),
    ((SLICE, "-o", "o.h5", "--sheet-out", "s.png"), 2), ((SLICE, "-o", "o.h5", "--case", "c"), 2),
    ((SLICE, "--sheet-out", "s.png", "--port", 1), 2),
    ((SLICE, "-o", "o.h5", "--curve", MARKERS[0]), 3), ((SLICE, "-o", "o.h5", "--slice", SLICE), 2),
    ((SLICE, "--sheet-out", "s.png", "--slice", SLICE), 2),
    ((SLICE, "-o", "o.h5", "--key", "no.key"), 3), ((SLICE, "-o", "o.h5", "--by", "\u3164"), 2),
    ((SLICE, "-o", "o.h5", "--key", MARKERS[0]), 3),
    ((MARKERS[0], "-o", "o.h5"), 3),
]  # fmt: skip


@pytest.mark.parametrize("words, code", WRONG_CALLS)
def test_wrong_calls_end_before_any_page(words, code, vfplan_cli, tmp_path, monkeypatch):
    """Also where the folder takes no file, and where the output exists."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.h5").write_bytes(b"mine")
    run = vfplan_cli("review", *words, "--no-browser")
    assert (run.code, run.stdout) == (code, ""), run.stderr
    assert "/proc/o.h5" not in words or "/proc/o.h5" in run.error_line
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("mine.h5", b"mine")]


def test_a_plan_too_large_for_a_page_names_a_command_that_works(vfplan_cli, fixture, tmp_path):
    run = vfplan_cli("review", fixture, "--print-out", tmp_path / "p.pdf")
    assert run.code == 3
    words = shlex.split(run.error_line.split("their corners: vfplan ")[1])
    files = {"FIXTURE.h5": fixture, "CAMERA": SLICE, "CALIB.json": MARKERS[0],
             "TAGS.csv": MARKERS[0]}  # fmt: skip
    # It is read as a command, and stops at the calibration, which is none.
    command = [str(files.get(word, word)) for word in words]
    assert vfplan_cli(*command, "-o", tmp_path / "o.png").code == 3


def test_refusals_name_the_command_that_mends_them(vfplan_cli, tmp_path):
    path, _ = two_candidates(tmp_path / "slice.png")
    run = vfplan_cli("review", path, "--sheet-out", tmp_path / "s.png")
    assert (run.code, (tmp_path / "s.png").exists()) == (3, True)
    assert f"vfplan review {path} -o {tmp_path / 'slice-approved.h5'}" in run.stderr


def test_the_command_of_a_refusal_has_the_options_that_were_typed(vfplan_cli, tmp_path):
    path, _ = fork(tmp_path / "slice.png")
    typed = ["--colour", "#ff0000", "--max-gap=15", "--exclude", "0,0,9,9", "--exclude", "20,0,9,9"]
    output = tmp_path / "o.h5"
    refused = vfplan_cli("extract", path, *typed, "-o", output, "--overlay-out", tmp_path / "v.png")
    command = refused.stderr.split("vfplan review ")[1].splitlines()[0]
    words = shlex.split(command)
    as_json = vfplan_cli("extract", path, *typed, "-o", output, "--json").json["error"]["message"]
    assert shlex.split(as_json.split("vfplan review ")[1]) == words
    assert words == [str(path), *typed, "-o", str(output)]
    review = Review(*words)
    state = review.heard("state")["state"]
    assert state["refusal"]["code"] == "line-forks"
    assert state["refusal"]["place_px"]
    assert state["boxes"] == [[0, 0, 9, 9], [20, 0, 9, 9]]
    review.send(leave=True)
    assert review.end()[0] == 1


def test_a_refused_dotted_line_is_marked_on_its_picture(tmp_path):
    picture, path = np.full((400, 600, 3), 90, np.uint8), tmp_path / "s.png"
    for u in range(40, 560, 24):
        cv2.line(picture, (u, 200), (u + 12, 200), (0, 0, 255), 3)
    picture[190, 564:568, 2] = 255  # a speck
    cv2.imwrite(str(path), picture)
    with refuses(CurveError, "line-dotted") as refused:
        vfplan.extract(path)
    [line] = refused.value.lines
    assert np.abs(line[:, 1] - 200).max() < 1
    assert np.ptp(line[:, 0]) > 480
    assert refused.value.numbers["v_px"] == pytest.approx(200, abs=1)


def following(run):
    """The words of the command that a run printed as its next step."""
    assert run.code == 0, run.stderr
    [written] = [line for line in run.stdout.splitlines() if line.startswith("wrote ")]
    assert shlex.split(written)[1].rstrip(",").endswith((".h5", ".png"))
    return shlex.split(run.stdout.splitlines()[-1].split("vfplan ")[-1])


def test_next_steps_without_a_slice_take_the_same_files(vfplan_cli, tmp_path):
    """Of a curve that was set in Slicer, in a folder whose name has a blank."""
    folder = tmp_path / "case 1"
    folder.mkdir()
    curve = slicer(folder, RING_MM, "ClosedCurve")
    places = RING_MM[::4] + np.random.default_rng(1).normal(0, 4, (6, 3))
    labels = [f"M{k}" for k in range(len(places))]
    markers = marker_files(folder, labels, places, 1e-3 * places + (0.4, 0.1, 0.2))
    run = vfplan_cli("plan", curve, *markers, "--model", "rigid", "-o", folder / "p.h5")
    accept = following(run)
    assert accept[:2] == ["accept", str(folder / "p.h5")]
    accept = ["A. Planner" if word == "NAME" else word for word in accept]
    assert vfplan_cli(*accept, "--answer-all").sound
    vfplan_cli("extract", curve, "-o", folder / "c.h5")
    for source, command in ((curve, "plan"), (folder / "c.h5", "register")):
        sheet = "--model", "rigid", "--sheet-out", folder / f"{command}.png"
        words = following(vfplan_cli("review", source, *markers, *sheet))
        assert words[:4] == [command, *map(str, (source, *markers))]
        assert vfplan_cli(*words).sound
