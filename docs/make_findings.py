"""Write docs/findings.md: every code of errors and findings that the sources of vfplan hold.

    python docs/make_findings.py            write the page
    python docs/make_findings.py --check    change nothing, exit 1 when the page is not current

The codes and their sentences are read from the syntax trees of vfplan and cli, and those of the
reader of bundles from its headers in C++, so that the page cannot fall behind. What to do about
each finding and each refused slice stands in docs/findings.toml, and also what is seen where the
program puts a sentence together. A value that a sentence fills in at run time is shown as `…`.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from vfplan import errors

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "findings.md"
ADVICE = ROOT / "docs" / "findings.toml"
VALUE = "…"
COMPOSED = {
    "markers-…": ("markers-collinear", "markers-coplanar"),
    "leak.…": ("leak.open_ends", "leak.between", "leak.open_edges"),
}
"""Codes that the source puts together at run time."""
MAKERS = {"doubt": "doubt", "note": "note", "finding_at": "doubt", "finding": "replay"}
"""Functions that make a finding, with the severity that they give it."""
STAGE_OF_PACKAGE = {"curve": "extract", "registration": "register", "markers": "register"}
"""Packages all of whose findings belong to one stage."""

HEAD = """# Findings and errors

<!-- Made by docs/make_findings.py from the sources and docs/findings.toml. Do not edit. -->

Everything that vfplan doubts or refuses has a code. The meaning of a code never
changes, but its sentence may. `--json` reports code, sentence and numbers. The sign `…` stands for
a value of your data.

- A **doubt** wants an answer before `vfplan sign`. Answer it on the page of `vfplan review`, or
  with `vfplan accept`.
- A **note** only informs.
- An **error** ends the command, and nothing is written. The exit code is 1 if a check failed, 2 if
  the command line is wrong, 3 if the input is, and 4 if a bundle cannot be trusted.

![Small slices, each with what vfplan says about it](pictures/findings.png)

Each picture is a slice that `vfplan extract` was given. The ring marks the place that the command
named.
"""

READER = """
## Why a reader refuses a bundle

Exit code 4. C++, Python and `--json` give the same codes. Only for a signature Python and `--json`
give `signature` in place of `signature.…`. The rules stand in the [format](format.md).

| code | what to do, unless the sentence says it more exactly |
|---|---|
"""
READER_HEADERS = ROOT / "vfplan" / "native" / "include" / "vfplan" / "bundle"
READER_CODE = re.compile(r'"((?:corrupt|signature|unsafe|version)\.[a-z0-9]+)"')
READER_ADVICE = re.compile(r'^ {4}\{"([a-z0-9.]+)", "([^"]+)"\},$', re.MULTILINE)


class Entry(NamedTuple):
    """One place of the source that gives a code: `kind` is a severity or an error's class."""

    code: str
    kind: str
    sentence: str
    package: str
    stage: str = ""


def main(arguments: list[str]) -> int:
    """Write the page, or only say whether it is current."""
    text = page()
    if "--check" in arguments:
        return int(PAGE.read_text() != text)
    PAGE.write_text(text)
    return 0


def collect() -> list[Entry]:
    """Every code in the sources, in the order of the files."""
    entries = []
    for folder in ("vfplan", "cli"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            package = path.relative_to(ROOT).parts[1]
            if path.relative_to(ROOT).parts[0] == "cli":
                package = "cli"
            if package != "conformance":  # the kit holds findings that are made up
                entries += entries_of(ast.parse(path.read_text()), package)
    return entries


def entries_of(tree: ast.Module, package: str) -> Iterator[Entry]:
    """The places of a file that give a code."""
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef):
            continue
        for call in ast.walk(function):
            if isinstance(call, ast.Call):
                yield from entries_of_call(call, function, package)


def entries_of_call(call: ast.Call, function: ast.FunctionDef, package: str) -> Iterator[Entry]:
    """The codes that a call gives; none where it gives none."""
    name = getattr(call.func, "id", getattr(call.func, "attr", ""))
    if name == "told":  # a row a finding: when it is told, code, severity and sentence
        for row in call.args[1:]:
            finding = ast.Call(ast.Name("finding"), row.elts[1:], [])
            yield from entries_of_call(finding, function, package)
        return
    if name == "kind":  # a reader of tables raises the class of error that it was given
        name = "InputError"
    keywords = {keyword.arg: keyword.value for keyword in call.keywords}
    kinds = ()
    if name == "finding" and package == "registration":  # a doubt or a note, as its figures say
        name, kinds = "doubt", ("doubt", "note")
    if name in MAKERS and call.args:
        kind = MAKERS[name]
        code = call.args[0]
        if name in ("doubt", "note"):
            stage = STAGE_OF_PACKAGE.get(package) or sentence_of(call.args[1], function)
            message = call.args[2]
        elif name == "finding_at":
            stage = STAGE_OF_PACKAGE[package]
            code, message = call.args[1:3]
            if len(call.args) > 3:
                kind = call.args[3].id
        else:
            stage = ""
            message = call.args[2]
    elif name == "error_at":  # what a picture shows at a place
        kind, stage = "CurveError", ""
        code, message = keywords["code"], call.args[1]
    elif name == "refusal" and len(call.args) == 3:
        kind, stage = "OutputError", ""
        message, code = call.args[1:]
    elif name == "refuse" and package == "bench":
        kind, stage = "InputError", ""
        code = call.args[1] if len(call.args) > 1 else ast.Constant("damaged-bench")
        message = call.args[0]
    elif name == "Issue" and len(call.args) == 4:
        kind = "validate"
        code = call.args[1]
        message = call.args[3]
        stage = ""
    elif "code" in keywords and call.args and hasattr(errors, name):
        kind = name
        code = keywords["code"]
        message = call.args[0]
        stage = ""
    else:
        return
    for text in codes_of(code, function):
        for each in kinds or (kind,):
            yield Entry(text, each, sentence_of(message, function), package, stage)


def codes_of(node: ast.expr, function: ast.FunctionDef) -> tuple[str, ...]:
    """The codes that an expression may be; none where it hands on what another place gave."""
    if isinstance(node, ast.IfExp):
        return (*codes_of(node.body, function), *codes_of(node.orelse, function))
    if isinstance(node, ast.Name):
        codes: tuple[str, ...] = ()
        for value in assigned_values(node.id, function, node.lineno):
            codes += codes_of(value, function)
        return codes
    if not isinstance(node, ast.Constant | ast.JoinedStr):
        return ()
    text = sentence_of(node, function)
    return COMPOSED.get(text, (text,))


def sentence_of(node: ast.expr, function: ast.FunctionDef) -> str:
    """The text of an expression, with `…` for each value that is only known at run time."""
    if isinstance(node, ast.Constant):
        return re.sub(r"\{\w+[^{}]*\}", VALUE, str(node.value))
    if isinstance(node, ast.JoinedStr):
        text = ""
        for part in node.values:
            text += sentence_of(part, function)
        return text
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return sentence_of(node.left, function) + sentence_of(node.right, function)
    if isinstance(node, ast.IfExp):
        return sentence_of(node.body, function)
    if isinstance(node, ast.Name):
        values = assigned_values(node.id, function, node.lineno)
        if values and not holds_name(values[-1], node.id):
            return sentence_of(values[-1], function)
    return VALUE


def holds_name(value: ast.expr, name: str) -> bool:
    """Whether an expression uses a name."""
    return any(isinstance(part, ast.Name) and part.id == name for part in ast.walk(value))


def assigned_values(name: str, function: ast.FunctionDef, before: int) -> list[ast.expr]:
    """What a function assigns to a name above a line, in the order of the lines."""
    values = []
    for node in ast.walk(function):
        if isinstance(node, ast.Assign) and node.lineno < before:
            for target in node.targets:
                if isinstance(target, ast.Name) and target.id == name:
                    values.append((node.lineno, node.value))
    return [value for _, value in sorted(values, key=lambda pair: pair[0])]


def of_kinds(entries: list[Entry], *kinds: str) -> list[Entry]:
    """The entries of these kinds."""
    return [entry for entry in entries if entry.kind in kinds]


def page() -> str:
    """The page as it should stand."""
    advice = tomllib.loads(ADVICE.read_text())
    entries = collect()
    text = HEAD
    for heading, stage in (
        ("What extraction asks", "extract"),
        ("What registration asks", "register"),
        ("What planning asks", "plan"),
        ("What a surface asks", "surface"),
        ("What an imported cloud or mesh asks", "import"),
    ):
        rows = [e for e in of_kinds(entries, "doubt", "note") if e.stage == stage]
        text += f"\n## {heading}\n\n" + advised_table(rows, advice, with_kind=True)
    refused = of_kinds(entries, "CurveError", "ImageError")
    text += "\n## Why a slice is refused\n\n"
    text += "Exit code 3. [A slice was refused](howto/refused.md) goes through the usual ones.\n\n"
    text += advised_table(refused, advice, with_kind=False)
    replayed = of_kinds(entries, "replay")
    text += "\n## What a replay remarks\n\nThese decide nothing; limits do.\n\n"
    text += advice_table(replayed, advice)
    validated = of_kinds(entries, "validate")
    text += "\n## What `validate` remarks\n\nBesides the findings of the plan.\n\n"
    text += advice_table(validated, advice)
    text += "\n## Other errors\n"
    for error in error_classes():
        rows = of_kinds(entries, error.__name__)
        if rows and error not in (errors.CurveError, errors.ImageError):
            text += (
                f"\n### {error.__name__}\n\n{summary_of(error)} Exit code {error.exit_code}.\n\n"
            )
            text += advice_table(rows, advice)
    text += "\n## Errors without a code of their own\n\n"
    text += "These carry the code of their class. The sentence says what to do.\n\n"
    text += "| code | class | exit code | meaning |\n|---|---|---|---|\n"
    for error in error_classes():
        text += f"| `{error.code}` | {error.__name__} | {error.exit_code} | {summary_of(error)} |\n"
    return text + READER + reader_rows()


def reader_rows() -> str:
    """The codes of the reader, which is written in C++, with the advice of bytes.hpp."""
    codes = set()
    for path in sorted(READER_HEADERS.glob("*.hpp")):
        codes |= set(READER_CODE.findall(path.read_text()))
    advice = dict(READER_ADVICE.findall((READER_HEADERS / "bytes.hpp").read_text()))
    text = ""
    for code in sorted(codes):
        text += f"| `{code}` | {cell(advice.get(code, 'The sentence says it'))} |\n"
    return text


def error_classes() -> list[type[errors.VfplanError]]:
    """The classes of errors, in the order of their module."""
    classes = []
    for value in vars(errors).values():
        if isinstance(value, type) and issubclass(value, errors.VfplanError):
            classes.append(value)
    return classes


def summary_of(error: type) -> str:
    """The first line of a class's docstring."""
    return (error.__doc__ or "").strip().splitlines()[0]


def one_of_each_code(entries: list[Entry]) -> list[Entry]:
    """One entry for each code: the one whose sentence says most without a value."""
    best: dict[str, Entry] = {}
    for entry in entries:
        known = best.get(entry.code)
        if known is None or letter_count(entry.sentence) > letter_count(known.sentence):
            best[entry.code] = entry
    return sorted(best.values(), key=lambda entry: entry.code)


def letter_count(sentence: str) -> int:
    """How many letters a sentence has."""
    return len(re.sub(r"[^A-Za-z]", "", sentence))


def advised_table(entries: list[Entry], advice: dict, with_kind: bool) -> str:
    """A table of codes with what to do about each."""
    if with_kind:
        text = "| code | severity | what you see | what to do |\n|---|---|---|---|\n"
    else:
        text = "| code | what you see | what to do |\n|---|---|---|\n"
    for entry in one_of_each_code(entries):
        kind = ""
        if with_kind:
            kinds = sorted({e.kind for e in entries if e.code == entry.code})
            kind = f"| {' or '.join(kinds)} "
        words = advice[entry.code]
        sentence = cell(words.get("sees", entry.sentence))
        text += f"| `{entry.code}` {kind}| {sentence} | {words['do']} |\n"
    return text


def advice_table(entries: list[Entry], advice: dict) -> str:
    """A table of codes and their sentences."""
    text = "| code | what you see |\n|---|---|\n"
    for entry in one_of_each_code(entries):
        words = advice.get(entry.code, {})
        text += f"| `{entry.code}` | {cell(words.get('sees', entry.sentence))} |\n"
    return text


def cell(sentence: str) -> str:
    """A sentence as a cell of a table, with a capital and a full stop."""
    text = " ".join(sentence.split()).replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")
    if not text.endswith((".", "?", VALUE)):
        text += "."
    return text[0].upper() + text[1:]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
