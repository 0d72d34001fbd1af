"""Plane and space geometry that several packages need."""

from __future__ import annotations

from vfplan.lazy import on_demand

# Rows of an array that are worked on at once, so that memory stays at some megabytes. It changes no
# result.
ROWS_AT_ONCE = 10_000

# What the command line, tests, samples and pages use, without a promise (docs/api-policy.md).
__getattr__ = on_demand(
    __name__,
    {
        "arcs": "find_corners fit_arcs",
        "polyline": "values_at",
        "splines": "smoothing_spline solve_banded spline_through",
    },
)
