"""Figures of the pages that are not times are those of this build: made anew, and compared."""

import itertools
import re
import subprocess
import sys

import pytest
from conftest import ROOT

from vfplan.bench import stages
from vfplan.bench.peers import Peer
from vfplan.stability.study import study

pytestmark = pytest.mark.slow
ACCURACY, STABILITY, ENGINE = (
    (ROOT / "docs" / f"{name}.md").read_text() for name in ("accuracy", "stability", "engine")
)
TIMES = re.compile(r"[\d.]+( / [\d.]+)? (µs|ns|ms)\b|takes [\d.]+ times")


@pytest.fixture
def makers(monkeypatch):
    """The programs of docs/."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    import accuracy_tables
    import make_exact
    import make_feel
    import make_mesh
    import make_stability
    import make_sweeps

    return accuracy_tables, make_exact, make_feel, make_mesh, make_stability, make_sweeps


def block(page, name):
    """What stands on a page in the place of a name."""
    return re.search(rf"<!-- {name} -->\n(.*?)\n<!-- end", page, re.DOTALL)[1]


def without_times(text):
    """A text without its times, and without peers that are optional."""
    return TIMES.sub("T", re.sub(r"; penalty by \w+ takes[^;]+?of them", "", text))


def test_accuracy(makers, monkeypatch, nanoflann_peer):
    monkeypatch.setattr(stages, "REPEATS", 1)
    peers = [nanoflann_peer, Peer(f"{nanoflann_peer.command} penalty", "nearest-point penalty")]
    document = stages.bench(peers=peers)
    for name, table in makers[0].TABLES.items():
        if name != "machine":
            made, shown = without_times(table(document)), without_times(block(ACCURACY, name))
            assert made == shown, name


def test_feel_and_sweeps(makers):
    assert makers[2].make() == block(ACCURACY, "feel")
    made, shown = (
        [row.split("|")[:4] for row in text.splitlines()]
        for text in (makers[5].make(), block(ACCURACY, "sweeps"))
    )
    assert made == shown


def test_stability(makers):
    cases = [row.as_dict() for row in study().rows]
    for make in (makers[4].loops, makers[4].passivity):
        assert "\n".join(make(cases)) == block(STABILITY, make.__name__)
    shown = block(STABILITY, "extremes")
    assert all(row in shown for row in makers[4].extremes(cases))


def test_exact_and_meshes(makers):
    for line in makers[1].rows():
        assert line[:-20] in ENGINE
    for line in itertools.islice(makers[3].rows(), 2, None):
        shown = next(text for text in ENGINE.splitlines() if text.startswith(line[:56]))
        assert shown[67:87] == line[67:87]


def test_trembling():
    tests = [sys.executable, "-m", "pytest", "-q", "-s", "tests/engine/test_rests.py", "-k",
             "trembling"]  # fmt: skip
    said = subprocess.run(tests, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    lines = [line.lstrip(".") for line in said.splitlines() if "noise 1 b" in line]
    assert lines
    assert "\n".join(lines) in ENGINE
