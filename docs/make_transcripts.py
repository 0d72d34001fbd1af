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

ROOT = Path(__file__).resolve().parents[1]
PROGRAMS = ("vfplan", "python", "printf")
PLAN = (
    "vfplan plan samples/elbow.png samples/elbow_markers_image.csv"
    " samples/elbow_markers_robot.csv --pixel-spacing 0.5 -q -o fixture.h5"
)
BEFORE = {  # what a page takes for granted in its folder
    "bundles.md": f"{PLAN} && cp tests/data/bundles/0.1-everything.h5 old.h5",
    "registration.md": "cp samples/elbow* . && awk -F, -v OFS=, '/^x4/ {$2 += 0.006} 1'"
    " elbow_markers_robot.csv > moved.csv",
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
ALIKE = 0.6  # least likeness, of 1, of a line beside `...` to the one that stood there


class LeftAloneError(Exception):
    """Why a transcript keeps what it says."""


def main(arguments: list[str]) -> int:
    """Go through the pages; returns 1 when one that is only checked differs, else 0."""
    check = "--check" in arguments
    named = [Path(a).resolve() for a in arguments if a != "--check"]
    differ = False
    for page in named or [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        old = page.read_text()
        new = renewed(page.name, old)
        if check:
            texts = (text.splitlines(True) for text in (old, new))
            sys.stdout.writelines(difflib.unified_diff(*texts, page.name, "printed now"))
        elif new != old:
            page.write_text(new)
        differ |= new != old
    return int(check and differ)


def renewed(name: str, text: str) -> str:
    """A page with its transcripts renewed."""
    if not BLOCK.search(text):
        return text
    with tempfile.TemporaryDirectory() as folder:
        for shared in ("samples", "tests"):
            Path(folder, shared).symlink_to(ROOT / shared)
        if name in BEFORE:
            run(BEFORE[name], folder, check=True)
        return BLOCK.sub(lambda match: _block(name, match, folder), text)


def _block(name: str, match: re.Match, folder: str) -> str:
    """The block of a match, renewed; named on stderr as far as it is left alone."""
    kind = match.lastgroup
    text, margin = match[kind], " " * 4 * (kind == "indented")
    line = match.string.count("\n", 0, match.start(kind)) + 1
    entries = list(commands([row.removeprefix(margin) for row in text.splitlines()]))
    if reason := unfit([command for command, _ in entries]):
        print(f"{name}:{line}: block left alone: {reason}", file=sys.stderr)
        return match[0]
    found = []
    for command, shown in entries:
        try:
            found += [*command, *merged(shown, run(_shell(command), folder))]
        except LeftAloneError as why:
            print(f"{name}:{line}: left alone: {command[0]}: {why}", file=sys.stderr)
            found += [*command, *shown]
        line += len(command) + len(shown)
    return match[0].replace(text, "".join(f"{margin}{row}".rstrip() + "\n" for row in found))


def commands(rows: list[str]) -> Iterator[tuple[list[str], list[str]]]:
    """The lines of each command, and those shown below it."""
    starts = [k for k, row in enumerate(rows) if row.startswith("$ ")]
    for start, end in zip(starts, [*starts[1:], len(rows)], strict=True):
        below = next(k for k in range(start, end) if not rows[k].endswith("\\")) + 1
        yield rows[start:below], rows[below:end]


def unfit(block: list[list[str]]) -> str:
    """Why none of a block's commands may run, or nothing."""
    for command in block:
        shell = _shell(command)
        if shell.split()[0] not in PROGRAMS:
            return f"calls {shell.split()[0]}"
        if place := PLACEHOLDER.search(shell):
            return f"{place[0]} stands for something"
    return ""


def _shell(command: list[str]) -> str:
    return "\n".join(command).removeprefix("$ ")


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


def merged(shown: list[str], printed: list[str]) -> list[str]:
    """What is printed now, in the form of what was shown.

    Raises
    ------
    LeftAloneError
        A file was missing, or nothing printed is like a line beside a `...`.
    """
    missing = [row for row in printed if MISSING.search(row)]
    if missing and not any(MISSING.search(row) for row in shown):
        raise LeftAloneError(missing[-1])
    if not shown:
        return []
    standing = {_lasting(row): row for row in shown}
    return [standing.get(_lasting(row), row) for row in _abridged(shown, printed)]


def _lasting(row: str) -> str:
    """A line without what every run prints anew."""
    return _figureless(row) if TIMED.search(row) else ANEW.sub("#", row)


def _figureless(row: str) -> str:
    return re.sub(r" *-?\d+(\.\d+)?", "#", row)


def _abridged(shown: list[str], printed: list[str]) -> list[str]:
    """The printed lines without those that `...` stands for."""
    gaps = [k for k, row in enumerate(shown) if row.strip() == "..."]
    found, at = [], 0
    for start, end in zip([0, *(k + 1 for k in gaps)], [*gaps, len(shown)], strict=True):
        if part := shown[start:end]:
            first = _nearest(part[0], printed, at) if start else 0
            at = _last(part, printed, first) + 1 if end < len(shown) else len(printed)
            found += printed[first:at]
        found += shown[end : end + 1]
    return found


def _last(part: list[str], printed: list[str], first: int) -> int:
    """The place of a part's last line: as far from its first as it was, if that suits."""
    place = first + len(part) - 1
    if place < len(printed):
        for without in (_figureless, _lasting):
            if without(printed[place]) == without(part[-1]):
                return place
    return _nearest(part[-1], printed, first)


def _nearest(row: str, printed: list[str], begin: int) -> int:
    """The place, from `begin` on, of the printed line most like a line shown before."""
    likeness = [difflib.SequenceMatcher(None, row, other).ratio() for other in printed[begin:]]
    if max(likeness, default=0) < ALIKE:
        raise LeftAloneError(f"prints nothing like {row!r} any more; its last line: {printed[-1:]}")
    return begin + likeness.index(max(likeness))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
