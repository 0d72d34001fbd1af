"""A planned slice -> the surgeon's curve in ordered, sub-pixel points, or a refusal that says why.

The modules follow the data:

extraction  the steps from image to `Extraction`
pen         the pen's colour, un-mixing, the mask
marks       connected marks, and what each of them is
candidates  lines joined over pen lifts, in a fixed order
choice      which candidate it is, or why none
ridge       the measurement: a pixel path -> the line's centre and its uncertainty
ends        where the ink of a line begins and ends
evidence    the measured line held against the ink
doubts      what a person should look at
asked       where a person says that the curve begins and ends; the outline of a region
"""

from vfplan.curve.extraction import (
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
