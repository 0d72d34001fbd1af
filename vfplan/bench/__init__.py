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
from vfplan.bench.stages import STAGES, Stage, bench, read_document, write_csv, write_json
from vfplan.bench.summary import summaries
from vfplan.lazy import on_demand

__all__ = [
    "STAGES", "Peer", "Stage", "bench", "build_nanoflann", "read_document", "summaries",
    "write_csv", "write_json",
]  # fmt: skip

# Besides `__all__`: what tests, samples and pages use, without a promise (docs/api-policy.md).
__getattr__ = on_demand(
    __name__,
    {
        "cases": "Case chosen_points is_drawn",
        "record": "BenchRun Record errors_of judge_chosen mark_pareto measure_runs non_dominated "
        "timed_ticks",
        "peers": "NearestPointPenalty",
        "meshes": "BallMesh BoxMesh",
    },
)
