"""A planned slice -> the surgeon's curve in ordered, sub-pixel points, or a refusal that says why.

The modules follow the data:

extraction  the steps from image to `Extraction`
asked       a part of the slice, where the curve begins and ends, a region's outline: what is asked
pen         the pen's colour, and how much of it lies on each pixel
marks       connected marks, and what each of them is, by their skeletons
candidates  lines joined over pen lifts, in a fixed order
kinds       curve, text, arrow, frame, symbol or bar
choice      which candidate it is, or why none
ridge       the measurement: a pixel path -> the line's centre and its uncertainty
profile     what is read across the line: its coverage and its brightness
fitting     the spline through what was read, and its standard deviation
ends        where the ink of a line begins and ends
tip         the forms of a pen's end, fitted to the pixels there
beside      ink that the line leaves, and dots that touch it
evidence    the measured line held against the ink
covers      what may hide an end, `boxes` by their outline
doubts      what a person should look at, runs side by side among it
path        a mask's skeleton, and the geometry of a path
vector      curves that were drawn as vectors (`imagej`, `annotated`)
arcs        a measured curve as lines and arcs
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
