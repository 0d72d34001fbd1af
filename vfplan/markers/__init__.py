"""Markers as a user gives them: in files, and drawn on the slice (`marks`, `drawn`)."""

from __future__ import annotations

from vfplan.lazy import on_demand
from vfplan.markers.correspondences import Correspondences, read_markers

__all__ = ["Correspondences", "read_markers"]

# Besides `__all__`: what tests, samples and pages use, without a promise (docs/api-policy.md).
__getattr__ = on_demand(
    __name__,
    {
        "find_marks": "Mark find_markers fit_mark",
        "check_marks": "compare_with_marks drawn_marks",
        "slicer": "parse_fcsv parse_mrk_json",
    },
)
