"""Freeze anew what the oracle holds, or show what is different:

python tests/oracle/renew.py NAME... [--show] [--tree FOLDER]

NAME is a file of tests/data/oracle, or `all`. With `--show` nothing is written: the differences are
printed instead. `--tree` takes another source tree's native code; to freeze another commit's Python
code, run this file with the Python of that commit's environment.
"""

from __future__ import annotations

import argparse
import difflib
import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS), str(TESTS / "support")]

from oracle import engine  # noqa: E402

FOLDER = TESTS / "data" / "oracle"
WRITERS = {"engine.txt": engine.text, "engine-long.txt": engine.text}


def main():
    """Write the files, or print the differences."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="+", choices=[*WRITERS, "all"])
    parser.add_argument("--show", action="store_true")
    parser.add_argument("--tree", type=Path, default=TESTS.parent)
    given = parser.parse_args()
    names = list(WRITERS) if "all" in given.names else given.names
    for name in names:
        new = WRITERS[name](given.tree, name)
        path = FOLDER / name
        old = path.read_text() if path.exists() else ""
        print("".join(difflib.unified_diff(old.splitlines(True), new.splitlines(True), n=0)))
        if not given.show:
            path.write_text(new)


if __name__ == "__main__":
    main()
