"""How much code there is, and that it does not grow: whoever lands fewer lowers the numbers."""

import ast
import tokenize

import pytest
from conftest import ROOT

# Code lines (no blanks, comments or docstrings), AST nodes and files. They only fall.
CEILINGS = {
    ("vfplan", "cli"): (30_795, 336_097, 167),
    ("tests",): (26_475, 337_029, 215),
}
NO_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENCODING, tokenize.ENDMARKER,
}  # fmt: skip
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def code_lines(path, tree):
    with path.open("rb") as file:
        tokens = [t for t in tokenize.tokenize(file.readline) if t.type not in NO_CODE]
    lines = {n for token in tokens for n in range(token.start[0], token.end[0] + 1)}
    for node in ast.walk(tree):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            lines -= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return len(lines)


@pytest.mark.parametrize("folders", CEILINGS, ids=" ".join)
def test_the_code_stays_below_its_ceiling(folders):
    paths = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    trees = {path: ast.parse(path.read_text()) for path in paths}
    lines = sum(code_lines(path, tree) for path, tree in trees.items())
    nodes = sum(len(list(ast.walk(tree))) for tree in trees.values())
    counts = (lines, nodes, len(paths))
    assert all(n <= most for n, most in zip(counts, CEILINGS[folders], strict=True)), counts


def test_a_line_of_code_is_no_comment_and_no_docstring(tmp_path):
    path = tmp_path / "three.py"
    path.write_text(
        '"""Told."""\n\n# Why.\ndef f():\n    """Told\n    twice."""\n    return (1,\n2)\n'
    )
    assert code_lines(path, ast.parse(path.read_text())) == 3
