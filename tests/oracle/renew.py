"""Freeze anew what the oracle holds; `git diff` then shows what is different:

python tests/oracle/renew.py NAME... [--tree FOLDER]

NAME is a file of tests/data/oracle, or `all`. The Python that runs this file decides whose
Python code is judged; `--tree` names the source tree whose native code is compiled (without it,
this one).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS), str(TESTS / "making"), str(TESTS / "support")]

from oracle import documents, engine, labels, replays, slices  # noqa: E402

FOLDER = TESTS / "data" / "oracle"
WRITERS = {
    "engine.txt": engine.text,
    "engine-long.txt": engine.text,
    "replays.json": replays.text,
    "controller.json": replays.text,
    "slices.csv": slices.text,
    "labels.csv": labels.text,
    "documents.txt": documents.text,
}


def main():
    """Write the files."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="+", choices=[*WRITERS, "all"], metavar="NAME")
    parser.add_argument("--tree", type=Path, default=TESTS.parent, help="native source tree")
    given = parser.parse_args()
    names = list(WRITERS) if "all" in given.names else given.names
    for name in names:
        (FOLDER / name).write_text(WRITERS[name](given.tree, name))


if __name__ == "__main__":
    main()
