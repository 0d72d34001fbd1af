"""The conformance kit: it is whole, it is the same each time, and the readers agree with it."""

from __future__ import annotations

import json
import re
import sys

import fuzz_bundle
import hostile
import numpy as np
import pytest
from conftest import ROOT, file_with, need_program, output
from docs_modules import load

from vfplan.bundle.content import table
from vfplan.bundle.read import read_bundle
from vfplan.bundle.seal import Trust, read_keys
from vfplan.conformance import __main__ as runner
from vfplan.conformance import vectors
from vfplan.conformance.kit import RENDERED, render, write_kit
from vfplan.errors import BundleError, InputError
from vfplan.io.files import to_json_types

RULE = re.compile(r"^- \*\*([LCVSKM]\d+)\*\*", re.MULTILINE)
# Rules that no file of the folder `invalid` breaks, each with the reason.
NOT_BY_A_FILE = {
    "L11": "binds a writer: a reader cannot know what identifies a patient",
    "C5": "binds a writer: V20 holds what a reader can see of it",
    "S9": "binds a reader: the order in which it works",
    "K5": "binds a reader that renders points: the paths render/drawn_mesh-*.json hold it",
    "M3": "binds a reader to read a file: the valid file newer_minor holds it",
}


@pytest.fixture(scope="module")
def kit(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kit")
    write_kit(folder)
    return folder


def files(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_the_command_writes_the_same_kit_each_time_and_below_2_mb(vfplan_cli, kit, tmp_path):
    assert vfplan_cli("conformance", "--write", tmp_path / "kit", "--json").sound
    assert files(tmp_path / "kit") == files(kit)
    assert sum(map(len, files(kit).values())) < 2_000_000


def test_every_rule_that_a_file_can_break_has_a_vector():
    rules = set(RULE.findall((ROOT / "docs" / "format.md").read_text(encoding="utf-8")))
    assert len(rules) > 40
    broken = {rule for rule, *_ in vectors.VECTORS + vectors.UNTRUSTED}
    assert broken | NOT_BY_A_FILE.keys() == rules
    assert not broken & NOT_BY_A_FILE.keys()


def test_every_vector_has_a_reason_and_a_file_of_its_own(kit):
    names = [name for _, name, *_ in vectors.VECTORS]
    assert len(set(names)) == len(names)
    for name in names:
        assert json.loads((kit / "invalid" / f"{name}.json").read_text())["why"]
    contents = [make(*words) for _, _, _, make, *words in vectors.VECTORS]
    assert len(set(contents)) == len(contents)


def by_the_package(path, trust=None):
    try:
        return to_json_types(read_bundle(path, trust=trust)[0])
    except (BundleError, InputError):
        return None


def test_the_package_agrees_with_the_kit_and_trusts_what_it_signed_and_nothing_else(kit):
    """Without a demand, all of these files are sound."""
    trust = Trust(read_keys(kit / "signed" / "keys.pub"))
    results = runner.judge(kit, by_the_package, lambda path: by_the_package(path, trust))
    assert not [result for result in results if result.problem]
    assert {result.kind for result in results} == {"valid", "invalid", "signed"}
    assert sum(result.kind == "signed" for result in results) == len(vectors.UNTRUSTED) + 1
    for _, name, *_ in vectors.UNTRUSTED:
        assert by_the_package(kit / "signed" / f"{name}.h5") is not None, name


def test_the_runner_finds_a_reader_that_trusts_everything(kit, tmp_path, capsys):
    """It reads all files of `signed`, with the option for keys and without."""
    program = tmp_path / "reader.py"
    script = "import runpy, sys; sys.argv = sys.argv[:2]; runpy.run_path({!r}, run_name='__main__')"
    program.write_text(script.format(str(READER)))
    words = ["--kit", str(kit), "--keys=--keys", sys.executable, str(program)]
    assert runner.main(words) == 1
    wrong = [line for line in capsys.readouterr().out.splitlines() if "must refuse" in line]
    assert len(wrong) == len(vectors.UNTRUSTED)


def test_a_rendered_path_is_what_the_engine_gives(kit):
    paths = sorted((kit / "render").glob("*.json"))
    assert len(paths) == sum(map(len, RENDERED.values()))
    for path in paths:
        expected = json.loads(path.read_text())
        assert render(kit / expected["bundle"], expected["rule"]) == expected
        assert np.abs(np.array(expected["force"])).max() > 0, "the path never touches"


def test_the_runner_says_where_a_reader_is_wrong(kit, tmp_path, capsys):
    """A reader that reads everything as an empty object, and one that dies."""
    program = file_with(tmp_path / "reader.py", "print('{}')\n")
    assert runner.main(["--kit", str(kit), sys.executable, str(program)]) == 1
    printed = capsys.readouterr().out
    assert "reads what it must refuse" in printed
    assert "/@format is missing" in printed


# --- The second reader, and foreign ones --------------------------------------------------------

READER = ROOT / "samples" / "reader" / "vfplan_reader.py"
GOLDEN = sorted((ROOT / "tests" / "data" / "bundles").glob("2.*.h5"))
every_golden_bundle = pytest.mark.parametrize("path", GOLDEN, ids=lambda p: p.stem)


SECOND = load(READER)


def by_the_second(data):
    try:
        return SECOND.read(data)
    except SECOND.FormatError:
        return None


def test_the_second_reader_agrees_with_the_kit(kit):
    results = runner.judge(kit, lambda path: by_the_second(path.read_bytes()))
    assert not [result for result in results if result.problem]
    assert {result.kind for result in results} == {"valid", "invalid"}


def test_the_second_reader_is_a_program_of_the_standard_library(kit):
    read = runner.command_reader([sys.executable, "-I", "-S", str(READER)])
    path = kit / "valid" / "curve.h5"
    assert read(path) == by_the_package(path)
    assert read(kit / "invalid" / "no_seal.h5") is None


@every_golden_bundle
def test_the_second_reader_reads_every_golden_bundle(path):
    assert SECOND.read(path.read_bytes()) == by_the_package(path)


def test_the_second_reader_gives_the_same_verdict_of_hostile_files():
    for name, data, is_read in hostile.files():
        assert (by_the_second(data) is not None) == is_read, name


def test_the_second_reader_gives_the_same_verdict_of_mutants():
    """Of files that were changed and sealed anew, as far as the page says what a reader does."""
    for number, data in enumerate(fuzz_bundle.mutants(0, 1000)):
        assert by_the_second(data) == by_the_package(data), number


@every_golden_bundle
def test_pyfive_reads_the_same_values(path):
    pyfive = pytest.importorskip("pyfive", reason="pyfive is not installed")
    with pyfive.File(path) as file:
        for where, value in read_bundle(path)[0].items():
            group, _, name = where.partition("@")
            found = file[group].attrs[name] if name else file[group][...]
            assert plain(found) == plain(value), where


@every_golden_bundle
@pytest.mark.parametrize("library", ["h5wasm", "jsfive"])
def test_javascript_reads_the_same_values(library, path):
    """Where `npm install --prefix build/js h5wasm jsfive` was run."""
    folder = ROOT / "build" / "js"
    if not (folder / "node_modules" / library).is_dir():
        pytest.skip(f"{library} is not in build/js: npm install --prefix build/js {library}")
    node = need_program("node", "nodejs")
    values = read_bundle(path)[0]
    script = ROOT / "tests" / "support" / "foreign.mjs"
    printed = json.loads(output(node, script, library, folder, path, *values, timeout=60))
    for where, value in values.items():
        assert flat(printed[where]) == flat(plain(value)), where


@every_golden_bundle
def test_rust_reads_the_same_values(path):
    """hdf5-pure, where its program was built with cargo."""
    program = ROOT / "build" / "rust" / "debug" / "foreign"
    if not program.is_file():
        build = "cargo build --manifest-path tests/support/foreign_rust/Cargo.toml"
        pytest.skip(f"hdf5-pure is not in build/rust: {build} --target-dir build/rust")
    values = read_bundle(path)[0]
    types = {row.path: row.type for row in table()}
    typed = (f"{types[where]}:{where}" for where in values)
    printed = json.loads(output(program, path, *typed, timeout=60))
    for where, value in values.items():
        assert printed[where] == flat(plain(value)), where


def flat(value):
    """The numbers or texts of nested lists, in order."""
    return [item for part in value for item in flat(part)] if isinstance(value, list) else [value]


def plain(value):
    """Numbers and texts as Python has them."""
    if isinstance(value, bytes):
        return value.rstrip(b"\0").decode()
    if isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim):
        return [plain(item) for item in value]
    return plain(value.item()) if isinstance(value, (np.generic, np.ndarray)) else value
