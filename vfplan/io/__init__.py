"""Files and what carries them: whole files or none, and h5py without plugins."""

from __future__ import annotations

from vfplan.lazy import on_demand

# What the command line, tests, samples and pages use, without a promise (docs/api-policy.md).
__getattr__ = on_demand(
    __name__,
    {
        "json_types": "to_json_types",
        "writing": "move_into_place working_in write_whole",
        "sandbox": "run_in_sandbox",
        "files": "parse_decimal parse_seconds read_whole stream_over",
    },
)
