"""The conformance kit: files that say, rule by rule, what a reader of bundles must do.

`vfplan conformance --write DIR` writes the kit; `python -m vfplan.conformance CMD` runs a reader on
each of its files (docs/howto/reader.md).
"""

from __future__ import annotations

from vfplan.lazy import on_demand

# What the command line, tests, samples and pages use, without a promise (docs/api-policy.md).
__getattr__ = on_demand(
    __name__,
    {
        "kit": "write_kit",
    },
)
