"""Every number of the extraction that was chosen, each with its unit, its reason and its source.

`docs/make_tuned_extraction.py` halves and doubles each of them and prints what moves.
"""

# The pen and its ink.

HUE_GATE_DEG = 22.0
"""Degrees of hue between the named pen and its ink. Crimson lies 15 degrees from red, orange 28."""

CHROMA_FLOOR = 18.0
"""Grey levels (0 to 255) of chroma below which nothing is ink. The noise of JPEG reaches 12."""

OTHER_CHROMA = 40.0
"""Grey levels of chroma at which a pixel of another hue is another pen, and no fringe of JPEG."""

OTHER_REACH_PX = 2.5
"""Pixels (sigma) around another pen over which its hue is known. A block of JPEG is 2 wide."""

MASK_BLUR_PX = 0.8
"""Pixels (sigma) by which the mask, and the ink along a line, are smoothed. Noise frays them."""

LOCAL_PX = 15
"""Pixels: the square in which the strongest ink sets the threshold. A pen's edge is narrower."""

HALF = 0.5
"""Of the strongest ink: the half-height edge of a line, which blur does not move."""

MAX_PIECES = 3000
"""Connected pieces of ink in one picture. More is noise or a coloured picture."""

# Lines and candidates.

MIN_ASPECT = 4.0
"""Length over width of a line; a part of one has half of it. A dot or a panel has less."""

RIVAL_SHARE = 0.5
"""Of the longest line's length: a line this long is a second candidate."""

FRAME_SHARE = 0.9
"""Of a line that lies on the sides of the rectangle around it, and of those sides: a frame."""

TANGENT_PX = 14
"""Pixels of line from which an end's direction is taken. A skeleton's is then good to 5 degrees."""

MAX_TURN_DEG = 45.0
"""Degrees between an end's direction and the gap that it bridges. A hand goes on as it went."""

ALIKE = 2.0
"""Factor within which the width and the strength of both sides of a gap are one pen's."""

# Profiles and the centre line.

STEP_PX = 0.5
"""Pixels between samples across the line: two a pixel lose nothing of what the picture holds."""

FLANK_PX = 2.0
"""Pixels beyond the line's edge that a profile reaches: a blur of 1.5 px ends there."""

VISIBLE = 0.25
"""Of the line's usual ink: less is a gap."""

HIDDEN = 0.85
"""Of the line's usual ink where another colour is: less, and that colour lies on top."""

FOREIGN = 0.35
"""Of the pen's strength, across its hue: another pen and no noise."""

RISE = 0.2
"""Of full coverage: ink that rises again beyond the line's edge belongs to a neighbour."""

MIN_PROFILES = 8
"""Profiles in which a line must show, so that it can be measured at all."""

SMOOTH_PX = 2.0
"""Pixels: length of the smoothing spline, and of what smooths a skeleton's stairs. Hands bend over
10 px and more; corners are kept."""

SMOOTH_NOISY_PX = 3.5
"""The same where colour is noisy. The noise of JPEG hangs together over blocks of 8 px."""

SMOOTH_MIN_PX = 1.25
"""Pixels: the shortest length over which a line is smoothed, at a corner."""

BEND_SHARE = 0.14
"""Of the radius of a bend, over which the line is smoothed there; more would cut the bend."""

BEND_REACH_PX = 9
"""Pixels of line around a bend that are smoothed as the bend is."""

END_SMOOTH = 0.5
"""Of the length over which the line is smoothed, at an open end."""

TREND_PX = 8.0
"""Pixels (sigma): slower changes of the offset are the path's and no noise."""

NOISY = 0.0027
"""Of full coverage: median beside the line from which a picture counts as noisy. PNG has 0."""

GRID_PX = 0.01
"""Pixels that the pixel grid adds to the error, which no residual shows. On seeds 12800 to 13100
with PNG the error was 0.013 px by median."""

CORRELATED_NOISY = 2.7
"""Factor on the noise where colour is noisy: the noise of JPEG hangs together over blocks of 8 px,
so that smoothing averages fewer residuals."""

END_FACTOR = 4.0
"""Times by which an open end is less sure, as the line is held from one side only."""

OTHER_SIGMA_PX = 0.15
"""Pixels: standard deviation of a line at whose edge another colour lies, over or under it."""

SWAY = 1.5
"""Times its usual curvature that a line may bend where a gap hides it."""

# What is refused.

USUAL_SHARE = 0.35
"""Of the line, where it is narrowest: the usual width is that of the widest there, so that a second
run along most of the line is no usual width."""

WIDE = 1.3
"""Times its usual width: two runs side by side, if it lasts."""

WIDE_RUN_WIDTHS = 8.0
"""Pen widths of line, half of which must be wide. A dot or a control point is 3 widths long."""

VALLEY = 0.12
"""Of the profile's height: a dip in the middle of the mean profile, two lines side by side."""

# The ends.

TAPER_REACH_PX = 30
"""Pixels beyond the skeleton's end in which the end of the ink is sought."""

ROUND_SHARE = 0.4
"""Of the width, from the place where half of the ink is left back to the centre of a round tip. A
disc has 0.43; its steep end is blurred inward."""

BLUNT_PX = 2.0
"""Pixels: the longest fall of the ink that a blunt end of a crisp hair line shows."""

BLUNT_EDGES = 1.8
"""Times the fall of the line's own edge, by which blur makes it longer."""

BLUNT_SHARE = 0.25
"""Of the width, by which a round tip makes it longer."""

BLUNT_ROUGH_PX = 105.0
"""Pixels by which it is longer for ink that varies from point to point by all of itself."""

FALL_SHARE = 0.8
"""Of the line's ink, or of its height, from which a fall is measured; it ends at the rest, 0.2."""

TAPER_TIMES = 1.5
"""Times the longest fall of a blunt end: over a fall this long the pen was drawn out."""

INK_NOISE = 0.02
"""Of the line's ink: noise of what a clean picture shows along the line."""

INK_NOISE_NOISY = 0.06
"""The same where colour is noisy."""

VISIBLE_SIGMAS = 3.0
"""Times that noise: as much ink along the line is seen, and less is none."""

INK_HANGS_PX = 5.0
"""Pixels of line over which that noise hangs together, so that they count as one."""

TAPER_PRIOR = 0.1
"""How common pens that were drawn out are, beside blunt ends."""

FLAT_WIDTH_PX = 2.5
"""Pixels of width from which a flat tip begins to show."""

FLAT_WIDTH_NOISY_PX = 7.0
"""The same where colour is noisy and therefore blurred."""

TIP_SIDE = 0.36
"""Of the width, from the middle of a tip to the sides at which its shape is read. Farther out the
line's edge blurs them."""

TIP_BAND = 0.06
"""Of the width, to either side of these places: a quarter of the line is read."""

ROUND_BACK = 0.04
"""Of the width, by which the sides of a tip end before its middle: a flat one has less, a round one
twice as much. A disc has 0.14."""

POINT_BACK = 0.22
"""Share of the width by which the sides of a tip end before its middle, from which the tip is a
point. On seeds 12800 to 13100 blunt tips in JPEG reached 0.16 and points began at 0.23."""

END_SIGMA_PX = 0.35
"""Pixels: standard deviation of an end that is plain to see, along the line. On seed 12900 it was
0.3 with PNG."""

# The account and the findings.

EDGE_BLUR_PX = 1.5
"""Pixels beyond the line's edge: ink that is closer is the blur of the edge."""

SPECK_PX = 4
"""Pixels of area: less ink is noise."""

END_REACH_GAPS = 1.5
"""Times the longest gap that is bridged: ink this close to an end may carry the curve on."""

UNSURE_PX = 1.5
"""Pixels of standard deviation along the line from which an end is unsure."""

LONG_STRETCH_PX = 20.0
"""Pixels of line hidden or bridged from which a person is asked. Shorter ones are listed."""

SUDDEN = 0.4
"""Of the usual width: a smaller sudden change is the ground's doing."""

AT_ONCE = 8.0
"""Times the median change of width over 12 px: pressed pens reached 6, second runs 16 and more."""

SUDDEN_PX = 12
"""Pixels of line over which a sudden change of width is looked for."""

LASTING_TIMES = 3.5
"""Times the usual lasting change of width: pressed pens reached 2, second runs 4 to 400."""

ONE_SIDED = 0.25
"""Of a sudden change of width, on one side of the line only: dots on the line reached 0.2."""

MIRRORED = 0.7
"""Of the pixels of such a piece that have ink on the other side as well."""

DOT_WIDTHS = 3.0
"""Pen widths of a dot, a control point or a head on the line, along and across: 2 to 3 in tests."""
