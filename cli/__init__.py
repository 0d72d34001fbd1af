"""The `vfplan` command line: one file a command, loaded only when it is called."""

from __future__ import annotations

from vfplan.lazy import on_demand

# What the command line, tests, samples and pages use, without a promise (docs/api-policy.md).
__getattr__ = on_demand(
    __name__,
    {
        "main": "COMMANDS GROUPS cli",
        "run": "CommandResult announce_if_slow command printable progress",
    },
)
