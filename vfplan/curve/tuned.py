"""Every number of the extraction that was chosen, each with its unit, its reason and its source.

`docs/make_tuned_extraction.py` halves and doubles each of them and prints what moves.
"""

# The pen and its ink.

# Degrees of hue between the named pen and its ink. Crimson lies 15 degrees from red and is still
# red; orange lies 28 degrees away and is not.
HUE_GATE_DEG = 22.0

# Grey levels (0 to 255) of chroma below which nothing is ink. The noise of JPEG reaches 12.
CHROMA_FLOOR = 18.0

# Grey levels of chroma from which a pixel of another hue is another pen's. Less may be a fringe of
# JPEG.
OTHER_CHROMA = 40.0

# Pixels (sigma) around another pen within which its hue is taken from it. JPEG stores one colour
# for 2 pixels along each axis, so its fringe is a little broader than that.
OTHER_REACH_PX = 2.5

# Power of its chroma by which a pixel of another pen counts for that pen's hue: the purest tell it,
# and one that paper takes half of counts 1/16.
PURITY_POWER = 4

# Least chroma, so weighted and smoothed, that tells another pen's hue. A pen of OTHER_CHROMA has
# 0.024; less than a 2000th of that is the far tail of the smoothing.
MIN_OTHER = 1e-5

# Pixels (sigma) by which the mask and the ink along a line are smoothed, because noise frays them.
MASK_BLUR_PX = 0.8

# Pixels along a side of the square in which the strongest ink sets the threshold. It is wider than
# any pen, so that it reaches the middle of the line from its edge.
LOCAL_PX = 15

# Share of the strongest ink at which a line ends. Blur does not move the half-height edge.
HALF = 0.5

# Number of connected pieces of ink in a picture. More is noise or a coloured picture.
MAX_PIECES = 3000

# Share of an outline's strength up to which the even ink beside it is its fill.
FILL_SHARE = 0.75

# Lines and candidates.

# Pixels along a side below which a hole in the ink belongs to a hollow handle on the line.
HANDLE_PX = 13

# Times the distance of a junction from the ink's edge, up to which a branch from there ends in the
# corner of a handle. The corner of a square is 1.4 times as far away as its side.
SPUR_RADII = 1.5

# Length of a line over its width; a part of a line has half of it. A dot or a panel has less.
MIN_ASPECT = 4.0

# Share of the longest line's length from which another line is a second candidate. From a quarter
# on, scale bars and callipers would be candidates as well.
RIVAL_SHARE = 0.5

# Share of a line that lies on the sides of the upright rectangle around it, and share of those
# sides that it covers, from which it is a frame.
FRAME_SHARE = 0.9

# Pixels of line below which it may be a letter or an icon.
CRUMB_PX = 60.0

# Share of the pen's ink below which the curve may be the smaller thing that the pen drew.
SMALL_SHARE = 0.25

# Pixels of line from which the direction of an end is taken. From these many pixels of a skeleton
# it is good to 5 degrees.
TANGENT_PX = 14

# Degrees between the direction of an end and the gap that is bridged from it. A hand goes on
# roughly as it went before it was lifted.
MAX_TURN_DEG = 45.0

# Factor within which the widths and strengths on both sides of a gap agree if one pen drew them.
ALIKE = 2.0

# Times the length of a part of the line, up to which a gap before it is asked about although it is
# too long to be bridged. A box over the middle of a curve leaves such a part.
AHEAD_LENGTHS = 2.0

# Share of the line's length up to which a gap before a shorter part is asked about.
AHEAD_SHARE = 0.25

# Profiles and the centre line.

# Pixels between samples across the line. Two samples a pixel lose nothing that the picture holds.
STEP_PX = 0.5

# Pixels that a profile reaches beyond the line's edge. A blur of 1.5 px has ended there.
FLANK_PX = 2.0

# Pixels that a profile reaches farther where another pen runs along the line: as wide as a pen.
BESIDE_PX = 4.0

# Share of the line's usual ink below which a profile lies in a gap.
VISIBLE = 0.25

# Share of the line's usual ink below which another colour at that place lies on top of the line.
HIDDEN = 0.85

# Share of the pen's strength from which colour of another hue is another pen's and no noise.
FOREIGN = 0.35

# Share of full coverage by which ink rises again, beyond the line's edge, if it belongs to a
# neighbour. A smaller rise is noise.
RISE = 0.2

# Number of profiles in which a line must show. A cubic spline has four coefficients a piece.
MIN_PROFILES = 4

# Pixels over which the spline smooths, and over which the stairs of a skeleton are smoothed. Hands
# bend over 10 px and more.
SMOOTH_PX = 2.0

# Pixels over which the spline smooths where colour is noisy. The noise of JPEG hangs together over
# blocks of 8 px, so it takes a longer stretch to average it.
SMOOTH_NOISY_PX = 3.0

# Pixels over which a line is smoothed at a sharp corner, where it is smoothed least.
SMOOTH_MIN_PX = 1.25

# Share of the radius of a bend over which the line is smoothed there. More would cut the bend.
BEND_SHARE = 0.14

# Pixels of line around a bend that are smoothed as little as the bend itself.
BEND_REACH_PX = 9

# Factor on the length over which the line is smoothed at an open end. A smoothing spline runs out
# straight there, which a bent line does not.
END_SMOOTH = 0.5

# Pixels (sigma) of line over which the offset from the path is averaged to tell its noise. Slower
# changes are the path's own.
TREND_PX = 8.0

# Share of full coverage that the median pixel beside a line has from which a picture counts as
# noisy. A PNG has 0 there.
NOISY = 0.0027

# Pixels that the pixel grid adds to the error and that no residual shows. On seeds 12800 to 13100
# with PNG the error was 0.013 px by median.
GRID_PX = 0.01

# Factor on the noise where colour is noisy. The noise of JPEG hangs together over blocks of 8 px,
# so that smoothing averages fewer residuals.
CORRELATED_NOISY = 2.7

# Times by which the deviation grows towards an open end, because ink holds the line from one side
# only. On seed 9000 with PNG the true error over the stated one was 0.9 there, and 2.0 without it.
END_FACTOR = 4.0

# Pixels of standard deviation that a line has where another colour lies at its edge, over or under
# it.
OTHER_SIGMA_PX = 0.15

# The same where colour is noisy. JPEG mixes the colours of neighbouring pixels, and the opposite
# hue takes ink from the line's edge. On seeds 161803, 271828 and 314159 it moved the centre by more
# than 0.98 px on 2 of 58 slices, by more than 0.59 px on 7.
OTHER_SIGMA_NOISY_PX = 0.5

# Times its usual curvature that a line may bend where a gap hides it.
SWAY = 1.5

# Share of the turn across a bridge that neither of its sides foretells: below the first, the noise
# of headings; from the second on, a corner. Over 30 lifts of each kind, smooth hands keep the bound
# that their curvature gives, and 96 % of the lines with a corner lie within theirs.
CORNER_SHARES = (0.25, 0.5)

# Deviations from a bridge to the farthest way that a pen takes round a corner. All 132 lifts of 6
# to 40 px in `docs/make_drawn_bound.py numbers` keep their bound up to 1.5; with 2 one does not.
CORNER_SIGMAS = 1.25

# What is refused.

# Share of the line, from its narrowest profiles on, whose widest profile has the usual width. It is
# below a half, so that a second run along most of the line does not pass for the usual width.
USUAL_SHARE = 0.35

# Times its usual width from which a lasting stretch of line is two runs side by side.
WIDE = 1.3

# Pen widths of line, half of which must be wide before it counts as two runs. A dot or a control
# point is 3 widths long.
WIDE_RUN_WIDTHS = 8.0

# Share of its height by which the mean profile dips in the middle if two lines run side by side.
VALLEY = 0.12

# The ends.

# Pixels beyond the end of the skeleton in which the end of the ink is sought.
TAPER_REACH_PX = 30

# Share of the width by which the centre of a round tip lies before the place where half of the ink
# is left. A disc has 0.43, and blur moves its steep end inward.
ROUND_SHARE = 0.4

# Pixels over which the ink of a crisp hair line falls at a blunt end, at most.
BLUNT_PX = 2.0

# Times the fall of the line's own edge by which blur lengthens the fall of a blunt end.
BLUNT_EDGES = 1.8

# Share of the width by which a round tip lengthens the fall of a blunt end.
BLUNT_SHARE = 0.25

# Pixels by which the fall of a blunt end is longer if the ink varies from point to point by all of
# itself; in proportion if it varies less.
BLUNT_ROUGH_PX = 105.0

# Share of the line's ink, or of its height, from which a fall is measured. The fall ends where the
# rest, 0.2, is left.
FALL_SHARE = 0.8

# Times the longest fall of a blunt end from which a fall shows that the pen was drawn out.
TAPER_TIMES = 1.5

# Share of the line's ink by which a clean picture varies along the line.
INK_NOISE = 0.02

# Share of the line's ink by which a picture with noisy colour varies along the line.
INK_NOISE_NOISY = 0.06

# Times the noise along the line from which ink is seen.
VISIBLE_SIGMAS = 3.0

# Pixels of line over which the noise of the ink hangs together, so that they count as one.
INK_HANGS_PX = 5.0

# Probability that a pen was drawn out, beside one that was lifted, before the ink is looked at. Of
# the open clear kinds in tests/making/extraction_kinds.py, 3 of 26 ends are drawn out.
TAPER_PRIOR = 0.1

# Pixels of width from which a flat tip begins to show. In a thinner line blur hides its corners.
FLAT_WIDTH_PX = 2.5

# Pixels of width from which a flat tip begins to show where colour is noisy and therefore blurred.
FLAT_WIDTH_NOISY_PX = 7.0

# Share of the width from the middle of a tip to the places at its sides where its shape is read.
# Farther out the line's edge blurs them.
TIP_SIDE = 0.36

# Share of the width to either side of these places, so that a quarter of the line is read.
TIP_BAND = 0.06

# Share of the width by which the sides of a tip end before its middle, below which the tip is flat.
# It is round from twice as much on. A disc has 0.14.
ROUND_BACK = 0.04

# Pixels of standard deviation along the line of an end that is plain to see. On seed 12900 it was
# 0.3 with PNG.
END_SIGMA_PX = 0.35

# The account and the findings.

# Pixels beyond the line's edge within which ink is the blur of the edge.
EDGE_BLUR_PX = 1.5

# Pixels of area below which a piece of ink is noise.
SPECK_PX = 4

# Times the longest gap that is bridged, within which ink near an end may carry the curve on.
END_REACH_GAPS = 1.5

# Share of the curve's strength up to which ink off the direction of an end is another pen's. Leader
# lines and bars had 0.35 to 0.73, a dash of the curve 0.97.
PALE = 0.75

# Pixels of standard deviation along the line from which an end is unsure.
UNSURE_PX = 1.5

# Pixels of line hidden or bridged from which a person is asked. Shorter stretches are listed.
LONG_STRETCH_PX = 20.0

# Share of the usual width below which a sudden change of width comes from the ground.
SUDDEN = 0.4

# Times the median change of width over 12 px from which a change is sudden. Pressed pens reached 6,
# second runs 16 and more.
AT_ONCE = 8.0

# Pixels of line over which a sudden change of width is looked for.
SUDDEN_PX = 12

# Share of the usual width below which a lasting change of width is JPEG's. Medians over a stretch
# are compared, so that noise counts less. Second runs in JPEG had 0.24 and more on seeds from
# 271828, 0.35 and more on those from 314159; plain lines and linear light 0.20 but for one.
LASTING = 0.23

# Pixels of width below which a lasting change is JPEG's.
LASTING_PX = 0.8

# Pixels by which a line is at most wider over black than over white where a program blends light as
# lamps do. Over 40 slices the slope was 0.5 to 2.9, but for grounds of one grey.
GROUND_PX = 3.0

# Pixels along each side of the squares ahead of an end and beside it that show whether a grey cover
# begins there.
COVER_PX = 5

# Grey levels over which the pixels of a cover range at most where the picture is no JPEG.
COVER_FLAT = 0.1

# Grey levels (standard deviation) by which the ground beside the line varies at least.
COVER_GROUND = 0.5

# Grey levels (standard deviation) by which a cover varies at most in JPEG.
COVER_EVEN = 1.0

# Share of its step from the ground by which a cover varies at most in JPEG. Of eight covers the
# most uneven one had 0.009, an edge of a bone 0.07.
COVER_SHARE = 0.03

# Grey levels by which a cover differs from the ground where JPEG makes it uneven.
COVER_STEP = 12.0

# Grey levels (standard deviation) from which the ground holds the edge of a bone.
COVER_EDGE = 24.0

# The same where JPEG makes a cover uneven.
COVER_EDGE_NOISY = 3.0

# Grey level up to which an even area is the air around a body.
COVER_BLACK = 4.0
