"""Halve and double each number of the extraction, and print what each change moves:

    python docs/make_tuned_extraction.py            every number; an hour
    python docs/make_tuned_extraction.py SEEN RISE  only these
    python docs/make_tuned_extraction.py --slices 2 fewer slices of each kind

A number that moves nothing when it is halved and when it is doubled should go. Steps that cost
nothing alone can cost much together, so measure the final set as a whole.
"""

from __future__ import annotations

import argparse
import tempfile

import make_extraction_table as table
import numpy as np

import vfplan.curve as curve
from vfplan.curve import tuned

FIRST_SEED = 700


def main() -> None:
    """Print one row for each number and change that moves a figure."""
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*")
    parser.add_argument("--slices", type=int, default=3, help="of each kind")
    parser.add_argument("--cache", help="a folder that keeps the drawn slices")
    given = parser.parse_args()
    kinds = table.extraction_kinds
    with tempfile.TemporaryDirectory() as folder:
        where = given.cache or folder
        every = [*kinds.CLEAR, *kinds.AMBIGUOUS]
        drawn = table.drawings(every, FIRST_SEED, given.slices, where)
    before = figures(drawn)
    heads = "right | findings | silent | PNG px | JPEG px | ends 95 % | slices moved"
    print(f"| number | value | {heads} |")
    print("|---" * 9 + "|")
    print(row("as they are", "", before, 0))
    for name in given.names or numbers():
        value = getattr(tuned, name)
        moved_by_any = False
        for factor in (0.5, 2.0):
            changed = type(value)(value * factor)
            setattr(tuned, name, changed)
            after = figures(drawn)
            moved = count_moved(before, after)
            moved_by_any |= moved > 0
            print(row(name, f"{changed:g}", after, moved), flush=True)
        setattr(tuned, name, value)
        if not moved_by_any:
            print(f"| **{name} moves nothing** | | | | | | | | |", flush=True)


def numbers() -> list[str]:
    """The names of all numbers, in their order."""
    return [name for name in vars(tuned) if name.isupper()]


def figures(drawn) -> list:
    """The judgements on all slices."""
    return [table.judge(each, table.answer(curve, each.image)) for each in drawn]


def count_moved(before: list, after: list) -> int:
    """How many slices have another outcome, other findings, or a line 0.01 px more or less off."""
    moved = 0
    for old, new in zip(before, after, strict=True):
        same = old.outcome == new.outcome and old.findings == new.findings
        if same and old.errors is not None:
            same = np.isclose(rms(old.errors), rms(new.errors), atol=0.01)
            same &= np.allclose(old.ends, new.ends, atol=0.05)
            same &= bool(np.isclose(rms(old.z), rms(new.z), rtol=0.05))
        moved += not same
    return moved


def rms(values) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def row(name: str, value: str, results: list, moved: int) -> str:
    """One line of the table."""
    clear = [r for r in results if r.clear]
    right = [r for r in clear if r.outcome == "right"]
    silent = sum(r.outcome == "silent" for r in results if not r.clear)
    errors = []
    for is_png in (True, False):
        part = [rms(r.errors) for r in right if r.how.endswith("PNG") == is_png]
        errors.append(f"{np.mean(part):.3f}" if part else "-")
    distances = [e for r in right for e in r.ends]
    ends = np.quantile(distances, 0.95) if distances else np.nan
    found = sum(bool(r.findings) for r in right)
    return (
        f"| {name} | {value} | {len(right)} of {len(clear)} | {found} | {silent} | {errors[0]} | "
        f"{errors[1]} | {ends:.2f} | {moved} |"
    )


if __name__ == "__main__":
    main()
