"""Draw slices of the kinds that users make and print what the extraction makes of each kind:

python docs/make_slices_table.py [SLICES_A_KIND=20] [KIND...] [-v]

With `-v` every slice that is not right is named with its reason.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "making"))
from slices import HIDDEN, KINDS, TRAPS, draw
from verdicts import judge

OUTCOMES = ("right", "silent", "warned", "refused", "falsely refused", "falsely warned")


def row(kind, count, verbose):
    """Outcomes of a kind, with the RMS of its errors and of their z."""
    outcomes = Counter()
    errors = []
    z = []
    for seed in range(count):
        drawn = draw(kind, seed)
        verdict = judge(drawn)
        outcomes[verdict.outcome] += 1
        if verdict.z is not None:
            errors.append(verdict.rms)
            z.append(verdict.z)
        if verbose and verdict.outcome != "right":
            how = f"{drawn.rasteriser}, {drawn.quality or 'PNG'}"
            print(f"# {kind} {seed} ({how}): {verdict.outcome}: {verdict.why}")
    error_cell = ""
    z_cell = ""
    if z:
        error_cell = f"{np.sqrt(np.mean(np.square(errors))):.3f}"
        z_cell = f"{np.sqrt(np.mean(np.concatenate(z) ** 2)):.1f}"
    counts = " | ".join(str(outcomes[name] or "") for name in OUTCOMES)
    print(f"| {kind} | {counts} | {error_cell} | {z_cell} |", flush=True)
    return outcomes


def main(words):
    """Print the table."""
    is_verbose = "-v" in words
    words = [word for word in words if word != "-v"]
    count = 20
    if words:
        count = int(words[0])
    kinds = words[1:]
    if not kinds:
        kinds = [*KINDS, *TRAPS, *HIDDEN]
    print(f"| kind | {' | '.join(OUTCOMES)} | RMS error [px] | RMS z |")
    print("|" + "---|" * (len(OUTCOMES) + 3))
    total = Counter()
    for kind in kinds:
        total += row(kind, count, is_verbose)
    counts = " | ".join(str(total[name]) for name in OUTCOMES)
    print(f"| all | {counts} | | |")


if __name__ == "__main__":
    main(sys.argv[1:])
