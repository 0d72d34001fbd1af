"""Plane and space geometry that several packages need."""

# Rows of an array that are worked on at once, so that memory stays at some megabytes. It changes no
# result.
ROWS_AT_ONCE = 10_000
