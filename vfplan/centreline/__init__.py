"""A planned slice -> the surgeon's curve in ordered, sub-pixel points, or a refusal that says why.

curve    the steps from image to `Extraction`
choice   which candidate it is, or why none
ridge    the measurement: a pixel path -> the line's centre and its uncertainty
"""

from vfplan.centreline.curve import (
    METHODS,
    Extraction,
    Method,
    Stroke,
    extract_curve,
    load_libraries,
    vector_stroke,
)

__all__ = [
    "METHODS",
    "Extraction",
    "Method",
    "Stroke",
    "extract_curve",
    "load_libraries",
    "vector_stroke",
]
