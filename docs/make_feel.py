"""Print how often rules make a force step that a hand feels: `python docs/make_feel.py`.

The table of docs/accuracy.md, section Feel. Two minutes.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
sys.path.insert(0, str(Path(__file__).parent))
import feel
from accuracy_tables import micrometres, table

RULES = ("robust", "paper", "exact")


def make() -> str:
    """The table in Markdown: by cloud the force steps of each rule, and what `robust` needed."""
    rows = []
    for cloud, scores in feel.scenes():
        row = [cloud, str(scores["points"])]
        for rule in RULES:
            row.append(steps(scores[rule]))
        row.append(f"{micrometres(scores['band_m'])} µm")
        row.append(f"{scores['robust']['limit_share']:.1%}")
        rows.append(row)
    columns = [f"`{rule}`: > 0.6 N, > 2 N, largest" for rule in RULES]
    last = "ticks of `robust` that used up their iterations"
    return table(["cloud", "points", *columns, "band of `robust`", last], rows)


def steps(errors: dict) -> str:
    """How many steps above 0.6 N and 2 N, and the largest."""
    jumps = f"{errors['force_jumps']}, {errors['force_jumps_large']}"
    return f"{jumps}, {errors['force_step_max_n']:.2f} N"


if __name__ == "__main__":
    print(make())
