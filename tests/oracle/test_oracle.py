"""What must not change by accident is what tests/data/oracle holds; see the README there."""

from dataclasses import replace

import pytest
from conftest import ROOT, need_program
from oracle import documents, engine, labels, renew, replays, slices

FOLDER = ROOT / "tests" / "data" / "oracle"


def frozen(part, name):
    return part.parsed((FOLDER / name).read_text())


def same(before, now):
    """Fail with every line of {name: line} that is not the same, as it was and as it is."""
    lines = []
    for name in sorted(before.keys() | now.keys()):
        was, is_ = before.get(name, "absent"), now.get(name, "absent")
        if was != is_:
            lines.append(f"{name}\n    was {was}\n    is  {is_}")
    assert not lines, "\n".join(lines)


def none(lines):
    assert not lines, "\n".join(lines)


@pytest.mark.slow
def test_the_engine_gives_the_same_bits():
    compiler = need_program("g++", "g++")
    before = frozen(engine, "engine.txt")
    assert len(before) == 64
    same(before, engine.sums(ROOT, engine.TICKS["engine.txt"], compiler=compiler))


@pytest.mark.full
@pytest.mark.parametrize("width", [2, 4, 8])
def test_the_engine_gives_the_same_bits_with_every_width(width):
    """A processor that lacks a width takes the next smaller one."""
    compiler = need_program("g++", "g++")
    ticks = engine.TICKS["engine-long.txt"]
    now = engine.sums(ROOT, ticks, wide=True, width=width, compiler=compiler)
    same(frozen(engine, "engine-long.txt"), now)


def test_replays_give_the_same_bits():
    same(frozen(replays, "replays.json"), replays.lines(replays.replays()))


@pytest.mark.full
def test_the_sample_controller_gives_the_same_bits():
    """Only here: `make test` compares its logs with the replays of them, to the bit."""
    need_program("g++", "g++")
    same(frozen(replays, "controller.json"), replays.lines(replays.controller_logs(ROOT)))


def quick_and_full(quick, full):
    """The part that `make test` compares, and what `make test-full` does."""
    params = [
        pytest.param(quick, id="quick"),
        pytest.param(full, id="full", marks=pytest.mark.full),
    ]
    return pytest.mark.parametrize("part", params)


@quick_and_full(slices.quick(), slices.every())
def test_no_slice_is_judged_worse(part):
    new = {key: slices.measured(*key) for key in part}
    none(slices.worse(frozen(slices, "slices.csv"), new))


@quick_and_full(labels.QUICK, labels.EVERY)
def test_no_set_of_markers_is_judged_worse(part):
    new = {number: labels.measured(number) for number in part}
    none(labels.worse(frozen(labels, "labels.csv"), new))


@quick_and_full(documents.QUICK, ("plan", *documents.LONG))
def test_json_keeps_its_keys_and_values(part):
    now = documents.documents(part)
    none(documents.different(frozen(documents, "documents.txt"), now))


def test_the_readme_names_every_file_and_every_command_that_renews_a_page():
    readme = (FOLDER / "README.md").read_text()
    files = [path.name for path in FOLDER.iterdir() if path.suffix in (".txt", ".json", ".csv")]
    makers = [path.name for path in (ROOT / "docs").glob("*.py")]
    assert not [name for name in files + makers if name not in readme]
    assert sorted(files) == sorted(renew.WRITERS)


# The comparisons themselves.


def test_a_slice_that_becomes_silently_wrong_is_named():
    before = frozen(slices, "slices.csv")
    assert slices.worse(before, before) == []
    key = "opening", 3
    assert before[key].outcome == "warned"
    now = {**before, key: replace(before[key], outcome="silent", why="closed")}
    (line,) = slices.worse(before, now)
    assert line.startswith("opening 3: silently wrong, closed; was warned")


def test_larger_errors_and_more_refusals_of_slices_are_named():
    before = frozen(slices, "slices.csv")
    lost = [key for key, row in before.items() if row.outcome == "right"][::10]
    now = {**before, **{key: replace(before[key], outcome="falsely refused") for key in lost}}
    assert "clear slices right" in slices.worse(before, now)[0]
    now = {key: replace(row, rms_px=1.5 * row.rms_px) for key, row in before.items()}
    assert [line.split(":")[0] for line in slices.worse(before, now)] == [
        "all clear kinds",
        *slices.QUIET,
    ]


def test_a_label_mistake_that_becomes_silent_is_named():
    before = frozen(labels, "labels.csv")
    assert len(before) == 600
    assert labels.worse(before, before) == []
    now = {**before, 8: replace(before[8], shifted="silent", fre_mm=1.1 * before[8].fre_mm)}
    lines = labels.worse(before, now)
    assert len(lines) == 2
    assert "set 8" in lines[0]
    assert "shifted is silent" in lines[0]


def test_a_value_that_changes_kind_size_or_goes_is_named():
    before = {"info": {"a": 1.0, "b": "exact", "c": "a sentence of words", "d": True, "e": None}}
    now = {
        "info": {"a": 1.0 + 1e-9, "b": "exact", "c": "other words", "d": True, "e": None, "f": 1}
    }
    assert documents.different(before, now) == []
    now = {"info": {"a": 1.001, "b": "robust", "c": 3, "d": 1, "e": 0.0}}
    assert len(documents.different(before, now)) == 4  # True == 1
    assert len(documents.different(before, {"info": {}})) == 5
