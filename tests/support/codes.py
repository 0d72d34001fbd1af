"""Codes of errors and findings: which the sources give, which the tests name, which they raise."""

from __future__ import annotations

import ast
import functools
import os
from contextlib import suppress
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
# The variable that names the file to which each process adds the codes that it raised.
RAISED = "VFPLAN_CODES_RAISED"

_raised: set[str] = set()


def watch() -> None:
    """Remember each code of an error, a finding or an issue that this process makes from now on."""
    from vfplan.bundle.validation import Issue
    from vfplan.errors import VfplanError
    from vfplan.findings import Finding

    for kind in (VfplanError, Finding, Issue):
        kind.__init__ = _watched(kind.__init__)


def _watched(make):
    @functools.wraps(make)
    def made(self, *args, **words):
        make(self, *args, **words)
        _raised.add(self.code)

    return made


def tell() -> None:
    """Add what this process raised to the file."""
    if RAISED in os.environ:
        with suppress(OSError), open(os.environ[RAISED], "a") as file:
            file.writelines(f"{code}\n" for code in _raised)


def left() -> list[str]:
    """The codes in the sources that no test names and no process raised."""
    from docs_modules import load

    findings = load(TESTS.parent / "docs" / "make_findings.py")
    held = set(Path(os.environ[RAISED]).read_text().split())
    for path in TESTS.rglob("*.py"):
        nodes = ast.walk(ast.parse(path.read_text()))
        held |= {node.value for node in nodes if isinstance(node, ast.Constant)}
    return sorted({entry.code for entry in findings.collect()} - held)
