"""Put what the commands on the pages print now in the place of what stood there.

    python docs/make_transcripts.py                  README.md and docs/; about two minutes
    python docs/make_transcripts.py docs/replay.md   only these pages
    python docs/make_transcripts.py --check          change nothing, print what differs, exit 1

A transcript is a fenced or indented block that begins with `$ `. The commands of a page run one
after the other in one temporary folder, beside `samples` and `tests`, with this Python's programs
first on the PATH. A line `...` stands for lines left out and stays between the lines it stood
between; a command with nothing below it has all its lines left out. What every run prints anew
(times the machine took, dates, numbers of new keys) stays while nothing else of its line changes.

Left alone, and named on stderr: blocks that are examples in form (DIR, FILE) or call other
programs than `PROGRAMS`, commands that want a file that is not there, and those that no longer
print anything like a line shown beside `...`.
"""

from __future__ import annotations

import difflib
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PROGRAMS = ("vfplan", "python", "printf")
PLAN = (
    "vfplan plan samples/elbow.png samples/elbow_markers_image.csv"
    " samples/elbow_markers_robot.csv --pixel-spacing 0.5 -q -o fixture.h5"
)
# What the commands of a page need in their folder, made by a command before them.
BEFORE = {
    "bundles.md": PLAN,
    "campaigns.md": f"{PLAN} && mv fixture.h5 elbow.h5",
    "registration.md": "awk -F, -v OFS=, '/^x4/ {$2 += 0.006} 1'"
    " samples/elbow_markers_robot.csv > moved.csv",
    "replay.md": r"printf 't,x,y,z\n0,0,0,0\n0.002,0,0,0\n0.001,0,0,0\n' > bad.csv",
    "rehearse.md": "vfplan demo -o demo -q",
    "stability.md": PLAN,
    "refused.md": f"python {ROOT}/docs/make_finding_pictures.py --slices slices",
}
FENCED = r"^```\w*\n(?P<fenced>\$ (?:.*\n)*?)```$"
INDENTED = r"(?<=\n\n)(?P<indented> {4}\$ .*\n(?:(?: {4}.*)?\n)*?)(?=\n*(?! {4}|\n)|\Z)"
BLOCK = re.compile(f"{FENCED}|{INDENTED}", re.MULTILINE)
PLACEHOLDER = re.compile(r"(?<![\w'\"-])[A-Z]{3,}(\.\w+)?(?![\w-])")
MISSING = re.compile(r"no such file|command not found|no module named", re.IGNORECASE)
TIMED = re.compile(r"time a tick|times real time")
ANEW = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ|key [0-9a-f]{32}")
MIN_LIKENESS = 0.6
"""How alike, of 1, a line beside `...` must at least be to the line that it takes the place of."""


class UnchangedError(Exception):
    """Why a transcript keeps what it says."""


def main(arguments: list[str]) -> int:
    """Go through the pages; returns 1 when one that is only checked differs, else 0."""
    is_check = "--check" in arguments
    pages = [Path(argument).resolve() for argument in arguments if argument != "--check"]
    if not pages:
        pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    is_current = True
    for page in pages:
        old = page.read_text()
        new = renewed(page.name, old)
        if new == old:
            continue
        is_current = False
        if is_check:
            difference = difflib.unified_diff(
                old.splitlines(True), new.splitlines(True), page.name, "printed now"
            )
            sys.stdout.writelines(difference)
        else:
            page.write_text(new)
    return int(is_check and not is_current)


def renewed(name: str, text: str) -> str:
    """A page with its transcripts renewed."""
    if not BLOCK.search(text):
        return text
    with tempfile.TemporaryDirectory() as folder:
        for shared in ("samples", "tests"):
            Path(folder, shared).symlink_to(ROOT / shared)
        if name in BEFORE:
            run(BEFORE[name], folder, check=True)
        return BLOCK.sub(lambda match: renewed_block(name, match, folder), text)


def renewed_block(name: str, match: re.Match, folder: str) -> str:
    """The block of a match, renewed; named on stderr as far as it is left alone."""
    kind = match.lastgroup
    text = match[kind]
    margin = ""
    if kind == "indented":
        margin = " " * 4
    line = match.string.count("\n", 0, match.start(kind)) + 1
    commands = list(commands_of([row.removeprefix(margin) for row in text.splitlines()]))
    reason = reason_to_leave(commands)
    if reason:
        print(f"{name}:{line}: block left alone: {reason}", file=sys.stderr)
        return match[0]
    rows = []
    for command in commands:
        rows += command.rows
        try:
            rows += merged(command.output, run(command.shell, folder))
        except UnchangedError as why:
            print(f"{name}:{line}: left alone: {command.rows[0]}: {why}", file=sys.stderr)
            rows += command.output
        line += len(command.rows) + len(command.output)
    new_text = ""
    for row in rows:
        new_text += f"{margin}{row}".rstrip() + "\n"
    return match[0].replace(text, new_text)


class Command(NamedTuple):
    """A command of a block: its own lines, and those shown below it."""

    rows: list[str]
    output: list[str]

    @property
    def shell(self) -> str:
        """What a shell is given."""
        return "\n".join(self.rows).removeprefix("$ ")


def commands_of(rows: list[str]) -> Iterator[Command]:
    """The commands of a block's lines."""
    starts = [k for k, row in enumerate(rows) if row.startswith("$ ")]
    for start, end in zip(starts, [*starts[1:], len(rows)], strict=True):
        # A command goes on in the next line after a backslash.
        last = start
        while rows[last].endswith("\\"):
            last += 1
        yield Command(rows[start : last + 1], rows[last + 1 : end])


def reason_to_leave(commands: list[Command]) -> str:
    """Why none of a block's commands may run, or nothing."""
    for command in commands:
        program = command.shell.split()[0]
        if program not in PROGRAMS:
            return f"calls {program}"
        place = PLACEHOLDER.search(command.shell)
        if place:
            return f"{place[0]} stands for something"
    return ""


def run(shell: str, folder: str, check: bool = False) -> list[str]:
    """The lines a command prints in the folder, as a terminal would show them."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", shell],
        cwd=folder,
        env={**os.environ, "PATH": path, "PYTHONUNBUFFERED": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=check,
    )
    return done.stdout.rstrip().splitlines()


def merged(old: list[str], printed: list[str]) -> list[str]:
    """What is printed now, in the form of what was shown.

    Raises
    ------
    UnchangedError
        A file was missing, or nothing printed is like a line beside a `...`.
    """
    for row in printed:
        if MISSING.search(row) and not MISSING.search("\n".join(old)):
            raise UnchangedError(row)
    if not old:
        return []
    old_rows = {}
    for row in old:
        old_rows[lasting_part(row)] = row
    rows = []
    for row in abridged(old, printed):
        rows.append(old_rows.get(lasting_part(row), row))
    return rows


def lasting_part(row: str) -> str:
    """A line without what every run prints anew."""
    if TIMED.search(row):
        return without_figures(row)
    return ANEW.sub("#", row)


def without_figures(row: str) -> str:
    """A line with a sign in place of each figure."""
    return re.sub(r" *-?\d+(\.\d+)?", "#", row)


def abridged(old: list[str], printed: list[str]) -> list[str]:
    """The printed lines without those that `...` stands for."""
    gaps = [k for k, row in enumerate(old) if row.strip() == "..."]
    starts = [0]
    for gap in gaps:
        starts.append(gap + 1)
    rows = []
    position = 0
    for start, end in zip(starts, [*gaps, len(old)], strict=True):
        part = old[start:end]
        if part:
            first = 0
            if start > 0:
                first = closest_line(part[0], printed, position)
            position = len(printed)
            if end < len(old):
                position = end_of_part(part, printed, first)
            rows += printed[first:position]
        # The line `...` itself stays.
        rows += old[end : end + 1]
    return rows


def end_of_part(part: list[str], printed: list[str], first: int) -> int:
    """The place after a part's last line: as far from its first as it was, if that suits."""
    place = first + len(part) - 1
    if place < len(printed):
        for strip in (without_figures, lasting_part):
            if strip(printed[place]) == strip(part[-1]):
                return place + 1
    return closest_line(part[-1], printed, first) + 1


def closest_line(row: str, printed: list[str], begin: int) -> int:
    """The place, from `begin` on, of the printed line most like a line shown before."""
    best_place = begin
    best_likeness = 0.0
    for place in range(begin, len(printed)):
        likeness = difflib.SequenceMatcher(None, row, printed[place]).ratio()
        if likeness > best_likeness:
            best_place = place
            best_likeness = likeness
    if best_likeness < MIN_LIKENESS:
        raise UnchangedError(f"prints nothing like {row!r} any more; its last line: {printed[-1:]}")
    return best_place


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
