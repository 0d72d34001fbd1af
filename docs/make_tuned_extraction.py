"""Halve and double each number of the extraction, and print what each change moves:

    python docs/make_tuned_extraction.py            every number; an hour
    python docs/make_tuned_extraction.py VISIBLE RISE  only these
    python docs/make_tuned_extraction.py --slices 2 fewer slices of each kind

A number that moves nothing when it is halved and when it is doubled should go. Steps that cost
nothing alone can cost much together, so measure the final set as a whole.
"""

from __future__ import annotations

import argparse
import tempfile

import make_extraction_table as table
import numpy as np

from vfplan.curve import extraction, tuned

FIRST_SEED = 700


def main() -> None:
    """Print one row for each number and change that moves a figure."""
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*")
    parser.add_argument("--slices", type=int, default=3, help="of each kind")
    parser.add_argument("--cache", help="a folder that keeps the drawn slices")
    options = parser.parse_args()
    kinds = table.extraction_kinds
    with tempfile.TemporaryDirectory() as folder:
        drawings = table.draw_slices(
            [*kinds.CLEAR, *kinds.AMBIGUOUS], FIRST_SEED, options.slices, options.cache or folder
        )
    before = judgements(drawings)
    heads = "right | findings | silent | PNG px | JPEG px | ends 95 % | slices moved"
    print(f"| number | value | {heads} |")
    print("|---" * 9 + "|")
    print(row("as they are", "", before, 0))
    names = options.names
    if not names:
        names = [name for name in vars(tuned) if name.isupper()]
    for name in names:
        value = getattr(tuned, name)
        moves_something = False
        for factor in (0.5, 2.0):
            changed = type(value)(value * factor)
            setattr(tuned, name, changed)
            after = judgements(drawings)
            moved = count_moved(before, after)
            if moved > 0:
                moves_something = True
            print(row(name, f"{changed:g}", after, moved), flush=True)
        setattr(tuned, name, value)
        if not moves_something:
            print(f"| **{name} moves nothing** | | | | | | | | |", flush=True)


def judgements(drawings) -> list:
    """The judgement on each slice."""
    results = []
    for drawing in drawings:
        results.append(table.judge(drawing, table.answer_of(extraction, drawing.image)))
    return results


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
    right = table.with_outcome(clear, "right")
    silent = [r for r in table.with_outcome(results, "silent") if not r.clear]
    png_px = mean_error(table.of_format(right, True))
    jpeg_px = mean_error(table.of_format(right, False))
    ends_px = np.nan
    distances = table.end_distances_of(right)
    if distances:
        ends_px = np.quantile(distances, 0.95)
    return (
        f"| {name} | {value} | {len(right)} of {len(clear)} | {len(table.with_findings(right))} | "
        f"{len(silent)} | {png_px} | {jpeg_px} | {ends_px:.2f} | {moved} |"
    )


def mean_error(results: list) -> str:
    """The mean RMS error across the line [px], or a dash where there is no slice."""
    if not results:
        return "-"
    return f"{np.mean(table.rms_of_each(results, 'errors')):.3f}"


if __name__ == "__main__":
    main()
