"""Figures of the pages that are not times are those of this build: made anew, and compared."""

import itertools
import re
import subprocess
import sys
from importlib import import_module

import pytest
from conftest import ROOT

from vfplan.bench import pipeline
from vfplan.bench.peers import Peer
from vfplan.stability.study import study

pytestmark = pytest.mark.slow
ACCURACY, STABILITY, ENGINE = (
    (ROOT / "docs" / f"{name}.md").read_text() for name in ("accuracy", "stability", "engine")
)
TIMES = re.compile(r"[\d.]+( / [\d.]+)? (µs|ns|ms)\b|takes [\d.]+ times")


@pytest.fixture
def program(monkeypatch):
    """A program of docs/ by its name."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    return import_module


def block(page, name):
    """What stands on a page in the place of a name."""
    return re.search(rf"<!-- {name} -->\n(.*?)\n<!-- end", page, re.DOTALL)[1]


def without_times(text):
    """A text without its times, and without peers that are optional."""
    text = re.sub(r"; penalty by \w+ takes[^;]+?of them", "", " ".join(text.split()))
    return TIMES.sub("T", text)


def test_accuracy(program, monkeypatch, nanoflann_peer):
    monkeypatch.setattr(pipeline, "REPEATS", 1)
    peers = [nanoflann_peer, Peer(f"{nanoflann_peer.command} penalty", "nearest-point penalty")]
    document = pipeline.bench(peers=peers)
    for name, table in program("accuracy_tables").TABLES.items():
        if name != "machine":
            made, shown = without_times(table(document)), without_times(block(ACCURACY, name))
            assert made == shown, name


def test_the_readme_quotes_the_sentence():
    sentence = " ".join(block(ACCURACY, "summary").strip("`").split())
    assert sentence.split(";")[0] in (ROOT / "README.md").read_text()


def test_feel_and_sweeps(program):
    assert program("make_feel").make() == block(ACCURACY, "feel")
    made, shown = (
        [row.split("|")[:4] for row in text.splitlines()]
        for text in (program("make_sweeps").make(), block(ACCURACY, "sweeps"))
    )
    assert made == shown


def test_stability(program):
    cases = [row.as_dict() for row in study().rows]
    for make in (program("make_stability").loops, program("make_stability").passivity):
        assert "\n".join(make(cases)) == block(STABILITY, make.__name__)
    shown = block(STABILITY, "extremes")
    assert all(row in shown for row in program("make_stability").extremes(cases))


def test_left_out(program):
    assert program("make_left_out").make() == block(ENGINE, "left-out")


def test_exact_and_meshes(program):
    for line in program("make_exact").rows():
        assert line[:-20] in ENGINE
    for line in itertools.islice(program("make_mesh").rows(), 2, None):
        shown = next(text for text in ENGINE.splitlines() if text.startswith(line[:56]))
        assert shown[67:87] == line[67:87]


def test_trembling():
    tests = [sys.executable, "-m", "pytest", "-q", "-s", "tests/engine/test_rests.py", "-k",
             "trembling"]  # fmt: skip
    said = subprocess.run(tests, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    lines = [line.lstrip(".") for line in said.splitlines() if "noise 1 b" in line]
    assert lines
    assert "\n".join(lines) in ENGINE
