"""Planned slices from PNG, JPEG, TIFF, BMP and DICOM files, each read as a `PlannedImage`."""

from __future__ import annotations

from vfplan.lazy import on_demand

# What the command line, tests, samples and pages use, without a promise (docs/api-policy.md).
__getattr__ = on_demand(
    __name__,
    {
        "headers": "MAX_TIFF_PARTS read_header",
        "read": "LARGEST_MEGAPIXELS",
    },
)
