"""Run a reader on every file of the conformance kit, with Python's standard library only.

    python -m vfplan.conformance --kit DIR [--keys=OPTION] CMD...

`CMD FILE` prints a bundle as JSON and exits 0, or exits 1 because it refuses the file. The JSON is
an object; its keys that begin with `/` are the paths of the format, each with its value: a text, a
number, or nested lists. An object with the key `values` stands for what is under that key, as
`vfplan info --json` prints it. Other keys are ignored. A program that verifies signatures names its
option for a file of trusted keys (`--keys`): `CMD FILE OPTION KEYS` then refuses what they did not
sign.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

# Values by path: what a reader printed or read, or what the kit states.
Values = dict[str, object]

# Takes a file, gives its values by path, or `None` when it refuses the file.
Reader = Callable[[Path], Values | None]


@dataclass(frozen=True)
class Result:
    """What a reader made of one file of the kit."""

    # `valid`, `invalid` or `signed`.
    kind: str
    name: str
    rule: str
    # Empty when the reader did as it must.
    problem: str


def judge(kit: Path, reader: Reader, verifier: Reader | None = None) -> list[Result]:
    """The results of a reader on all files of a kit, in order of their names.

    kit: folder of the kit
    reader: reads without asking for a signature
    verifier: the same reader where it trusts the keys of `signed/keys.pub` alone; without it the
        files of that folder are left out
    """
    readers = {"valid": reader, "invalid": reader}
    if verifier is not None:
        readers["signed"] = verifier
    results = []
    for kind, used in readers.items():
        for path in sorted((kit / kind).glob("*.h5")):
            expected = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
            try:
                problem = problem_of(used(path), expected)
            except ReaderError as error:
                problem = str(error)
            results.append(Result(kind, path.stem, expected.get("rule", ""), problem))
    return results


class ReaderError(Exception):
    """A reader that neither printed JSON nor refused the file."""


def command_reader(
    command: Sequence[str], refused: Sequence[int] = (1,), more: Sequence[str] = ()
) -> Reader:
    """A reader that is a program: `CMD FILE MORE`; `refused` are exit codes that refuse a file."""

    def read(path: Path) -> Values | None:
        words = [*command, str(path), *more]
        done = subprocess.run(words, capture_output=True, check=False, timeout=60)
        if done.returncode in refused:
            return None
        if done.returncode != 0:
            raise ReaderError(f"exit code {done.returncode}")
        try:
            printed = json.loads(done.stdout)
        except ValueError as error:
            raise ReaderError(f"prints no JSON: {error}") from None
        return values_of(printed)

    return read


def values_of(printed: Values) -> Values:
    """The values of the format's paths in what a reader printed."""
    return {
        path: value["values"] if isinstance(value, dict) else value
        for path, value in printed.items()
        if path.startswith("/")
    }


def problem_of(values: Values | None, stated: dict[str, Values]) -> str:
    """What is wrong with the values that were read, or the refusal; empty if nothing is."""
    if "values" not in stated:
        return "" if values is None else "reads what it must refuse"
    if values is None:
        return "refuses what it must read"
    expected = stated["values"]
    for path in sorted(expected.keys() | values.keys()):
        if path not in values:
            return f"{path} is missing"
        if path not in expected:
            return f"{path} is not in the file"
        if values[path] != expected[path]:
            return f"{path} has another value"
    return ""


def matrix(results: dict[str, list[Result]]) -> str:
    """A table in Markdown: a line for each rule, a column for each reader."""
    readers = list(results)
    lines = ["| rule | files | " + " | ".join(readers) + " |", "|---" * (2 + len(readers)) + "|"]
    for rule in sorted({result.rule for result in results[readers[0]]}, key=rule_order):
        by_reader = [[r for r in results[reader] if r.rule == rule] for reader in readers]
        count = max(map(len, by_reader))
        cells = " | ".join(map(cell, by_reader))
        lines.append(f"| {rule or 'valid files'} | {count} | {cells} |")
    return "\n".join(lines)


def cell(of_rule: list[Result]) -> str:
    """What the table says of a reader and a rule."""
    if not of_rule:
        return "not tried"
    wrong = sum(bool(result.problem) for result in of_rule)
    return f"**No** ({wrong})" if wrong else "Yes"


def rule_order(rule: str) -> tuple[int, int]:
    """Where a rule stands in the table: in the order of the page."""
    return "LCVSKM".find(rule[:1]), int(rule[1:] or 0)


def main(words: Sequence[str] | None = None) -> int:
    """Run one reader and print its line of the matrix, and each file where it is wrong."""
    parser = argparse.ArgumentParser(
        prog="python -m vfplan.conformance",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--kit", type=Path, help="the kit; without it one is written for this run")
    parser.add_argument(
        "--refused", default="1", help="exit codes that refuse a file, with commas between; 1"
    )
    parser.add_argument(
        "--keys", metavar="OPTION", help="the reader's option for trusted keys; tries signatures"
    )
    parser.add_argument("command", nargs=argparse.REMAINDER, metavar="CMD", help="the reader")
    options = parser.parse_args(words)
    if not options.command:
        parser.error("names no reader: CMD is missing")
    refused = [int(code) for code in options.refused.split(",")]
    with tempfile.TemporaryDirectory() as folder:
        kit = options.kit or Path(folder)
        if options.kit is None:
            from vfplan.conformance.kit import write_kit

            write_kit(kit)
        trusting = (options.keys, str(kit / "signed" / "keys.pub"))
        verifier = command_reader(options.command, refused, trusting) if options.keys else None
        try:
            results = judge(kit, command_reader(options.command, refused), verifier)
        except OSError as error:
            parser.error(f"{options.command[0]} cannot be run: {error.strerror}")
    if not results:
        parser.error(f"{options.kit} holds no kit")
    wrong = [result for result in results if result.problem]
    print(matrix({Path(options.command[0]).name: results}))
    for result in wrong:
        print(f"{result.kind}/{result.name}.h5: {result.problem}")
    print(f"{len(results) - len(wrong)} of {len(results)} files as they must be")
    return int(len(wrong) > 0)


if __name__ == "__main__":
    sys.exit(main())
