"""docs/findings.md: it is current, and every code that the program can give stands on it."""

from __future__ import annotations

import re
import tomllib

import pytest
from conftest import ROOT
from docs_modules import load

findings = load(ROOT / "docs" / "make_findings.py")
PAGE = ROOT / "docs" / "findings.md"
LITERAL = re.compile(r'\bcode="([a-z][a-z.-]+)"|\b(?:doubt|note|_finding)\(\s*"([a-z-]+)"')
# The kit's findings are made up, and commands that answer findings name a code as an example.
ELSEWHERE = ("conformance",)


def test_the_page_is_current():
    assert PAGE.read_text() == findings.page(), "run python docs/make_findings.py"


def test_every_code_written_in_the_source_stands_on_the_page():
    page = PAGE.read_text()
    missing = set()
    for path in [*(ROOT / "vfplan").rglob("*.py"), *(ROOT / "cli").rglob("*.py")]:
        if path.parent.name in ELSEWHERE:
            continue
        for match in LITERAL.finditer(path.read_text()):
            code = match[1] or match[2]
            if f"`{code}`" not in page:
                missing.add(f"{path.name}: {code}")
    assert not missing


def test_every_class_of_error_stands_on_the_page():
    from vfplan import errors

    page = PAGE.read_text()
    for value in vars(errors).values():
        if isinstance(value, type) and issubclass(value, errors.VfplanError):
            assert f"| `{value.code}` | {value.__name__} | {value.exit_code} |" in page


def test_every_code_of_the_frozen_documents_stands_on_the_page():
    page = PAGE.read_text()
    documents = (ROOT / "tests" / "data" / "oracle" / "documents.txt").read_text()
    codes = set(re.findall(r'\.code = "([^"]+)"', documents))
    assert codes
    for code in codes:
        assert f"`{code}`" in page


def test_no_advice_is_left_of_a_code_that_is_gone():
    advice = tomllib.loads((ROOT / "docs" / "findings.toml").read_text())
    assert set(advice) <= {entry.code for entry in findings.collect()}


@pytest.mark.parametrize(
    ("source", "codes", "sentence"),
    [
        ('raise CurveError(f"is {x} px long", code="short")', ["short"], "is … px long"),
        ('code = "a" if x else "b"\nfail = doubt(code, "plan", "One." + x)', ["a", "b"], "One.…"),
        ('text = f"{x} m"\nfail = note("far", "plan", text)', ["far"], "… m"),
    ],
)
def test_codes_and_sentences_are_read_from_the_source(source, codes, sentence):
    import ast

    lines = "".join(f"    {line}\n" for line in source.splitlines())
    tree = ast.parse(f"def f(x):\n{lines}")
    entries = list(findings.entries_of(tree, "planning"))
    assert [entry.code for entry in entries] == codes
    assert {entry.sentence for entry in entries} == {sentence}
