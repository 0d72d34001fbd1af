"""Error against run time, for every stage: `bench()` measures, `vfplan.bench.figures` draws.

record      what is measured, side by side, and how it is written down; the Pareto front
pipeline    stages extract, sample, register and plan: scenes with known truth, methods, settings
proxy       stage proxy: the same
peers       what a user would pick instead: a penalty force, and outside programs
stages      all stages as one JSON document and as CSV; the machine
"""

from __future__ import annotations

from vfplan.bench.peers import Peer, build_nanoflann
from vfplan.bench.record import summaries
from vfplan.bench.stages import STAGES, bench, read_document, write_csv, write_json

__all__ = [
    "STAGES", "Peer", "bench", "build_nanoflann", "read_document", "summaries",
    "write_csv", "write_json",
]  # fmt: skip
