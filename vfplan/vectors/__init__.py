"""Curves that were drawn as vectors and need no extraction.

read   a vector curve in the patient's frame or in pixels, from any file
curve  such a curve, as straight lines or a spline, and the lines of a DICOM presentation state
"""

from __future__ import annotations

from vfplan.vectors.read import SUFFIXES, VectorDrawing, onto_slice, read_vector_curve

__all__ = ["SUFFIXES", "VectorDrawing", "onto_slice", "read_vector_curve"]
