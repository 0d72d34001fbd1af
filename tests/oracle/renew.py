"""Freeze anew what the oracle holds, or show what is different:

python tests/oracle/renew.py NAME... [--show] [--tree FOLDER]

NAME is a file of tests/data/oracle, or `all`. With `--show` nothing is written: the old and the new
are printed side by side. The Python that runs this file decides whose Python code is judged;
`--tree` names the source tree whose native code is compiled (without it, this one).
"""

from __future__ import annotations

import argparse
import difflib
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


def shown(name, old, new):
    """The lines that tell old and new apart."""
    if name == "slices.csv":
        return slices.compared(slices.parsed(old), slices.parsed(new))
    if name == "labels.csv":
        return labels.compared(labels.parsed(old), labels.parsed(new))
    return difflib.unified_diff(old.splitlines(), new.splitlines(), "old", "new", n=0, lineterm="")


def main():
    """Print the differences, and write the files."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="+", choices=[*WRITERS, "all"], metavar="NAME")
    parser.add_argument("--show", action="store_true", help="write nothing")
    parser.add_argument("--tree", type=Path, default=TESTS.parent, help="native source tree")
    given = parser.parse_args()
    names = list(WRITERS) if "all" in given.names else given.names
    for name in names:
        path = FOLDER / name
        new = WRITERS[name](given.tree, name)
        if path.exists():
            print(f"{name}:")
            print("\n".join(shown(name, path.read_text(), new)))
        if not given.show:
            path.write_text(new)


if __name__ == "__main__":
    main()
