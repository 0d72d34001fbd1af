"""Error against run time, for every stage: `bench()` measures, `vfplan.bench.figures` draws.

record      what is measured, side by side, and how it is written down; the Pareto front
extract, sample, register, proxy, plan
            one stage each: scenes with known truth, methods, settings
peers       what a user would pick instead: a penalty force, and outside programs
summary     the chosen setting against the peers, a sentence a stage
stages      the bench as one JSON document and as CSV; the machine
"""

from __future__ import annotations

from vfplan.bench.peers import Peer, build_nanoflann
from vfplan.bench.record import summaries
from vfplan.bench.stages import STAGES, Stage, bench, read_document, write_csv, write_json

__all__ = [
    "STAGES", "Peer", "Stage", "bench", "build_nanoflann", "read_document", "summaries",
    "write_csv", "write_json",
]  # fmt: skip
