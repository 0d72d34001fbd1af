"""A planned slice -> the surgeon's curve in sub-pixel points, or a refusal that says why.

Measure the line well, refuse where it is ambiguous, list all other ink; a person looks at it.
The modules follow the data:

extraction  the steps, from a picture to an `Extraction`
coverage    the pen and the region, and how much of each pixel the pen covers, whatever the grey
candidates  connected pieces of ink, joined over pen lifts; one of them may be the line
choose      the line that is meant, or why none is; what only a person can settle
profiles    what the picture shows across a line, and where the pen was put down and lifted
centreline  the line's smooth centre, and the deviation of each point
account     all other ink, and what a person should look at
tuned       every number that was chosen, with its unit and reason
"""
