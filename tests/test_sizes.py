"""The house stays readable: short functions, files of one concept."""

from __future__ import annotations

import ast

import numpy as np
from conftest import ROOT

LONGEST_FILE = 300
LONGEST_UNEXPLAINED = 50  # lines of a function without a docstring
NINE_OF_TEN = 20  # lines of a function's body, its docstring left out


def product(*suffixes):
    files = (path for room in ("vfplan", "cli") for path in sorted((ROOT / room).rglob("*")))
    return [path for path in files if path.suffix in suffixes]


def functions():
    """Each function of the product in Python: where, lines of its body, whether it is explained."""
    for path in product(".py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                explained = ast.get_docstring(node, clean=False) is not None
                body = node.body[explained:]
                lines = node.end_lineno - body[0].lineno + 1 if body else 0
                yield f"{path.relative_to(ROOT)}:{node.lineno} {node.name}", lines, explained


def test_no_file_is_too_long_to_be_read_at_once():
    sizes = {p: len(p.read_text().splitlines()) for p in product(".py", ".hpp", ".cpp", ".js")}
    too_long = {str(p.relative_to(ROOT)): n for p, n in sizes.items() if n > LONGEST_FILE}
    assert not too_long


def test_functions_are_short_and_the_long_ones_explained():
    found = list(functions())
    assert len(found) > 1000
    assert np.percentile([lines for _, lines, _ in found], 90) <= NINE_OF_TEN
    assert not [where for where, lines, told in found if lines > LONGEST_UNEXPLAINED and not told]
