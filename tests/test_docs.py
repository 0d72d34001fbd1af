"""The documentation is true: it is current, links lead somewhere, names exist, pages are short."""

from __future__ import annotations

import re

import pytest
from conftest import ROOT
from docs_modules import load

words = load(ROOT / "docs" / "count_words.py")
# Of prose on all pages together.
MOST_WORDS = 20_000
PAGES = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")])


def test_command_reference_is_what_help_says():
    page = (ROOT / "docs" / "cli.md").read_text()
    assert page == load(ROOT / "docs" / "make_cli.py").reference(), "run `make docs`"


def test_every_command_has_help_for_itself_and_each_option():
    from vfplan.cli.main import COMMANDS, cli

    for name in COMMANDS:
        command = cli.get_command(None, name)
        assert command.help, name
        for parameter in command.params:
            if parameter.param_type_name == "option":
                assert parameter.help, f"{name} {parameter.opts}"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_and_pictures_exist(page):
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text()):
        if "://" not in target:
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_files_named_in_the_architecture_exist():
    text = (ROOT / "docs" / "architecture.md").read_text()
    paths = re.findall(r"`((?:vfplan|cli|schemas|docs|tests)/[\w./-]*)`", text)
    assert len(paths) > 20
    for path in paths:
        assert (ROOT / path).exists(), path


def test_names_in_the_controllers_table_stand_in_their_headers():
    text = (ROOT / "docs" / "controller.md").read_text()
    rows = re.findall(r"^\| (`vfplan/[^|]*) \| (.*) \|$", text, re.MULTILINE)
    assert len(rows) >= 10
    include = ROOT / "vfplan" / "native" / "include"
    for headers, names in rows:
        # A header may include the one that defines the name, so its folder is searched as well.
        code = ""
        for header in re.findall(r"`(vfplan/[\w./]+)`", headers):
            code += (include / header).read_text()
            for path in (include / header).parent.glob("*.hpp"):
                code += path.read_text()
        for name in re.findall(r"`(?:bundle::)?([A-Za-z_]\w*)", names):
            if not name.startswith("vfplan"):
                assert re.search(rf"\b{name}\b", code), f"{headers}: {name}"


def test_words_of_the_glossary_are_used_in_the_code():
    code = ""
    for folder in ("vfplan", "cli", "schemas"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in (".py", ".hpp", ".cpp", ".js", ".html", ".toml"):
                code += path.read_text()
    # A name such as `review_sheet` or `ReviewSheet` uses the words "review sheet".
    code = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", code)
    code = re.sub(r"[_\-\s]+", " ", code).lower()
    page = (ROOT / "docs" / "glossary.md").read_text()
    entries = re.findall(r"^\| ((?!word)[^|-][^|]*) \| ", page, re.MULTILINE)
    assert 50 < len(entries) < 80
    assert len(entries) == len(set(entries))
    for entry in entries:
        for word in entry.split(", "):
            plain = re.sub(r"[_-]", " ", word).lower()
            assert re.search(rf"\b{re.escape(plain)}s?\b", code), word


@pytest.mark.parametrize("page", words.pages(), ids=lambda page: page.stem)
def test_sentences_are_short(page):
    counted = words.count(page.read_text())
    assert counted.words_a_sentence <= words.MAX_WORDS_A_SENTENCE


def test_all_pages_together_are_no_more_than_a_book():
    assert sum(words.count(page.read_text()).words for page in words.pages()) <= MOST_WORDS


def test_each_promise_of_security_names_a_test_that_exists():
    rows = (ROOT / "docs" / "security.md").read_text().split("## Written whole")[0].splitlines()
    promises = [row for row in rows if row.startswith("| ") and not row.startswith("| what")]
    assert len(promises) >= 15
    for row in promises:
        named = re.findall(r"`(tests/[^`:]+)::([^`]+)`", row)
        assert named, row
        for path, test in named:
            assert f"def {test}(" in (ROOT / path).read_text(), test
