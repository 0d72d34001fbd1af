"""Errors and findings: their tree, their JSON, and docs/findings.md, which holds every code."""

from __future__ import annotations

import inspect
import json
import re
import tomllib

import pytest
from conftest import ROOT
from docs_modules import load

from vfplan import errors
from vfplan.findings import doubt, note

CODES = {
    "InputError": 3, "BundleError": 4, "CheckFailed": 1,
    "SettingError": 2, "OutputError": 2, "MissingExtra": 2,
}  # fmt: skip


def tree():
    return [
        c for _, c in inspect.getmembers(errors, inspect.isclass) if c.__module__ == errors.__name__
    ]


@pytest.mark.parametrize("error", tree(), ids=lambda c: c.__name__)
def test_every_error_stands_in_the_drawing_and_with_a_code_of_its_own_on_the_page(error):
    assert issubclass(error, errors.VfplanError)
    assert error.__name__ in errors.__doc__
    assert re.fullmatch(r"[a-z]+(-[a-z]+)*", error.code)
    assert [c.__name__ for c in tree() if c.code == error.code] == [error.__name__]
    row = f"| `{error.code}` | {error.__name__} | {error.exit_code} |"
    assert row in PAGE.read_text()


@pytest.mark.parametrize("name, code", CODES.items())
def test_exit_code_holds_for_the_whole_branch(name, code):
    base = getattr(errors, name)
    assert all(c.exit_code == code for c in tree() if issubclass(c, base))


DOUBT = doubt("end-unsure", "extract", "The end is known to 2 px only.", place_px=(12.5, 40.0))
KEYS = ["code", "severity", "text", "stage", "place_px", "place_m", "answered_by", "answered_utc"]


@pytest.mark.parametrize(
    "finding",
    [DOUBT, note("side", "register", "The slice is seen from above.", place_m=(0.1, 0.2, 0.3))],
)
def test_json_has_the_keys_that_scripts_rely_on(finding):
    reported = json.loads(json.dumps(finding.as_dict()))
    assert list(reported) == KEYS
    assert reported["severity"] in ("note", "doubt")
    assert reported["answered_by"] is None
    for name in ("place_px", "place_m"):
        place = getattr(finding, name)
        assert reported[name] == (None if place is None else list(place))


page = load(ROOT / "docs" / "make_findings.py")
PAGE = ROOT / "docs" / "findings.md"
LITERAL = re.compile(r'\bcode="([a-z][a-z.-]+)"|\b(?:doubt|note|_finding)\(\s*"([a-z-]+)"')
# The kit's findings are made up, and commands that answer findings name a code as an example.
ELSEWHERE = ("conformance",)


def test_the_page_is_current():
    assert PAGE.read_text() == page.page(), "run python docs/make_findings.py"


def test_every_code_written_in_the_source_stands_on_the_page():
    text = PAGE.read_text()
    missing = set()
    for path in [*(ROOT / "vfplan").rglob("*.py"), *(ROOT / "cli").rglob("*.py")]:
        if path.parent.name in ELSEWHERE:
            continue
        for match in LITERAL.finditer(path.read_text()):
            code = match[1] or match[2]
            if f"`{code}`" not in text:
                missing.add(f"{path.name}: {code}")
    assert not missing


def test_no_advice_is_left_of_a_code_that_is_gone():
    advice = tomllib.loads((ROOT / "docs" / "findings.toml").read_text())
    assert set(advice) <= {entry.code for entry in page.collect()}
