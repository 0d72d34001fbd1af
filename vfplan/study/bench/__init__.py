"""Error against run time, for every stage: `bench()` measures, `vfplan.study.bench_figures` draws.

record      what is measured, side by side, and how it is written down; the Pareto front
extract, sample, register, proxy, feel, plan
            one stage each: scenes with known truth, methods, settings
peers       what a user would pick instead: a penalty force, and outside programs
stages      the bench as one JSON document and as CSV; the machine
"""

from __future__ import annotations

from vfplan.study.bench.peers import Peer
from vfplan.study.bench.stages import STAGES, Stage, bench, read_document, write_csv, write_json

__all__ = ["STAGES", "Peer", "Stage", "bench", "read_document", "write_csv", "write_json"]
