"""What must not change by accident is what tests/data/oracle holds; see the README there."""

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
    said = "\n".join(lines)
    assert not said, said


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
    rows = [pytest.param(quick, id="quick"), pytest.param(full, id="full", marks=pytest.mark.full)]
    return pytest.mark.parametrize("part", rows)


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
    none(documents.different(frozen(documents, "documents.txt"), documents.documents(part)))


def test_the_readme_names_every_file_and_every_command_that_renews_a_page():
    readme = (FOLDER / "README.md").read_text()
    files = [path.name for path in FOLDER.iterdir() if path.suffix in (".txt", ".json", ".csv")]
    makers = [path.name for path in (ROOT / "docs").glob("*.py")]
    assert not [name for name in files + makers if name not in readme]
    assert sorted(files) == sorted(renew.WRITERS)
