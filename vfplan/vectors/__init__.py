"""Curves that were drawn as vectors and need no extraction.

read   a vector curve in the patient's frame or in pixels, from any file
curve  such a curve, as straight lines or a spline, and the lines of a DICOM presentation state
"""

from __future__ import annotations

# How the names of files end that hold a curve and no picture.
SUFFIXES = (".json", ".csv", ".fcsv", ".roi")
