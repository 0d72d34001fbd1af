"""A planned slice -> the surgeon's curve in sub-pixel points, or a refusal that says why.

Measure the line well, refuse where it is ambiguous, list all other ink; a person looks at it.
The modules follow the data:

extraction  the steps, from a picture to an `Extraction`
pen         a pen's colour
region      where the curve is sought
coverage    how much of each pixel the pen covers, whatever the grey below it
skeleton    connected pieces of ink, as branches, junctions and ends
candidates  pieces joined over pen lifts, one of which may be the line
choose      the line that is meant, or why none is
profiles    what the picture shows across a line
centreline  the line's smooth centre, and the deviation of each point
ends        where the pen was put down and lifted
ambiguity   what only a person can settle
between     the part between two places that the caller named
account     all other ink, and what a person should look at
tuned       every number that was chosen, with its unit and reason
"""

from vfplan.curve.account import AccountEntry
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
    "AccountEntry",
    "Extraction",
    "Method",
    "Stroke",
    "extract_curve",
    "load_libraries",
    "vector_stroke",
]
