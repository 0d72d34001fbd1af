"""What the extraction makes of drawn slices of 43 kinds, slice by slice."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from drawing import rms
from oracle.tables import table_rows, table_text
from slices import HIDDEN, KINDS, TRAPS, draw
from verdicts import judge

ALL = {**KINDS, **TRAPS, **HIDDEN}
SEEDS = range(20)
# One seed a kind, which `make test` compares.
QUICK = [(KINDS, 1), (TRAPS, 2), (HIDDEN, 4)]

# Kinds that may be silently wrong although 2dd7600 warned of them: those that docs/extraction.md
# lists as seen by eye only. The review sheet shows both ends enlarged.
MAY_BE_SILENT = {"box over the end", "lone bar"}
# At ("letter at the end", 10) a small letter in JPEG lies on the end: its strokes are thinner than
# the pen and blurred, and it has no branch in the ink. docs/extraction.md lists this as seen by eye
# only.
MAY_BE_SILENT_SLICES = frozenset({("letter at the end", 10)})
# Slices that were right and whose fault is now told: at ("dot end", 1) the curve is followed 4 px
# into the dot, and two findings say so. Silence is still a fault.
NOW_TOLD = frozenset({("dot end", 1)})
# Of the clear slices, the share by which fewer may be right.
FEWER_RIGHT = 0.01
# Of the clear slices, the share that may be warned of; a part of a slice counts as one.
MAX_WARNED = 0.14
# How much larger the errors along and across the line may be on the slices that both measure.
RMS_RATIO = 1.3


@dataclass
class Row:
    """One slice: lengths in px, `z` the RMS of the errors over their stated deviations."""

    kind: str
    seed: int
    drawn: str  # CRC-32 of the picture: drawing libraries of other versions may draw otherwise
    outcome: str
    rms_px: float
    ends_px: float
    z: float
    why: str


def measured(kind, seed):
    """The row of one slice."""
    slice_ = draw(kind, seed)
    verdict = judge(slice_)
    z = np.nan if verdict.z is None else rms(verdict.z)
    drawn = f"{zlib.crc32(slice_.image.tobytes()):08x}"
    why = " ".join(verdict.why.split())
    return Row(kind, seed, drawn, verdict.outcome, verdict.rms, verdict.ends, z, why)


def quick():
    """The slices that `make test` compares."""
    return [(kind, seed) for kinds, seed in QUICK for kind in kinds]


def every():
    """All slices of the table."""
    return [(kind, seed) for kind in ALL for seed in SEEDS]


def text(_tree, name):
    """What tests/data/oracle/slices.csv holds."""
    comments = (
        "Verdicts on drawn slices: python docs/make_slices_table.py tells what the words mean.",
        f"Renew: python tests/oracle/renew.py {name}",
    )
    return table_text(comments, (measured(kind, seed) for kind, seed in every()), Row, 4)


def parsed(text):
    """{(kind, seed): Row}."""
    return {(row.kind, row.seed): row for row in table_rows(text, Row)}


def worse(frozen, new):
    """What is worse than in 2dd7600, a line for each; `new` may be a part of the table."""
    for key, row in new.items():
        may_be = row.kind in MAY_BE_SILENT or key in MAY_BE_SILENT_SLICES
        if row.outcome == "silent" and frozen[key].outcome != "silent" and not may_be:
            yield f"{row.kind} {row.seed}: silently wrong, {row.why}; {_was(frozen[key])}"
    clear = [key for key in new if key[0] in KINDS]
    before, now = ([key for key in clear if _is_right(rows[key])] for rows in (frozen, new))
    lost = set(before) - set(now)
    if len(now) + len(NOW_TOLD & lost) < len(before) - int(FEWER_RIGHT * len(clear)):
        yield f"{len(now)} of {len(clear)} clear slices right, {len(before)} before"
        yield from [_changed(frozen[key], new[key]) for key in sorted(lost)]
    # A pen under pressure has to be asked about: whether a second run made it wider, a person sees.
    warned = [k for k in clear if new[k].outcome == "falsely warned" and k[0] != "pressure"]
    if len(warned) > np.ceil(MAX_WARNED * len(clear)):
        yield f"{len(warned)} of {len(clear)} clear slices warned of"
        yield from [f"    {new[key].kind} {new[key].seed}: {new[key].why}" for key in warned]
    both = [key for key in before if key in now]
    if len(both) >= 10:
        old, measured = (rms([rows[key].rms_px for key in both]) for rows in (frozen, new))
        if measured > RMS_RATIO * old:
            yield f"{measured:.3f} px RMS across the line, {old:.3f} before"
    ends = [key for key in both if not np.isnan(frozen[key].ends_px + new[key].ends_px)]
    old, measured = (np.percentile([rows[k].ends_px for k in ends], 95) for rows in (frozen, new))
    if measured > RMS_RATIO * old:
        yield f"95 % of the ends within {measured:.2f} px, {old:.2f} before"


def _is_right(row):
    """Whether the line was measured rightly, with or without a warning."""
    return row.outcome in ("right", "falsely warned")


def _was(row):
    return f"was {row.outcome}" + (f" ({row.why})" if row.why else "")


def _changed(before, now):
    why = f" ({now.why})" if now.why else ""
    return f"    {now.kind} {now.seed}: {_was(before)}, is {now.outcome}{why}"
