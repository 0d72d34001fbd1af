"""Plane and space geometry that several packages need."""

# Number of rows of an array that are worked on at once, so that memory stays at some megabytes. It
# changes no result.
ROWS_AT_ONCE = 10_000

# Distance [m] below which two places are one: a nanometre, far below what any part resolves.
ROUNDING_M = 1e-9

# Width and height of a pixel [mm]; `None` where nobody knows them.
PixelSpacing = tuple[float, float] | None

# Distance from a pixel's corner to its centre, along u and along v [px].
CORNER_PX = 0.5

# Largest rounding of a length, as a share of the longest one: some thousand steps of float64.
ROUNDING = 1e-12

# How far the length of a direction or a quaternion in a file may be from 1. Scanners and trackers
# that write three decimals stay within.
UNIT_ROUNDED = 1e-3

# The same of a quaternion that is taken at length 1, and told: two decimals rarely leave more.
TURN_ROUNDED = 5e-3
